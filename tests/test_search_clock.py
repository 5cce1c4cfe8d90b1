"""How long a search still takes: from what was timed, and nothing where nothing was timed yet."""

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.find_map import MapSettings, find_map
from bayes_dea.search_clock import SearchClock


class Time:
    """A clock that is set by hand."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def told():
    return []


@pytest.fixture
def time():
    return Time()


@pytest.fixture
def clock(told, time):
    return SearchClock(lambda *at: told.append(at), time)


def test_what_is_left(clock, told, time):
    clock.round(1)
    time.now += 2.0
    clock.swarms(10, 120, 8)
    assert told[-1] == (2.0, pytest.approx(2.0 + 22.0), "swarms, iteration 10 of at most 120")
    time.now += 2.0  # they end early, at half of what they may take
    clock.polishing()
    clock.polished(0, 4)
    assert told[-1] == (0.0, 1.0, "start 0 of 4"), "nothing is known of a polish yet"
    time.now += 3.0
    clock.polished(1, 4)
    assert told[-1] == (7.0, 16.0, "start 1 of 4")
    time.now += 9.0
    clock.polished(4, 4)
    assert told[-1] == (16.0, 16.0, "start 4 of 4")
    clock.round(2)
    time.now += 1.0
    clock.swarms(60, 120, 8)
    gone, of, text = told[-1]
    assert (gone, of - gone) == (17.0, pytest.approx(1.0 + 8 * 3.0)), "polishes take what they took before"
    assert text.endswith("round 2: the noise was another")


def test_silence(time):
    SearchClock(None, time).swarms(1, 2, 3)


def test_a_search_tells_of_it(small_campaign):
    campaign = bd.load_campaign(small_campaign)
    assembled = assemble(campaign, bd.build_model("hooke"))
    told = []
    find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), np.random.default_rng(1),
             MapSettings(swarms=2), report=lambda *at: told.append(at))
    assert all(0 <= done <= of for done, of, _ in told)
    assert any(0 < done < of for done, of, _ in told), "a time that is left"
    swarms = [text for _, _, text in told if text.startswith("swarms, iteration ")]
    assert len(swarms) > 3
    assert told[-1][2].startswith("start ")

"""Recordings to validate whose size alone contradicts a verdict: told at once, and no reason to search again."""

import pytest
from concealed_campaigns import concealed
from test_own_gains import resized
from test_second_look import LIMIT, with_roles

from bayes_dea.mismatch import diagnosis
from bayes_dea.mismatch.diagnosis import diagnose

#: those to validate among the recordings of `concealed`, and what their sensor reads beside the others'
SIZES = {"creep_1200V.csv": 1.008, "triangle_1Hz.csv": 0.993, "sine_10Hz.csv": 1.006}


def moved(effects, sizes):
    """A campaign whose recordings to validate were read by a sensor that was moved in between."""
    c = concealed(effects, validate=False)
    return with_roles(resized(c, [sizes.get(r.name, 1.0) for r in c.recordings]), set(sizes))


@pytest.fixture
def searches(monkeypatch):
    """Whether each search was on all recordings, as they are made."""
    seen, once = [], diagnosis._once

    def counted(campaign, *args):
        seen.append(all(r.role == "identify" for r in campaign.recordings))
        return once(campaign, *args)

    monkeypatch.setattr(diagnosis, "_once", counted)
    return seen


@pytest.mark.long
def test_a_sensor_that_was_moved_is_told_without_a_second_search(searches):
    s = diagnose(moved({"series_resistance": {"R_s_ohm": 1.2e5}}, SIZES), "hooke+gm3").summary
    assert searches == [False]
    assert s["verdict"] == "series_resistance"
    assert s["proof"]["how"] == "validate"
    (note,) = [w for w in s["warnings"] if "gain differs from recording to recording" in w]
    assert "triangle_1Hz.csv reads 0.99" in note
    assert "creep_1200V.csv 1.00" in note
    assert {row["recording"] for row in s["mismatch"]["where"][:2]} == {"triangle_1Hz.csv", "creep_1200V.csv"}


@pytest.mark.parametrize(
    ("effects", "sizes"),
    [
        # 1,110 V at most make the recording above that smaller, and bend it
        (LIMIT, {"creep_1200V.csv": 1.0, "triangle_1Hz.csv": 1.0}),
        # no sensor moves so far, whatever its statement allows
        ({}, {**SIZES, "triangle_1Hz.csv": 1.03}),
    ],
)
@pytest.mark.long
def test_what_may_be_more_than_that_is_searched_again(searches, monkeypatch, effects, sizes):
    answers, asked = [], diagnosis.held_gains

    def spied(*args):
        answers.append(asked(*args))
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnosis, "held_gains", spied)
    with pytest.raises(KeyboardInterrupt):
        diagnose(moved(effects, sizes), "hooke+gm3")
    assert answers == [None]


@pytest.mark.long
def test_nothing_was_left_out_where_a_sensor_was_moved(searches):
    result = diagnose(moved({}, SIZES), "hooke+gm3")
    assert searches == [False]
    assert result.verdict == "none"
    assert result.contradiction is None
    assert any("gain differs" in n for n in result.notes)

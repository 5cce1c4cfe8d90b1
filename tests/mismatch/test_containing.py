"""A leak of many megaohms is the resistance before it: where that is claimed beside an effect, it may be a leak."""

import math

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.containing import containing
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.weigh import Weighed

NAMES = ("series_resistance", "leakage", "sensor_drift")
DRIFT = {"sensor_drift": {"drift_m_per_s": 5e-8}}
PAIR = "leakage+sensor_drift"


def explained(effects, by):
    """What is concealed in a campaign, and an explanation of it by some effects."""
    campaign = concealed(effects)
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    quest = Quest(base, NAMES, effect_priors(NAMES, campaign), prior, np.random.default_rng(1))
    model = extended(problem.model, by, quest.given)
    return quest, within(Weighed((), base, base.log_evidence, 0.1, 0.0), base, model, prior)


@pytest.fixture(scope="module")
def resisted():
    """A resistance with a drift, explained by these."""
    return explained({"series_resistance": {"R_s_ohm": 6e4}, **DRIFT}, ["series_resistance", "sensor_drift"])


def test_a_leak_that_does_nothing_is_as_good_as_the_resistance_alone(resisted):
    quest, pair = resisted
    assert pair.log_evidence > quest.base.log_evidence + 100.0  # the premise
    (leak,) = containing(pair, (), quest)
    assert leak.name == PAIR
    # four decades of leaks; the resistance before one has a prior of two decades, a resistor of three
    of_resistance = math.log(3.0 / 2.0)
    assert leak.fit.objective - pair.fit.objective == pytest.approx(math.log(math.log(1e4)) - of_resistance, abs=0.1)
    # the activated law has the other half of the prior, and of the plain one the leaks that would show drop out
    not_seen = leak.log_evidence - pair.log_evidence - leak.shared_prior - of_resistance
    assert math.log(0.25) < not_seen < 0.2
    assert leak.shared_prior == pytest.approx(-math.log(2.0))
    assert leak.size_m == pytest.approx(pair.size_m, rel=0.01)
    assert leak.fit.values()["R_leak_ohm"] > 1e7


def test_what_is_known_or_stands_alone_is_not_looked_for(resisted):
    quest, pair = resisted
    assert containing(pair, (PAIR,), quest) == []
    assert containing(pair, (), quest.among(["series_resistance", "sensor_drift"])) == []
    base = quest.base
    alone = within(Weighed((), base, base.log_evidence, 0.1, 0.0), base,
                   extended(quest.model, ["series_resistance"], quest.given), quest.prior)
    assert containing(alone, (), quest) == []


def test_a_leak_is_none_behind_more_than_its_own_resistance():
    quest, pair = explained({"series_resistance": {"R_s_ohm": 4e5}, **DRIFT}, ["series_resistance", "sensor_drift"])
    assert pair.log_evidence > quest.base.log_evidence + 100.0  # the premise
    assert containing(pair, (), quest) == []  # one that comes with a leak has 100 kohm at most

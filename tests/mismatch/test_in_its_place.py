"""What comes late just as one of several effects does is that one's rival, from where it stands."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.in_its_place import alike
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.weigh import Weighed

NAMES = ("parallel_damper", "inertia", "acquisition_delay", "sensor_lag", "sensor_drift")


@pytest.fixture(scope="module")
def late():
    """Drift and a damper of 2 ms; explained by drift and a lag, and what a search for more begins with."""
    campaign = concealed({"parallel_damper": {"d0_Pa_s": 2500.0}, "sensor_drift": {"drift_m_per_s": 5e-8}})
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    quest = Quest(base, NAMES, effect_priors(NAMES, campaign), prior, np.random.default_rng(1))
    model = extended(problem.model, ["sensor_lag", "sensor_drift"], quest.given)
    return quest, within(Weighed((), base, base.log_evidence, 0.1, 0.0), base, model, prior)


def test_a_damper_is_found_where_a_lag_was(late):
    quest, lag = late
    assert lag.effects == ("sensor_lag", "sensor_drift")
    assert lag.log_evidence > quest.base.log_evidence + 100.0  # the premise
    found = {w.effects: w for w in alike(lag, (), quest)}
    damper = found["parallel_damper", "sensor_drift"]
    assert abs(damper.log_evidence - lag.log_evidence) < 5.0
    assert damper.fit.values()["d0_Pa_s"] == pytest.approx(2500.0, rel=0.1)
    assert damper.size_m == pytest.approx(lag.size_m, rel=0.01)


def test_what_is_known_or_nothing_like_it_is_not_looked_for(late):
    quest, lag = late
    known = ("parallel_damper+sensor_drift", "acquisition_delay+sensor_drift")
    assert alike(lag, known, quest) == []
    asked = []
    heard = Quest(quest.base, NAMES, quest.given, quest.prior, quest.rng, lambda *say: asked.append(say[-1]))
    alike(lag, known[1:], heard)
    assert asked == [known[0]]  # and nothing in the place of the drift


def test_a_damper_is_found_where_a_mass_with_much_damping_was(late):
    quest, _ = late
    base = quest.base
    model = extended(quest.model, ["inertia", "sensor_drift"], quest.given)
    mass = within(Weighed((), base, base.log_evidence, 0.1, 0.0), base, model, quest.prior)
    assert mass.log_evidence > base.log_evidence + 100.0  # the premise: it does much of that
    found = {w.effects: w for w in alike(mass, (), quest)}
    assert set(found) <= {("parallel_damper", "sensor_drift"), ("sensor_lag", "sensor_drift")}  # for a mass
    damper = found["parallel_damper", "sensor_drift"]
    assert damper.log_evidence > mass.log_evidence + 3.0
    assert damper.fit.values()["d0_Pa_s"] == pytest.approx(2500.0, rel=0.1)


def test_one_effect_alone_has_its_rivals_weighed_already(late):
    quest, _ = late
    base = quest.base
    alone = within(Weighed((), base, base.log_evidence, 0.1, 0.0), base,
                   extended(quest.model, ["sensor_lag"], quest.given), quest.prior)
    assert alike(alone, (), quest) == []

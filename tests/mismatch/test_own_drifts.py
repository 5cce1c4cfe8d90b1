"""A zero that creeps by another rate in each recording: no physics of the actuator, and said with its size."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.own_drifts import own_drifts


def creeping(rates, effects=None):
    """A campaign whose zeros creep at these rates (m/s); a fifth of the usual noise."""
    c = concealed(effects, scale=0.2)
    return replace(c, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] + rate * r.time_s})
        for r, rate in zip(c.recordings, rates, strict=True)))


RATES = 6e-8 * np.array([1.0, -1.0, 8.0, -6.0, 7.0, -5.0, 4.0])


@pytest.mark.long
@pytest.mark.parametrize("effects", [
    {}, {"acquisition_delay": {"T_d_s": 0.0064}},
])
def test_it_is_said_and_no_physics_is_claimed(effects):
    campaign = creeping(RATES, effects)
    s = diagnose(campaign, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    (note,) = [w for w in s["warnings"] if "that each recording has for itself" in w]
    assert ("nothing is left beside acquisition_delay (" if effects else "nothing is left (") in note


def test_drifts_are_measured():
    campaign = creeping(RATES)
    problem, prior, q = problem_of(campaign)
    fit = refit(problem, q, prior.start(), prior)
    found = own_drifts(fit, "none", prior, fit.log_evidence)
    assert found.nats > 20.0
    for r, rate in zip(campaign.recordings, RATES, strict=True):
        if r.role == "identify":
            assert found.drift_m[r.name] == pytest.approx(rate * r.time_s[-1], abs=0.5e-6)


def test_where_zeros_stay_and_where_a_wander_is_no_line_nothing_is_said():
    problem, prior, q = problem_of(concealed(scale=0.2))
    fit = refit(problem, q, prior.start(), prior)
    assert own_drifts(fit, "none", prior, fit.log_evidence) is None
    wandering = concealed(scale=0.2)
    wandering = replace(wandering, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] + 2e-6 * np.sin(r.time_s)})
        for r in wandering.recordings))
    problem, prior, q = problem_of(wandering)
    fit = refit(problem, q, prior.start(), prior)
    assert own_drifts(fit, "none", prior, -np.inf) is None

"""Recordings that were begun while the wave ran: no physics was left out, and that is said."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.under_way import under_way

#: rows that are cut off, at 1 kHz: the rest before the waves, and some of their periods
CUT = 1_640


def cut(campaign, names, rows=CUT):
    """A campaign in which the recorder of some recordings was started late."""
    return replace(campaign, recordings=tuple(
        replace(r, columns={k: v[rows:] - (v[rows] if k == "time_s" else 0.0) for k, v in r.columns.items()})
        if r.name in names else r for r in campaign.recordings))


@pytest.mark.long
def test_what_relaxes_from_before_is_told_as_that():
    late = cut(concealed(scale=0.2), ("rectangle_1Hz.csv", "triangle_1Hz.csv"))
    s = diagnose(late, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["statement"].startswith("rectangle_1Hz.csv, triangle_1Hz.csv begin under voltage and were taken to be")
    assert any("begin under voltage and were taken to begin at rest" in w for w in s["warnings"])


def test_a_drift_of_each_recording_is_not_that():
    """The columns of what relaxes take up a drift in the waves, but not in the creeps."""
    late = cut(concealed(scale=0.2), ("rectangle_1Hz.csv", "triangle_1Hz.csv"), 499)
    rates = np.random.default_rng(3).normal(0.0, 3e-7, len(late.recordings))
    drifting = replace(late, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": r.columns["displacement_m"] + rate * r.time_s})
        for r, rate in zip(late.recordings, rates, strict=True)))
    problem, prior, q = problem_of(drifting)
    fit = refit(problem, q, prior.start(), prior)
    assert under_way(fit, prior, -np.inf) is None


def test_what_began_at_rest_was_not_under_way():
    """A wave that begins at its middle, at once, is begun under voltage, too."""
    campaign = concealed(scale=0.2)
    problem, prior, q = problem_of(cut(campaign, ("sine_10Hz.csv",), 499))
    assert np.abs(problem.pieces[2].recording.columns["voltage_V"][:3]).max() > 0.0
    fit = refit(problem, q, prior.start(), prior)
    assert under_way(fit, prior, fit.log_evidence) is None

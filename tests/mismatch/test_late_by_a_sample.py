"""Another hold convention is nothing that a resistance or a lag of about a sample is not weighed against."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.readings.reread import Rereading
from bayes_dea.mismatch.search import name
from bayes_dea.mismatch.search.name import weigh_late
from bayes_dea.mismatch.sought import _retimed


@pytest.mark.parametrize("effects", [{"sensor_lag": {"tau_s_s": 1e-3}}, {"series_resistance": {"R_s_ohm": 4e4}}])
def test_a_hold_counts_where_nothing_that_comes_late_is_likelier(effects, monkeypatch):
    """With a resistance of 15 kOhm read at 2 kHz, hold = "linear" left nothing, and a delay alone was asked."""
    campaign = concealed(effects)
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)

    def weighed(names):
        monkeypatch.setattr(name, "_LATE_BY_A_SAMPLE", names)
        return weigh_late(base, campaign, {}, prior, np.random.default_rng(1))

    def retimed(weight):
        held = Rereading(replace(base, log_evidence=weight), weight, hold="linear")
        return _retimed(base, campaign, {}, prior, np.random.default_rng(1), lambda _: [held])

    delay, late = weighed((name.DELAY,)), weighed((name.DELAY, *effects))
    assert late > max(delay, base.log_evidence + 100.0) + 20.0  # the premise
    assert retimed(late - 10.0) is None
    assert retimed(late + 10.0).hold == "linear"
    assert weighed(()) is None

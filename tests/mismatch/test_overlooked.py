"""Rivals that promise nothing from where the base stands, because a mode of it does their work."""

import numpy as np
import pytest

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search import promising
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.grid import screen
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.quest import Quest


@pytest.mark.long
def test_a_lag_is_found_from_where_a_damper_stands(diagnosed):
    """A lag of 1.2 ms, where the base is stuck with a mode far faster than the sampling in its place."""
    result = diagnosed("sensor_lag", {"tau_s_s": 1.2e-3})
    prior, base = noise_prior(result.assembled), result.base
    campaign = result.assembled.campaign
    model = base.problem.model
    q = base.q.copy()
    q[list(model.coordinate_names).index("log T_3")] = np.log(4e-5)
    stuck = refit(base.problem, q, prior.start(), prior, max_steps=0, fit_noise=False)
    grids = {n: screen([Frame(stuck)], extended(model, [n], effect_priors([n], campaign)), (n,))
             for n in ("parallel_damper", "sensor_lag")}
    leader = result.naming.weighed["parallel_damper"].fit
    assert leader is not base
    quest = Quest(stuck, ("sensor_lag",), {}, prior, np.random.default_rng(1))
    found = promising.overlooked(stuck, leader, [grids["sensor_lag"]], quest)
    assert [w.name for _, w in found] == ["sensor_lag"]
    lag = found[0][1]
    assert abs(lag.fit.values()["tau_s_s"] / 1.2e-3 - 1) < 0.1
    assert lag.fit.log_evidence > stuck.log_evidence + 100


@pytest.mark.long
def test_nothing_is_looked_at_again_where_the_base_stays(diagnosed):
    """What waits would be found (it is the truth) were the base moved far enough."""
    result = diagnosed("sensor_lag", {"tau_s_s": 1.2e-3})
    prior, base = noise_prior(result.assembled), result.base
    model = extended(base.problem.model, ["sensor_lag"], effect_priors(["sensor_lag"], result.assembled.campaign))
    waiting = screen([Frame(base)], model, ("sensor_lag",))
    assert waiting.gain > promising.LEAST_GAIN  # what it takes to be refitted
    assert promising.overlooked(base, base, [waiting], Quest(base, (), {}, prior, np.random.default_rng(1))) == []
    elsewhere = base.q.copy()
    elsewhere[list(base.problem.model.coordinate_names).index("log T_3")] -= 1.1
    moved = refit(base.problem, elsewhere, prior.start(), prior, max_steps=0, fit_noise=False)
    assert promising.overlooked(base, moved, [waiting], Quest(base, (), {}, prior, np.random.default_rng(1)))

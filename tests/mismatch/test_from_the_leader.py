"""What does just the same as the leader is as probable, wherever its own search ended."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.rivals import again, from_the_leader


@pytest.mark.long
def test_a_rival_whose_base_went_astray_comes_back_to_the_leaders():
    """A lag and a damper are one function of these recordings; the damper's slow modes are sent elsewhere."""
    result = diagnose(concealed({"sensor_lag": {"tau_s_s": 0.02}}), "hooke+gm3", seed=1)
    assert set(result.summary["indistinguishable"]) >= {"sensor_lag", "parallel_damper"}
    leader, rival = (result.naming.weighed[n] for n in ("sensor_lag", "parallel_damper"))
    prior, fit = noise_prior(result.assembled), rival.fit
    q = fit.q.copy()
    at = fit.problem.model.priors.names.index("tau_1_s")
    q[at] += np.log(30.0)
    stuck = refit(fit.problem, q, fit.noise, prior, max_steps=0, fit_noise=False)
    behind = stuck.log_evidence - fit.log_evidence
    assert -60.0 < behind < -5.0  # the premise
    astray = replace(rival, fit=stuck, log_evidence=rival.log_evidence + behind)
    quest = Quest(fit, (), {}, prior, np.random.default_rng(1))
    (back,) = from_the_leader(leader, [astray, leader], quest)
    assert back.effects == rival.effects
    assert abs(back.log_evidence - rival.log_evidence) < 1.0
    # as does one of another reading of these recordings, where they are read anew
    (known,) = again([stuck], result.base, prior)
    assert known.effects == rival.effects
    assert known.log_evidence > stuck.log_evidence + 0.9 * abs(behind)
    # a rival that stands well is not moved, or by next to nothing
    assert all(t.log_evidence < rival.log_evidence + 1.0 for t in from_the_leader(leader, [rival], quest))

"""What does just the same as the leader is as probable, wherever its own search ended."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.rivals import again, from_the_leader
from bayes_dea.mismatch.search.weigh import Weighed


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


def test_a_rival_may_be_read_late_beside_a_leader_that_is_not():
    """A damper read 0.3 samples late, its slowest mode astray, and a lag that leads with its modes in their places."""
    problem, prior, q = problem_of(concealed({"parallel_damper": {"d0_Pa_s": 3000.0}}))
    base = refit(problem, q, prior.start(), prior)
    start = Weighed((), base, base.log_evidence, 0.1, 0.0)
    leader = within(start, base, extended(problem.model, ["sensor_lag"], {}), prior)
    rival = within(leader, base, extended(problem.model, ["parallel_damper", "acquisition_delay"], {}), prior)
    fit = rival.fit
    away = fit.q.copy()
    away[fit.problem.model.priors.names.index("tau_1_s")] += np.log(30.0)
    stuck = refit(fit.problem, away, fit.noise, prior, max_steps=0, fit_noise=False)
    assert stuck.log_evidence < fit.log_evidence - 5.0  # the premise
    astray = replace(rival, fit=stuck, log_evidence=stuck.log_evidence)
    quest = Quest(base, (), {}, prior, np.random.default_rng(1))
    near = replace(leader, log_evidence=stuck.log_evidence + 5.0)
    (back,) = from_the_leader(near, [astray, leader], quest)
    assert set(back.effects) == {"parallel_damper", "acquisition_delay"}
    assert back.log_evidence > fit.log_evidence - 1.0
    # two of which neither is a shift are no rival of one
    assert from_the_leader(near, [replace(astray, effects=("parallel_damper", "sensor_drift"))], quest) == []


def test_what_the_leader_contains_comes_back_from_however_far():
    """A leak that takes nothing is a resistance; the resistance alone stands hundreds of nats behind."""
    problem, prior, q = problem_of(concealed({"series_resistance": {"R_s_ohm": 1.5e5}}))
    base = refit(problem, q, prior.start(), prior)
    start = Weighed((), base, base.log_evidence, 0.1, 0.0)
    leader, rival = (
        within(start, base, extended(problem.model, [name], {}), prior) for name in ("leakage", "series_resistance")
    )
    fit = rival.fit
    away = fit.q.copy()
    away[fit.problem.model.priors.names.index("R_s_ohm")] += np.log(1.2)
    stuck = refit(fit.problem, away, fit.noise, prior, max_steps=0, fit_noise=False)
    assert stuck.log_evidence < leader.log_evidence - 200.0  # the premise
    astray = replace(rival, fit=stuck, log_evidence=stuck.log_evidence)
    quest = Quest(base, (), {}, prior, np.random.default_rng(1))
    (back,) = from_the_leader(leader, [astray, leader], quest)
    assert back.effects == ("series_resistance",)
    assert abs(back.log_evidence - fit.log_evidence) < 1.0
    # of another one that far behind the search has told enough
    assert from_the_leader(replace(leader, effects=("sensor_lag",)), [astray], quest) == []

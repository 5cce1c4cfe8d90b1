"""A damper and a lag of the sensor are one function of the voltage: wherever one stands, the other is looked for."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.bench.concealed import draw_case
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.damper_or_lag import _as_a_damper, _as_a_lag, damper_or_lag
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.weigh import Weighed

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "runs" / "concealed"))

from study import campaign_of

BOTH = ("parallel_damper", "sensor_lag")
MODES = {"Y_Pa": 0.8e6, "k_1_Pa": 30e3, "k_2_Pa": 50e3, "k_3_Pa": 15e3, "tau_1_s": 90.0, "tau_2_s": 4.0, "tau_3_s": 0.3}


def _modulus(values, modes, s):
    return values["Y_Pa"] + sum(k * s * tau / (1.0 + s * tau) for tau, k in modes)


def test_they_are_one_function_of_the_stress():
    s = 2j * np.pi * np.geomspace(1e-3, 1e3, 60)
    values = {**MODES, "tau_s_s": 0.02}
    lagging = _modulus(values, [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in (1, 2, 3)], s) * (1.0 + 0.02 * s)
    there, modes = _as_a_damper(values, 3)
    damped = _modulus(there, modes, s) + s * there["d0_Pa_s"]
    assert np.max(np.abs(damped / lagging - 1.0)) < 1e-12
    # and back
    weaker = {**there, **{f"k_{j}_Pa": k for j, (_, k) in enumerate(modes, 1)}}
    back, stronger = _as_a_lag(weaker, 3)
    assert back["tau_s_s"] == pytest.approx(0.02, rel=1e-9)
    assert [k for _, k in stronger] == pytest.approx([MODES[f"k_{j}_Pa"] for j in (1, 2, 3)], rel=1e-9)


@pytest.fixture(scope="module")
def damped():
    """A damper of 5 kPa s, what it is as a lag, and a quest of both."""
    campaign = concealed({"parallel_damper": {"d0_Pa_s": 5000.0}})
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    quest = Quest(base, BOTH, effect_priors(BOTH, campaign), prior, np.random.default_rng(1))
    none = Weighed((), base, base.log_evidence, 0.1, 0.0)
    damper, lag = (within(none, base, extended(problem.model, [name], quest.given), prior) for name in BOTH)
    return quest, damper, lag


def test_each_is_found_from_the_other(damped):
    quest, damper, lag = damped
    assert abs(damper.fit.objective - lag.fit.objective) < 1.0  # the premise
    for one, other in ((damper, lag), (lag, damper)):
        (found,) = damper_or_lag(one, {one.name: one}, quest)
        assert found.effects == other.effects
        assert found.fit.objective == pytest.approx(other.fit.objective, abs=0.3)


def test_one_that_ended_astray_is_put_right(damped):
    """A quarter of the damper is missing where its search ended."""
    quest, damper, lag = damped
    fit, names = damper.fit, damper.fit.problem.model.priors.names
    q = fit.q.copy()
    q[names.index("d0_Pa_s")] += np.log(0.75)
    stuck = refit(fit.problem, q, fit.noise, quest.prior, max_steps=0, fit_noise=False)
    assert stuck.objective > lag.fit.objective + 5.0  # the premise
    astray = replace(damper, fit=stuck, log_evidence=stuck.log_evidence)
    (back,) = damper_or_lag(lag, {"parallel_damper": astray, "sensor_lag": lag}, quest)
    assert back.fit.objective == pytest.approx(fit.objective, abs=0.3)
    assert back.fit.values()["d0_Pa_s"] == pytest.approx(5000.0, rel=0.02)


def test_what_stands_well_or_is_not_asked_is_left_alone(damped):
    quest, damper, lag = damped
    known = {w.name: w for w in (damper, lag)}
    assert damper_or_lag(lag, known, quest) == []
    assert damper_or_lag(damper, known, quest) == []
    assert damper_or_lag(lag, {}, quest.among(["sensor_lag"])) == []
    none = Weighed((), quest.base, quest.base.log_evidence, 0.1, 0.0)
    assert damper_or_lag(none, known, quest) == []


@pytest.mark.long
def test_a_mode_that_did_the_work_of_a_lag_needs_no_further_one_beside_it():
    """A damper, read 0.5 ms late: a mode stayed at 4 ms, a lag and a further mode led with 0.96, and the damper was
    given up as hopeless."""
    case = draw_case(1568469)
    s = diagnose(campaign_of(case), case.model, seed=1).summary
    assert case.truth == "parallel_damper"
    assert set(s["indistinguishable"]) == {"parallel_damper", "sensor_lag"}

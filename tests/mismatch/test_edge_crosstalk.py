"""A crosstalk of the command into the reading: told as that, and not as a mode of the material that fast."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.bench.concealed import draw_case
from bayes_dea.gauss_newton.descent import value_at
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.edge_crosstalk import (
    _SIZE_M,
    _about,
    _promise,
    _shared,
    crosstalk_column,
    crosstalk_of,
)
from bayes_dea.noise.blocks import block_means

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "runs" / "concealed"))

from study import campaign_of

SIZE, TAU_S = -2e-8, 6e-3


def crossed(size=SIZE, tau_s=TAU_S):
    return concealed({"edge_crosstalk": {"crosstalk_m_per_V": size, "tau_crosstalk_s": tau_s}}, scale=0.5)


def test_it_is_a_high_pass_of_the_command():
    """w' = V' - w / tau, row by row, the command of a row acting from the row before it on."""
    problem, *_ = problem_of(concealed(), "hooke+gm1")
    for piece in problem.pieces:
        r = piece.recording
        w, out = 0.0, np.empty(r.n)
        for i, (dt, dv) in enumerate(zip(np.diff(r.time_s, prepend=r.time_s[0]),
                                         np.diff(r.columns["voltage_V"], prepend=r.columns["voltage_V"][0]),
                                         strict=True)):
            w = (w + dv) * np.exp(-dt / TAU_S)
            out[i] = w
        expected = block_means(out / 1000.0, piece.blocks)
        np.testing.assert_allclose(crosstalk_column(piece, TAU_S), expected, atol=0.01 * np.abs(expected).max())


def test_its_size_is_found_beside_a_base_that_did_its_work():
    problem, prior, q = problem_of(crossed())
    base = refit(problem, q, prior.start(), prior)
    found = crosstalk_of(base, base, prior)
    assert found.log_evidence > base.log_evidence + 100.0
    assert abs(found.mean_m / 1000.0 - SIZE) < 4 * found.sd_m / 1000.0 < 0.4 * abs(SIZE)
    assert found.tau_s == pytest.approx(TAU_S, rel=0.25)
    assert _promise(base) > 20.0
    # a bound that the best of the first look keeps, and its neighbours do not, costs nothing; what all are above does
    beside = [replace(problem, shared=_shared(base, t), amplitude_m=_SIZE_M) for t in (2e-3, 8e-3, 32e-3)]
    reached = sorted(value_at(p, refit(p, q, prior.start(), prior).q, prior.start()) for p in beside)
    assert reached[1] > reached[0] + 5.0
    kept = crosstalk_of(base, base, prior, reached[0] + 4.0)
    assert kept.log_evidence == pytest.approx(found.log_evidence, abs=0.1)
    assert crosstalk_of(base, base, prior, reached[0] - 20.0) is None
    # nor does an evidence that is reached, and one that is out of reach spares the closer look
    kept = crosstalk_of(base, base, prior, beyond=found.log_evidence - 5.0)
    assert kept.log_evidence == found.log_evidence
    assert crosstalk_of(base, base, prior, beyond=found.log_evidence + 1000.0) is None


def test_a_start_that_leads_nowhere_does_not_hide_it(monkeypatch):
    """From the middle of their priors the modes of a noisy campaign went 140 nats astray, from a fit they do not."""
    problem, prior, q = problem_of(crossed())
    base = refit(problem, q, prior.start(), prior)
    astray = base.q.copy()
    astray[0] += 400.0  # where a model has no answer
    monkeypatch.setattr("bayes_dea.mismatch.readings.edge_crosstalk.typical", lambda *_: astray)
    found = crosstalk_of(base, base, prior)
    assert found.log_evidence > base.log_evidence + 100.0
    assert found.tau_s == pytest.approx(TAU_S, rel=0.25)


@pytest.mark.long
def test_a_weak_one_of_3_ms_is_no_mode_as_fast():
    case = draw_case(1568054)
    s = diagnose(campaign_of(case), case.model, seed=1).summary
    assert case.truth == "unknown:edge_crosstalk"
    assert s["verdict"] == "unknown"


@pytest.mark.long
def test_the_likelier_of_it_and_a_mode_is_the_verdict():
    """8 ms, 10 um a kV in noise of 7: 2.2 nats likelier than a mode of 12 ms, prior odds in."""
    case = draw_case(1568187)
    s = diagnose(campaign_of(case), case.model, seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["indistinguishable"] == ["unknown", "extra_relaxation_mode"]
    assert "about as well as extra_relaxation_mode" in s["statement"]


def test_where_there_is_none_nothing_is_promised():
    problem, prior, q = problem_of(concealed(scale=0.5))
    base = refit(problem, q, prior.start(), prior)
    assert _promise(base) < 10.0
    assert crosstalk_of(base, base, prior).log_evidence < base.log_evidence


@pytest.mark.parametrize("slope", [0.0, 1e-9, -1e-9, 1e-3])
def test_where_nothing_tells_time_constants_apart_they_stay_within_the_prior(slope):
    height = {t: slope * np.log(t) - 1e-12 * np.log(t) ** 2 for t in (2e-3, 4e-3, 8e-3)}
    assert all(1e-3 <= t <= 64e-3 for t in _about(height))
    told = _about({t: -3.0 * np.log(t / 5e-3) ** 2 for t in (2e-3, 4e-3, 8e-3)})
    assert told[0] == pytest.approx(5e-3, rel=1e-3)
    assert _about({4e-3: 0.0, 8e-3: -1.0}) == []


@pytest.mark.long
def test_a_crosstalk_is_no_effect_of_the_actuator():
    s = diagnose(crossed(), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["confidence"] > 0.9
    (term,) = s["repair"]["terms"]
    assert abs(term["mean"] - SIZE) < 4 * term["sd"] < 0.4 * abs(SIZE)
    assert (s["repair"]["stage"], term["unit"]) == ("sensor", "m/V")
    assert s["statement"].startswith("A crosstalk of the high voltage into the sensor")
    assert not s["repair"]["form"].endswith(",")


@pytest.mark.long
@pytest.mark.parametrize("tau_s", [4e-3, 0.03])
def test_a_mode_as_fast_stays_one(tau_s):
    c = concealed({"extra_relaxation_mode": {"k_x_Pa": 1.5e5, "tau_x_s": tau_s}}, scale=0.3)
    s = diagnose(c, "hooke+gm2", seed=1).summary
    assert "crosstalk" not in s["statement"]
    assert s["verdict"] != "unknown"

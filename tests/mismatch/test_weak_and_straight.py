"""Effects that readings follow in a line, known far better than a grid is fine; and what is too small to be claimed."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.campaign import load_campaign
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.grid import Scored, parabola, screen
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.known import Known
from bayes_dea.mismatch.search.naming import Explanation, but_for_what_is_too_small


def _scored(x, value):
    return Scored(value, value, np.array([x]), np.zeros(0), None)


def test_the_vertex_of_a_parabola_is_scored():
    def f(x):
        return 3.0 + 50.0 * (x - 0.13) ** 2

    found = [_scored(x, f(x)) for x in (-1.0, 0.0, 1.0)]
    parabola(found, lambda own: found.append(_scored(float(own[0]), f(float(own[0])))))
    assert len(found) == 4  # that it is where it was is seen without another one
    assert abs(float(found[-1].own[0]) - 0.13) < 1e-12
    # nothing where the best one is at an end
    ends = [_scored(x, -x) for x in (0.0, 1.0, 2.0)]
    parabola(ends, lambda own: ends.append(_scored(float(own[0]), 0.0)))
    assert len(ends) == 3


def test_a_weak_drift_is_found_between_two_points_of_its_grid():
    """1.2 um in the longest recording, where its prior reaches 19 um either way."""
    drift = 2.5e-8
    campaign = concealed({"sensor_drift": {"drift_m_per_s": drift}})
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    m = extended(problem.model, ["sensor_drift"], effect_priors(["sensor_drift"], campaign))
    s = screen([Frame(replace(base, noise=prior.start()))], m, ("sensor_drift",))
    best = float(s.points[0].own[0])
    grid = [float(p.own[0]) for p in s.points]
    assert min(abs(x - drift) for x in grid if x != best) > 0.3 * drift  # the premise
    assert abs(best - drift) < 0.3 * drift
    assert s.gain > 5.0


@dataclass(frozen=True)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float
    size_m: float
    fit: object = None
    refitted: bool = True

    @property
    def name(self):
        return "+".join(self.effects) or "none"


@dataclass(frozen=True)
class Looked:
    p_value: float


def test_what_is_left_is_judged_beside_an_effect_too_small_to_be_claimed():
    """CONTRACT 1: what lies below one resolution step is not claimed as physics, nor is it a mismatch of no kind."""
    asked = []

    def explained(w):
        asked.append(w.name)
        return Explanation(w, Looked(0.5 if "sensor_drift" in w.effects else 1e-9), "its own")

    none = Stub((), 0.0, 0.0)
    lag = Stub(("sensor_lag",), 100.0, 1e-6, object())
    drift = Stub(("sensor_lag", "sensor_drift"), 130.0, 1e-7, object())
    damper = Stub(("parallel_damper", "sensor_lag"), 140.0, 1e-7, object())
    best = Explanation(lag, Looked(1e-8))

    def judged(*more):
        asked.clear()
        known = Known(none, 1.5e-7, {"single": 0.3, "double": 0.04}, 20)
        known.take([lag, *more])
        return but_for_what_is_too_small(best, known, explained)

    out = judged(drift)
    assert out.weighed is lag
    assert out.adequate
    assert out.small is drift
    assert out.discrepancy == "its own"
    assert out.scan.p_value == 1e-8  # what was found stays what was found
    # one that is large enough is a rival of its own, one that leaves something is no excuse, one alone no addition
    assert judged(replace(drift, size_m=2e-7)) is best
    assert asked == []
    assert judged(damper, drift) is best
    assert asked == ["parallel_damper+sensor_lag"]
    assert judged(replace(drift, effects=("sensor_drift",))) is best
    assert judged(replace(drift, log_evidence=90.0)) is best
    assert math.isclose(best.scan.p_value, 1e-8)


@pytest.mark.long
def test_a_strength_of_a_four_hundredth_of_its_prior_is_found(tmp_path):
    """Retention of 0.19 % in quiet recordings, 22 nats: five times as much looks a thousand nats worse than none."""
    case = draw_case(1563172)
    assert case.effects["charge_retention"]["a_q"] < 0.0025 * 0.8  # the premise: of a prior from 0 to 0.8
    result = diagnose(load_campaign(write_case(case, tmp_path / "campaign")), case.model, seed=1)
    assert result.verdict == "charge_retention"
    found = result.summary["hypotheses"][0]["parameters"]["a_q"]
    assert found["q05"] < 1.2 * case.effects["charge_retention"]["a_q"]
    assert found["q95"] > case.effects["charge_retention"]["a_q"]

"""A fit that stopped in a bent valley goes on: a slow mode gives way to a drift, and the other way round."""

from types import SimpleNamespace

import numpy as np
import pytest

from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.campaign import load_campaign
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search import promising
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.weigh import Weighed


@pytest.mark.parametrize(("first", "leaves", "gone_on"), [
    ("sensor_drift", True, ["sensor_drift", "supply_dead_zone"]),
    ("sensor_drift", False, ["sensor_drift", "inertia", "supply_dead_zone"]),
    ("inertia", True, ["inertia", "sensor_drift", "supply_dead_zone"]),
])  # fmt: skip
def test_what_is_dear_is_not_gone_on_with_behind_a_leader_that_leaves_something(monkeypatch, first, leaves, gone_on):
    """Another effect is looked for beside the leader then; a mass behind friction took a minute to the last nat."""
    evidence = {"sensor_drift": 93.0, "inertia": 92.0, "supply_dead_zone": 90.0} | {first: 95.0}

    def fit_of(name):
        return SimpleNamespace(objective=-evidence[name], log_evidence=evidence[name])

    def refined(base, s, *_, **__):
        (name,) = set(s.effects) - {"sensor_lag"}
        return Weighed(s.effects, fit_of(name), evidence[name], 0.1, 0.0, -evidence[name])

    spec = SimpleNamespace(effects=("sensor_lag",))
    base = SimpleNamespace(objective=0.0, log_evidence=0.0,
                           problem=SimpleNamespace(pieces=(), model=SimpleNamespace(spec=spec)))  # fmt: skip
    screened = [
        SimpleNamespace(effects=("sensor_lag", name), gain=evidence[name], base_objective=0.0, log_evidence=0.0,
                        model=SimpleNamespace(dimension=8))
        for name in evidence
    ]  # fmt: skip
    went = []

    def goes_on(w, *_):
        went.append(w.effects[-1])
        return w

    monkeypatch.setattr(promising, "refine", refined)
    monkeypatch.setattr(promising, "_gone_on", goes_on)
    monkeypatch.setattr(promising, "escape", lambda base, s, w, prior: w)
    for same in ("relocated", "begun_from"):
        monkeypatch.setattr(promising, same, lambda fit, *_: fit)
    monkeypatch.setattr(promising, "overlooked", lambda *_: [])
    monkeypatch.setattr(promising, "stands_in", lambda _: False)
    monkeypatch.setattr(promising, "own_index", lambda *_: np.zeros(5, dtype=int))  # no ridge to go along
    out = promising.refined(base, screened, Quest(base, (), {}, None, None, adequate=lambda fit: not leaves))
    assert len(out) == 3
    assert went == gone_on


@pytest.mark.long
def test_the_fit_of_what_is_named_is_at_its_end(tmp_path):
    case = draw_case(1547328)
    result = diagnose(load_campaign(write_case(case, tmp_path / "campaign")), case.model, seed=1)
    assert result.verdict == "sensor_drift"
    fit, prior = result.corrected, noise_prior(result.assembled)
    assert refit(fit.problem, fit.q, prior.start(), prior).objective > fit.objective - 0.2
    drift = result.summary["hypotheses"][0]["parameters"]["drift_m_per_s"]
    assert drift["q05"] < case.effects["sensor_drift"]["drift_m_per_s"] < drift["q95"]

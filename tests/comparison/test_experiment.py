"""Which experiment tells two structures apart: effects count, and what cannot differ tells nothing."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.assemble import assemble
from bayes_dea.comparison.experiment import _answer, separation, telling_apart, trials
from bayes_dea.comparison.fit_one import Fitted
from bayes_dea.design.response import answers
from bayes_dea.models.model import build_model
from bayes_dea.report.comparison_page import _apart as row_of

VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 6e4, "tau_1_s": 1.0, "R_s_ohm": 2e5, "alpha_T_m_per_K": 3e-6, "V_dead_V": 60.0}


@pytest.fixture(scope="module")
def fits(voltage_campaign):
    """Each structure at the same material, its parameters known to a per cent, by name of its effect."""
    # the recordings know no temperature: the chain alone says what noise and actuator are
    assembled, out = assemble(voltage_campaign, build_model("hooke+gm1")), {}
    for effect in ("", "series_resistance", "thermal_expansion", "supply_dead_zone"):
        model = build_model(f"hooke+gm1+{effect}" if effect else "hooke+gm1")
        posterior = replace(assembled.posterior, model=model)
        point = {p.name: np.array([VALUES[p.name]]) for p in model.parameters}
        z = model.from_prior_coordinates(model.priors.to_coordinates(point))[0]
        x = np.concatenate([z, assembled.posterior.noise_guess()])
        out[effect] = Fitted(model, assembled, posterior, x, 1e-4 * np.eye(x.size), 0.0, 0.0, 0.0, 1, 1)
    return out


def actuator_of(fit):
    return fit.assembled.prepared[0].recording.actuator


@pytest.mark.parametrize("effect", ["series_resistance", "supply_dead_zone", "thermal_expansion"])
def test_answers_are_those_of_the_whole_model(fits, effect):
    fit, plain = fits[effect], fits[""]
    differs = 0.0
    for trial in trials(actuator_of(fit), False):
        y = _answer(fit, fit.x, trial)
        z = fit.x[None, : fit.model.dimension]
        np.testing.assert_allclose(y, answers(fit.model, z, trial.recording)[0], rtol=0, atol=1e-12)
        differs = max(differs, float(np.max(np.abs(y - _answer(plain, plain.x, trial)))))
    # at a steady temperature nothing expands; the others lose up to a tenth of 200 um
    assert differs == pytest.approx(0.0, abs=1e-9) if effect == "thermal_expansion" else differs > 5e-6


def test_a_model_that_looks_at_the_temperature_is_told_from_others(fits):
    found = telling_apart(fits["thermal_expansion"], fits["series_resistance"], False)
    assert found["decisive"]
    fast = [t for t in trials(actuator_of(fits[""]), False) if t.experiment.pattern == "sine"]
    nats = [separation(fits["series_resistance"], fits[""], t) for t in fast]
    same = [separation(fits["series_resistance"], fits["thermal_expansion"], t) for t in fast]
    assert max(nats) > 5.0
    assert same == pytest.approx(nats, rel=1e-3)


def test_a_rival_that_may_move_to_the_same_answers_is_not_told_apart(fits):
    """What moves least goes, too: it starts a sd of each parameter away, and may be anywhere within a few of them."""
    a = fits[""]
    d = a.model.dimension
    off = a.x.copy()
    off[:d] += 0.1
    b = replace(a, x=off, covariance=np.eye(a.x.size) * 0.1**2)
    for trial in trials(actuator_of(a), False):
        assert 0.0 <= separation(a, b, trial) < 0.5 * d


def test_experiments_are_read_as_often_as_the_bench_reads(fits):
    recordings = [p.recording for p in fits[""].assembled.prepared]
    rate = 1.0 / np.median(np.diff(recordings[0].time_s))
    assert rate < 100.0

    def read(trial):
        return trial.experiment.rows.readings.sum() / trial.experiment.duration_s

    for trial in trials(actuator_of(fits[""]), False, recordings):
        assert read(trial) == pytest.approx(rate, rel=0.1)
    # of a bench that nothing is known of
    assert read(trials(actuator_of(fits[""]), False)[0]) == pytest.approx(1000.0, rel=0.1)


def test_every_experiment_has_its_words_on_the_page(fits):
    """Settings are numbers, or words."""
    stated = [t.experiment.stated for t in trials(actuator_of(fits[""]), True)]
    assert any(isinstance(v, str) for e in stated for k, v in e.items() if k != "kind")
    for e in stated:
        told = {"models": ["a", "b"], "experiment": e, "expected_nats": 6.0, "cost_s": 60.0, "decisive": True}
        shown = row_of(told)["experiment"]
        assert shown.startswith(f"{e['kind']}: ")
        assert all(f"{k} = " in shown for k in e if k != "kind")

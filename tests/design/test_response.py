"""Answers of draws to recordings that are planned."""

from dataclasses import replace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR

from bayes_dea.design.response import answers
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment, menu
from bayes_dea.forward import simulate
from bayes_dea.models.model import build_model

LIMITS = limits_of_actuator(ACTUATOR, True)
#: the first experiment of every pattern
FIRST = {e.pattern: e for e in reversed(menu(LIMITS))}


def test_a_planned_recording_needs_no_temperature():
    recording = Experiment("creep", (1.0, 0.2), limits_of_actuator(ACTUATOR, True)).recording
    values = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}
    out = []
    for spec, more in (("hooke+gm1+sensor_lag", {"tau_s_s": 1e-9}),
                       ("hooke+gm1+sensor_lag+thermal_expansion", {"tau_s_s": 1e-9, "alpha_T_m_per_K": 3e-6})):
        model = build_model(spec)
        point = {k: np.array([v]) for k, v in {**values, **more}.items()}
        out.append(answers(model, model.from_prior_coordinates(model.priors.to_coordinates(point)), recording))
    np.testing.assert_allclose(out[1], out[0], rtol=1e-12)
    assert out[0].max() > 1e-5


@pytest.mark.parametrize("spec", [
    "hooke+gm2", "yeoh+gm2", "pz3", "hooke+gm2+series_resistance", "hooke+gkv1+supply_dead_zone",
    "neohooke+gm1+series_resistance+thickness_feedback", "hooke+gm1+rate_independent_hysteresis", "hooke+gm1+inertia",
    "hooke+gm1+parallel_damper", "hooke+gm1+sensor_lag+acquisition_delay", "hooke+gm1+sensor_nonlinearity",
    "hooke+gm1+one_quadrant_supply", "pz3+series_resistance",
])  # fmt: skip
def test_every_kind_of_model_answers_as_it_is_simulated(spec):
    """The effects too: at the same draws the answers are those of the forward simulation, whatever the pattern."""
    model = build_model(spec)
    z = model.prior_draws(200, np.random.default_rng(3))
    z = z[np.argsort(np.sum(((z - z.mean(axis=0)) / z.std(axis=0)) ** 2, axis=1))[[0, 60]]]
    values = [{k: float(v[i]) for k, v in model.physical(z).items()} for i in range(len(z))]
    seen = 0
    for experiment in FIRST.values():
        r = experiment.recording
        if model.is_black_box and not r.is_voltage:
            continue
        zero = None if r.is_voltage else 1e-4
        expected = np.array([simulate(model, v, r, zero) for v in values])
        # between plates forward draws straight pieces through the rows
        np.testing.assert_allclose(answers(model, z, r, zero or 0.0), expected, rtol=0,
                                   atol=(1e-9 if r.is_voltage else 1e-5) * np.nanmax(np.abs(expected)))
        seen += 1
    assert seen == (7 if model.is_black_box else 9)


def test_a_resistance_takes_what_a_low_pass_takes():
    """Hooke's stroke goes as the square of the voltage on the layers: of a bias a and a wave b it swings by 4 a b."""
    # at a tenth of the voltage the strain, and what it adds to the capacitance, is a hundredth
    low = limits_of_actuator(replace(ACTUATOR, max_voltage_V=120.0), False)
    experiment = Experiment("sine", (0.92, 0.4, 1.0, 0.3), low)
    a, resistance = ACTUATOR, 2e5
    capacitance = 8.8541878128e-12 * a.relative_permittivity * a.electrode_area_m2 / a.layer_thickness_m * a.layers
    lag = 2 * np.pi * experiment.settings["frequency_Hz"] * resistance * capacitance
    assert 1.0 < lag < 3.0
    swing = []
    for spec, more in (("hooke", {}), ("hooke+series_resistance", {"R_s_ohm": resistance})):
        model = build_model(spec)
        point = {k: np.array([v]) for k, v in {"Y_Pa": 1.2e6, **more}.items()}
        y = answers(model, model.from_prior_coordinates(model.priors.to_coordinates(point)), experiment.recording)[0]
        swing.append(np.ptp(y[-48:]))  # the last period
    assert swing[1] / swing[0] == pytest.approx(1.0 / np.hypot(1.0, lag), rel=0.01)

"""What the next experiment is expected to tell two explanations apart by."""

from types import SimpleNamespace

import numpy as np
import pytest
from bench_campaigns import ACTUATOR

from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment
from bayes_dea.experiments.menu import menu as experiments
from bayes_dea.mismatch.ask import answer, menu, next_experiment, separation
from bayes_dea.models.model import build_model

LIMITS = limits_of_actuator(ACTUATOR, True)
CREEP = Experiment("creep", (1.0, 0.2), LIMITS)
EDGES = Experiment("rectangle", (0.9, 0.4, 1.0, 0.2), LIMITS)
PLATES = Experiment("relaxation", (1.0, 0.2), LIMITS)
MATERIAL = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}


def fit(effect="", width=1e-6, **values):
    """A fit of hooke+gm1, with an effect or not, that knows its parameters to `width` (of their logarithms)."""
    model = build_model("hooke+gm1" + (f"+{effect}" if effect else ""))
    point = {**MATERIAL, **values}
    z = model.from_prior_coordinates(model.priors.to_coordinates({k: np.array([v]) for k, v in point.items()}))[0]
    noise = SimpleNamespace(sigma={"displacement": 4.7e-6, "force": 0.005},
                            rho={"displacement": (0.0,), "force": (0.0,)})
    return SimpleNamespace(problem=SimpleNamespace(model=model), q=z, noise=noise,
                           covariance=width**2 * np.eye(model.dimension))


def test_what_is_asked_for_is_of_the_menu_of_next():
    names = {e.name for e in experiments(LIMITS, "few")}
    asked = menu(ACTUATOR)
    assert {e.name for e in asked} == names
    assert {e.kind for e in asked} >= {"creep", "sine", "rectangle", "voltage", "compression", "relaxation"}
    rivals = [fit("series_resistance", R_s_ohm=3e5), fit("sensor_lag", tau_s_s=0.02)]
    told = next_experiment(rivals, ["series_resistance", "sensor_lag"], ACTUATOR)
    assert told["recording"] in [e.stated for e in asked]
    assert told["expected_information_nats"] > 10.0


@pytest.mark.parametrize("experiment", [CREEP, PLATES], ids=lambda e: e.kind)
def test_two_per_cent_is_what_the_gain_of_a_sensor_may_be(experiment):
    """Everything stiffer by one per cent is half an sd of the gain: worth an eighth of a nat, whatever the noise."""
    softer, stiffer = fit(), fit(Y_Pa=1.212e6, k_1_Pa=3.03e5)
    assert separation(softer, stiffer, experiment, ACTUATOR) == pytest.approx(0.125, rel=0.1)
    much = fit(Y_Pa=1.5e6, k_1_Pa=3.75e5)
    assert separation(softer, much, experiment, ACTUATOR) > 20.0


def test_where_the_plates_touch_is_not_known():
    base = fit()
    y = answer(base, PLATES, ACTUATOR)[0]
    moved = answer(base, PLATES, ACTUATOR, zero_m=5e-5)[0]
    assert np.abs(moved - y).max() > 100 * 0.005, "or there is nothing to be explained away"
    from bayes_dea.mismatch.ask import nuisance

    columns = np.stack([np.ones_like(y), *nuisance(base, PLATES, ACTUATOR, y)], axis=1)
    left = moved - y - columns @ np.linalg.lstsq(columns, moved - y, rcond=None)[0]
    assert np.linalg.norm(left) < 0.06 * np.linalg.norm(moved - y)


def test_plates_tell_nothing_of_electrical_effects():
    rivals = fit("series_resistance", R_s_ohm=3e5), fit("supply_dead_zone", V_dead_V=60.0)
    assert separation(*rivals, PLATES, ACTUATOR) == pytest.approx(0.0, abs=1e-6)
    assert separation(*rivals, EDGES, ACTUATOR) > 10.0


def test_a_planned_recording_has_no_temperature():
    warm = fit("thermal_expansion", alpha_T_m_per_K=3e-6)
    y, _ = answer(warm, CREEP, ACTUATOR)
    np.testing.assert_array_equal(y, answer(fit(), CREEP, ACTUATOR)[0])
    assert next_experiment([warm, fit("sensor_lag", tau_s_s=0.02)], ["thermal_expansion", "sensor_lag"],
                           ACTUATOR)["recording"]

"""How long a rest has to be: what the actuator remembers, not what the sensor adds by itself."""

import numpy as np
import pytest
from bench_campaigns import ACTUATOR

from bayes_dea.design.belief import Belief
from bayes_dea.design.rest import rest_s
from bayes_dea.experiments.commands import QUIET_S
from bayes_dea.experiments.costs import Costs
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment
from bayes_dea.models.electrostatics import stress_factor, stroke_factor
from bayes_dea.models.model import build_model

CREEP = Experiment("creep", (1.0, 0.2), limits_of_actuator(ACTUATOR, True))
LIMIT_M = 0.15e-6
VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 6e4, "tau_1_s": 5.0}


def rest(effect=None, **more):
    model = build_model("hooke+gm1" if effect is None else f"hooke+gm1+{effect}")
    values = {p.name: np.array([{**VALUES, **more}[p.name]]) for p in model.parameters}
    z = model.from_prior_coordinates(model.priors.to_coordinates(values))
    return rest_s(Belief(model.name, model, z, {}, {}), CREEP, Costs(), LIMIT_M)


def test_it_lasts_until_the_mode_has_faded():
    model = build_model("hooke+gm1")
    _, c, T = (float(np.ravel(v)[0]) for v in model.modes_of({k: np.array([VALUES[k]]) for k in model.priors.names}))
    s = CREEP.settings
    left = abs(c) * stress_factor(ACTUATOR) * s["voltage_V"] ** 2 * stroke_factor(ACTUATOR)
    left *= -np.expm1(-s["duration_s"] / T) * np.exp(-QUIET_S / T)
    expected = T * np.log(left / LIMIT_M)
    # rows of a rest lie 17 % apart
    assert expected <= rest() <= 1.2 * expected


@pytest.mark.parametrize(("effect", "values"), [
    ("sensor_drift", {"drift_m_per_s": 1e-8}),
    ("mains_pickup", {"mains_m": 5e-6, "mains_phase_rad": 0.3, "mains_Hz": 50.0}),
])
def test_what_the_sensor_adds_asks_for_no_rest(effect, values):
    assert rest(effect, **values) == rest()


def test_a_set_of_friction_does_not_fade():
    friction = {"sigma_y_Pa": 1e3, "eps_y": 0.002, "friction_elements": 64.0}
    assert rest("rate_independent_hysteresis", **friction) == Costs().longest_rest_s

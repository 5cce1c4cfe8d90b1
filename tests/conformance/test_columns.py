"""Every effect's column of the conformance set: what its name means, as numbers."""

from dataclasses import replace

import numpy as np
import pytest
from test_baseline import ACTUATOR, TAU, K, close, named, read, voltage_recording

from bayes_dea.campaign import recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_nodes, simulate_plates

BASE = named(1.2e6, K, TAU)
FRICTION = "rate_independent_hysteresis"
COLUMNS = {
    "baseline": {}, "series_resistance": {"R_s_ohm": 150e3}, "supply_current_limit": {"slew_V_per_s": 60e3},
    "one_quadrant_supply": {"tau_fall_s": 15e-3}, "supply_saturation": {"V_max_V": 900.0},
    "supply_dead_zone": {"V_dead_V": 30.0}, "series_resistance+leakage": {"R_s_ohm": 150e3, "R_leak_ohm": 40e6},
    "thickness_feedback": {}, "stretch_dependent_permittivity": {"c_eps": -1.0},
    "dielectric_absorption": {"chi": 0.03, "tau_d_s": 0.5}, "strain_stiffening": {"beta": 50.0},
    "amplitude_softening": {"dE_Pa": 0.8e6, "e_c": 8e-3},
    "rate_independent_hysteresis": {"sigma_y_Pa": 2e3, "eps_y": 2.5e-3},
    "extra_relaxation_mode": {"k_x_Pa": 80e3, "tau_x_s": 0.1},
    "fractional_relaxation": {"k_f_Pa": 15e3, "alpha_f": 0.04}, "parallel_damper": {"d0_Pa_s": 2e3},
    "mullins_softening": {"mullins_share": 0.1, "mullins_m_Pa": 30.0, "mullins_b": 0.5},
    "inertia": {"f_1_Hz": 80.0, "zeta": 0.05}, "thermal_expansion": {"alpha_T_m_per_K": 3e-6},
    "acquisition_delay": {"T_d_s": 12.3e-3}, "sensor_lag": {"tau_s_s": 8e-3},
    "sensor_nonlinearity": {"q_2_per_m": 150.0}, "sensor_drift": {"drift_m_per_s": 2e-7},
    "sensor_clipping": {"y_max_m": 160e-6},
}
#: rms and worst (m) where the set allows more than 0.02 and 0.15 um
WIDER = {"inertia": (0.1e-6, 0.5e-6), "series_resistance": (0.05e-6, 0.15e-6),
         "series_resistance+leakage": (0.05e-6, 0.15e-6)}


@pytest.fixture(scope="module")
def voltage(shared):
    return read(shared / "data" / "conformance" / "voltage.csv")


@pytest.fixture(scope="module")
def mechanical(shared):
    return read(shared / "data" / "conformance" / "mechanical.csv")


def model(column):
    return build_model("hooke+gm3" + ("" if column == "baseline" else f"+{column}"))


def test_every_column_is_tested(voltage, mechanical):
    assert set(voltage) == {"time_s", "voltage_V", "temperature_C", *COLUMNS}
    assert set(mechanical) - {"time_s", "strain"} <= set(COLUMNS)
    tested = {e for c in COLUMNS for e in c.split("+")}
    assert set(registered_effects()) - tested == {"charge_retention", "mains_pickup"}


@pytest.mark.parametrize("column", COLUMNS)
def test_voltage(voltage, column):
    recording = voltage_recording(voltage, column)
    recording = recording_from_arrays("voltage.csv", "voltage", {**recording.columns,
                                                                 "temperature_C": voltage["temperature_C"]},
                                      "identify", ACTUATOR)
    limits = WIDER.get(column, (0.02e-6, 0.15e-6))
    found = simulate(model(column), {**BASE, **COLUMNS[column]}, recording)
    plant = plant_of(model(column), {**BASE, **COLUMNS[column]}, ACTUATOR)
    if column == FRICTION:
        # of many elements SOURCE.md allows 1 um; with its own twelve the column is met like the others
        close(found, voltage[column], 1e-6, 1e-6)
        plant = replace(plant, friction_elements=12)
        found = simulate_nodes(plant, make_nodes(recording, every_row=True))
    close(found, voltage[column], *limits)
    nodes = make_nodes(recording)
    assert nodes.size < 0.7 * nodes.n
    close(simulate_nodes(plant, nodes), voltage[column][nodes.row], *limits)


@pytest.mark.parametrize("column", ["baseline", "strain_stiffening", "amplitude_softening",
                                    "rate_independent_hysteresis", "extra_relaxation_mode", "fractional_relaxation",
                                    "parallel_damper", "mullins_softening"])
def test_mechanical(mechanical, column):
    values = {**BASE, **COLUMNS[column], **({"beta": 5.0} if column == "strain_stiffening" else {})}
    recording = recording_from_arrays("mechanical.csv", "compression", {
        "time_s": mechanical["time_s"], "position_m": mechanical["strain"] * ACTUATOR.stack_height_m,
        "force_N": mechanical[column]}, "identify", ACTUATOR)
    found = simulate(model(column), values, recording)
    if column == FRICTION:
        # the file has twelve elements, the model enough for the limit of many
        plant = replace(plant_of(model(column), values, ACTUATOR), friction_elements=12)
        position = recording.columns["position_m"]
        found = simulate_plates(plant, recording.time_s, position, float(position[0]), 1)
    close(found, mechanical[column], 0.5e-3, 2e-3)


def test_columns_differ_by_more_than_the_tolerance(voltage, mechanical):
    """So that meeting one is not meeting them all."""
    for column in COLUMNS:
        if column != "baseline":
            assert np.sqrt(np.mean((voltage[column] - voltage["baseline"])**2)) > 0.1e-6
    for column in set(mechanical) - {"time_s", "strain", "baseline"}:
        assert np.sqrt(np.mean((mechanical[column] - mechanical["baseline"])**2)) > 5e-3

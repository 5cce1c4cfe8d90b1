"""The baseline columns of the conformance set: equations, areas, signs, timing and units of the contract."""

import csv

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.models.chain import Material, forces
from bayes_dea.models.electrostatics import stroke_factor, voltage_drive
from bayes_dea.models.lags import simulate_modes
from bayes_dea.models.mechanics import GM
from bayes_dea.models.model import build_model
from bayes_dea.models.networks import gm_to_gkv, maxwell_to_modes

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
K, TAU = np.array([70e3, 50e3, 60e3]), np.array([200.0, 20.0, 1.0])
FRACTIONAL_TAU = 10.0 ** np.arange(4, -4, -1)


def named(Y, k, tau, **more):
    return {"Y_Pa": Y, **{f"k_{i}_Pa": v for i, v in enumerate(k, 1)},
            **{f"tau_{i}_s": v for i, v in enumerate(tau, 1)}, **more}


def as_gkv():
    Y, k, tau = gm_to_gkv(1.2e6, K, TAU)
    return "hooke+gkv3", named(Y, k, tau)


CASES = {
    "gm3": ("baseline", "hooke+gm3", named(1.2e6, K, TAU)),
    "gkv3": ("baseline", *as_gkv()),
    "gm4": ("extra_relaxation_mode", "hooke+gm4", named(1.2e6, [*K, 80e3], [*TAU, 0.1])),
    "gkm3": ("parallel_damper", "hooke+gkm3", named(1.2e6, K, TAU, d0_Pa_s=2e3)),
}


def read(path):
    with path.open() as f:
        header = next(csv.reader(f))
    return dict(zip(header, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))


@pytest.fixture(scope="module")
def voltage(shared):
    return read(shared / "data" / "conformance" / "voltage.csv")


@pytest.fixture(scope="module")
def mechanical(shared):
    return read(shared / "data" / "conformance" / "mechanical.csv")


def voltage_recording(table, column, hold="end", V=None):
    columns = {"time_s": table["time_s"], "voltage_V": table["voltage_V"] if V is None else V,
               "displacement_m": table[column]}
    return recording_from_arrays("voltage.csv", "voltage", columns, "identify", ACTUATOR, hold=hold)


def close(found, expected, rms, worst):
    difference = found - expected
    assert np.sqrt(np.mean(difference**2)) <= rms
    assert np.abs(difference).max() <= worst


@pytest.mark.parametrize("case", CASES)
def test_voltage(voltage, case):
    column, text, values = CASES[case]
    close(simulate(build_model(text), values, voltage_recording(voltage, column)), voltage[column], 0.02e-6, 0.15e-6)


@pytest.mark.parametrize("case", CASES)
def test_mechanical(mechanical, case):
    column, text, values = CASES[case]
    recording = recording_from_arrays("mechanical.csv", "compression", {
        "time_s": mechanical["time_s"], "position_m": mechanical["strain"] * ACTUATOR.stack_height_m,
        "force_N": mechanical[column]}, "identify", ACTUATOR)
    close(simulate(build_model(text), values, recording), mechanical[column], 0.5e-3, 2e-3)


def test_columns_differ_by_more_than_the_tolerance(voltage, mechanical):
    """So that meeting one is not meeting them all."""
    for column in ("extra_relaxation_mode", "parallel_damper", "fractional_relaxation"):
        assert np.sqrt(np.mean((voltage[column] - voltage["baseline"])**2)) > 0.5e-6
        assert np.sqrt(np.mean((mechanical[column] - mechanical["baseline"])**2)) > 5e-3


def test_one_row_of_timing_is_far_outside_the_tolerance(voltage):
    late = np.concatenate([voltage["voltage_V"][:1], voltage["voltage_V"][:-1]])
    found = simulate(build_model("hooke+gm3"), CASES["gm3"][2], voltage_recording(voltage, "baseline", V=late))
    assert np.sqrt(np.mean((found - voltage["baseline"])**2)) > 1e-6


def test_fractional_spectrum_in_voltage(voltage):
    """Eight branches, a decade each, beside the three: more than a SPEC takes, not more than the network does."""
    k = np.concatenate([K, 15e3 * FRACTIONAL_TAU**-0.04])
    tau = np.concatenate([TAU, FRACTIONAL_TAU])
    merged_tau = np.unique(tau)[::-1]
    merged_k = np.array([k[tau == t].sum() for t in merged_tau])
    D, c, T = maxwell_to_modes(np.array([1.2e6]), merged_k[None], merged_tau[None], np.zeros(1))
    recording = voltage_recording(voltage, "fractional_relaxation")
    strain, _ = simulate_modes(voltage_drive(recording), D[0], c[0], T[0])
    close(strain * stroke_factor(ACTUATOR), voltage["fractional_relaxation"], 0.02e-6, 0.15e-6)


def test_fractional_spectrum_in_compression(mechanical):
    k, tau = np.concatenate([K, 15e3 * FRACTIONAL_TAU**-0.04]), np.concatenate([TAU, FRACTIONAL_TAU])
    material = Material(0, np.array([[1.2e6]]), GM, k[None], tau[None], np.zeros(1))
    position = mechanical["strain"] * ACTUATOR.stack_height_m
    found = forces(material, np.diff(mechanical["time_s"]), position, np.zeros(1), ACTUATOR, 1)[0]
    close(found, mechanical["fractional_relaxation"], 0.5e-3, 2e-3)

"""Voltage to Maxwell stress, by hand."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.errors import InputError
from bayes_dea.models.electrostatics import filled_input, require, stress_factor, stroke_factor, voltage_drive

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)


def recording(V, hold="end"):
    V = np.concatenate([V, np.zeros(10)])
    t = 0.1 * np.arange(len(V))
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 1e-6 * t}
    return recording_from_arrays("v", "voltage", columns, "identify", ACTUATOR, hold=hold)


def test_reference_actuator_at_1200_V():
    """Field 48 V/um, 57 kPa on the electrodes, two thirds of it on the section."""
    field = 1200.0 / 25e-6
    expected = 8.8541878128e-12 * 2.8 * field**2 * 7.5602e-5 / 1.1450e-4
    assert stress_factor(ACTUATOR) * 1200.0**2 == pytest.approx(expected, rel=1e-14)
    assert expected == pytest.approx(37.7e3, rel=2e-3)
    assert stroke_factor(ACTUATOR) == pytest.approx(9.975e-3)


def test_stress_is_the_square_of_the_voltage_whatever_its_sign():
    drive = voltage_drive(recording(np.array([0.0, 500.0, -500.0, 1000.0])))
    np.testing.assert_allclose(drive.stress[:4], stress_factor(ACTUATOR) * np.array([0, 25e4, 25e4, 1e6]))
    np.testing.assert_allclose(drive.dt[:4], [0, 0.1, 0.1, 0.1])


def test_linear_voltage_has_its_own_middle():
    """Half-way between -500 and 500 V there is no stress, half-way from 500 to 1000 that of 750 V."""
    drive = voltage_drive(recording(np.array([0.0, 500.0, -500.0, 500.0, 1000.0]), "linear"))
    expected = stress_factor(ACTUATOR) * np.array([250.0, 0.0, 0.0, 750.0])**2
    np.testing.assert_allclose(drive.middle[1:5], expected)


def test_a_command_that_was_not_recorded_is_held():
    V = np.array([np.nan, 100.0, np.nan, np.nan, 300.0, np.nan])
    np.testing.assert_array_equal(filled_input(V), [100, 100, 100, 100, 300, 300])
    whole = np.array([1.0, 2.0])
    assert filled_input(whole) is whole
    np.testing.assert_allclose(voltage_drive(recording(V)).stress[2:4], stress_factor(ACTUATOR) * 1e4)


def test_missing_geometry_is_named():
    with pytest.raises(InputError, match=r"a voltage recording needs layers, electrode_area_m2; write it"):
        stress_factor(Actuator(layer_thickness_m=25e-6, relative_permittivity=2.8, total_area_m2=1e-4))
    with pytest.raises(InputError, match=r"creep.csv needs stack_height_m"):
        require(Actuator(), ("stack_height_m",), "creep.csv")
    require(ACTUATOR, ("layers", "stack_height_m"), "anything")

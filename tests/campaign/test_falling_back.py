"""A stack that falls back while the voltage stands is not one whose displacement is turned round."""

import numpy as np
import pytest
from scipy.signal import lfilter

import bayes_dea as bd
from bayes_dea.campaign.plausibility import check_plausible, dominant_frequency
from bayes_dea.errors import InputError

ACTUATOR = bd.Actuator("stack", 40, 5e-5, 2.8, 4e-4, 4.5e-4, 0.02, 1e-3, 1200.0, 50.0)


def _creep(screened, sign):
    """700 V from 1 s on, for 270 s at 50 Hz; charges screen a share of the field with 20 s; a stroke of 0.1 mm."""
    t = np.arange(0.0, 271.0, 0.02)
    voltage = np.where(t >= 1.0, 700.0, 0.0)
    keep = np.exp(-0.02 / 20.0)
    field = voltage - lfilter([1.0 - keep], [1.0, -keep], screened * voltage)
    y = 1e-4 * (field / 700.0) ** 2 + 2e-6 * np.random.default_rng(5).standard_normal(t.size)
    columns = {"time_s": t, "voltage_V": voltage, "displacement_m": sign * y}
    return bd.recording_from_arrays("creep.csv", "creep", columns, "identify", ACTUATOR)


def test_a_field_that_charges_screen_is_no_wrong_sign():
    assert check_plausible(_creep(0.71, 1.0)) == []


def test_a_displacement_that_is_turned_round_is_refused():
    with pytest.raises(InputError, match="falls by about"):
        check_plausible(_creep(0.0, -1.0))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fast_wave_that_stays_above_its_rest_says_nothing_of_a_sign(sign):
    """560 +- 280 V at 10 Hz, readings late by 43 ms: it was refused, as its rest at 0 V hid how fast it is."""
    t = np.arange(0.0, 8.0, 1e-3)
    x = 1.0 - 4.0 * np.abs((10.0 * t) % 1.0 - 0.5)
    voltage = np.where(t < 0.02, 0.0, 560.0 + 280.0 * x)
    y = 1e-4 * (np.interp(t - 0.043, t, voltage) / 700.0) ** 2
    columns = {"time_s": t, "voltage_V": voltage, "displacement_m": sign * y}
    r = bd.recording_from_arrays("triangle.csv", "triangle", columns, "identify", ACTUATOR)
    assert dominant_frequency(voltage, t) == pytest.approx(10.0, rel=0.01)
    assert not any("falls by" in w for w in check_plausible(r))

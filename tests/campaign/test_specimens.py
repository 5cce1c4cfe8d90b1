"""Strokes that are compared between recordings said to be of one specimen: only those of the same swings."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, recording_from_arrays
from bayes_dea.campaign.plausibility import dominant_frequency, swings
from bayes_dea.campaign.specimens import check_specimens

SENSORS = {"displacement": Sensor(2e-6, 1e-5, 1e-7)}


def wave(name, hz, periods, tail_s, low=250.0, high=1050.0, gain=1.0, seed=0):
    """Half a second at rest, a sine between two voltages, a tail at rest; 60 um at 1000 V."""
    t = np.arange(0.0, 0.5 + periods / hz + tail_s, 1e-3)
    on = (t >= 0.5) & (t < 0.5 + periods / hz)
    v = np.where(on, 0.5 * (low + high) + 0.5 * (high - low) * np.sin(2 * np.pi * hz * (t - 0.5)), 0.0)
    y = gain * 6e-11 * v**2 + 2e-6 * np.random.default_rng(seed).standard_normal(t.size)
    columns = {"time_s": t, "voltage_V": v, "displacement_m": y}
    return recording_from_arrays(name, "sine", columns, "identify", Actuator())


@pytest.mark.parametrize("tail_s", [0.0, 3.0])
def test_the_frequency_of_a_wave_is_that_of_its_swings(tail_s):
    r = wave("a", 10.0, 29, tail_s)
    assert dominant_frequency(r.columns["voltage_V"], r.time_s) == pytest.approx(10.0, rel=0.01)
    _, first, last = swings(r.columns["voltage_V"])
    assert (r.time_s[first], r.time_s[last]) == pytest.approx((0.5, 3.4), abs=0.1)


def test_a_step_has_none():
    t = np.arange(0.0, 5.0, 1e-3)
    assert dominant_frequency(np.where(t > 1.0, 900.0, 0.0), t) == 0.0


def test_a_rest_behind_a_wave_is_no_other_frequency_and_no_smaller_stroke():
    """29 periods of 10 Hz and 3 s of rest were 4.5 Hz with a stroke of 10 um, beside a 5 Hz sine of 62 um."""
    assert check_specimens([wave("a", 5.0, 57, 1.0), wave("b", 10.0, 29, 3.0, seed=1)], SENSORS) == []
    assert check_specimens([wave("a", 5.0, 57, 0.0), wave("b", 5.0, 29, 4.0, seed=1)], SENSORS) == []


def test_waves_between_other_voltages_are_not_compared():
    assert check_specimens([wave("a", 5.0, 20, 0.0), wave("b", 5.0, 20, 0.0, low=850.0, seed=1)], SENSORS) == []


def test_another_specimen_is_still_seen():
    found = check_specimens([wave("a", 5.0, 20, 1.0), wave("b", 5.0, 30, 2.0, gain=1.8, seed=1)], SENSORS)
    assert len(found) == 1
    assert "a and b are both said to be of specimen" in found[0]

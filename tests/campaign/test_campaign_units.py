"""Units by name."""

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.campaign.columns import to_si
from bayes_dea.campaign.format_map import ColumnMap
from bayes_dea.campaign.units import conversion, suffix
from bayes_dea.errors import InputError


@pytest.mark.parametrize(("unit", "name", "value", "expected"), [
    ("kV", "voltage_V", 1.2, 1200.0), ("mm", "displacement_m", 1.0, 1e-3),
    ("um", "displacement_m", 4.0, 4e-6),
    ("\u00b5m", "displacement_m", 4.0, 4e-6), ("ms", "time_s", 5.0, 5e-3), ("min", "time_s", 2.0, 120.0),
    ("(mm)", "position_m", 1.0, 1e-3), ("inch", "position_m", 1.0, 0.0254),
    ("gf", "force_N", 1.0, 9.80665e-3), ("degF", "temperature_C", 212.0, 100.0),
    ("K", "temperature_C", 293.15, 20.0), ("C", "temperature_C", 20.0, 20.0),
    ("\u00b0C", "temperature_C", 20.0, 20.0), ("pF", "capacitance_F", 3.0, 3e-12),
    ("1165 V", "voltage_V", 2.0, 2330.0),
    ("V", "voltage_V", 3.0, 3.0),
])
def test_units(unit, name, value, expected):
    affine = conversion(unit, name)
    assert affine.slope * value + affine.shift == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(("unit", "name", "message"), [
    ("kg", "force_N", "not a unit of the same quantity.*kgf"), ("dBV!!", "voltage_V", "not known"),
    ("s", "voltage_V", "not a unit of the same quantity"), ("mm", "gauge", "ends in no SI unit"),
])
def test_wrong_units(unit, name, message):
    with pytest.raises(InputError, match=message):
        conversion(unit, name)


def test_suffix():
    assert suffix("measured_voltage_V") == "V"
    assert suffix("electrode_area_m2") == "m2"
    assert suffix("stretch") is None


def test_millimetres_keep_their_last_digit():
    raw = np.array([12.3, 0.1, 7.7])
    out = to_si(raw, ColumnMap(name="x", unit="mm"), "displacement_m", "f")
    assert out.tolist() == [0.0123, 0.0001, 0.0077]
    flipped = to_si(raw, ColumnMap(name="x", unit="mm", sign=-1, offset="first"), "displacement_m", "f")
    np.testing.assert_allclose(flipped, [0.0, 12.2e-3, 4.6e-3], atol=1e-16)
    assert raw.tolist() == [12.3, 0.1, 7.7]


@pytest.mark.parametrize(("unit", "seconds"), [("ms", 1e-3), ("us", 1e-6), ("min", 60.0), ("h", 3600.0)])
def test_times_in_another_unit_than_those_of_the_others_are_asked_about(data, unit, seconds):
    def campaign(factor, others=1.0, count=4):
        recordings = []
        for i in range(count):
            columns = data(volts=600.0 + 150.0 * i, seed=i)
            columns["time_s"] = columns["time_s"] * (factor if i == 1 else 1.0) * (others if i == 2 else 1.0)
            recordings.append(bd.recording_from_arrays(f"{i}.csv", "creep", columns, "identify", bd.Actuator("a")))
        return [w for w in bd.campaign_from_recordings(recordings).warnings if "its time step" in w]

    said = campaign(1.0 / seconds)
    assert len(said) == 1
    assert said[0].startswith("1.csv")
    assert f'unit = "{unit}"' in said[0]
    # another rate is another rate; with rates of all kinds, or few recordings, nothing can be said
    assert not campaign(1.0)
    assert not campaign(500.0)
    assert not campaign(1.0 / seconds, others=3.0)
    assert not campaign(1.0 / seconds, count=2)


@pytest.mark.parametrize(("name", "written", "times", "said"), [
    ("sine_1Hz", 1.0, 1000.0, "ms"), ("Sine 0,5 Hz", 0.5, 1000.0, "ms"), ("tri_0p5hz_b", 0.5, 1e6, "us"),
    ("sine_500mHz", 0.5, 1 / 60.0, "min"),
    ("sine_1Hz", 1.0, 1.0, ""),
    ("sine_1Hz", 1.0, 3.0, ""),  # another period than planned
    ("sine", 1.0, 1000.0, ""),
    ("log_1000Hz", 1.0, 1.0, ""),  # the sampling rate: the actuator is driven at 100 Hz at most
    ("sine_1Hzb", 1.0, 1000.0, ""),
])
def test_times_in_another_unit_than_the_frequency_in_the_name_are_asked_about(name, written, times, said):
    period_s = times / written
    time = np.linspace(0.0, 8.0 * period_s, 1601)
    voltage = 500.0 * (1.0 - np.cos(2 * np.pi * time / period_s))
    columns = {"time_s": time, "voltage_V": voltage, "displacement_m": 4e-5 * (voltage / 1e3) ** 2}
    actuator = bd.Actuator("a", max_frequency_Hz=100.0)
    recording = bd.recording_from_arrays(f"{name}.csv", "creep", columns, "identify", actuator)
    warnings = " ".join(bd.campaign_from_recordings([recording]).warnings)
    assert ("its name says" in warnings) == bool(said), warnings
    if said:
        assert f"If its times are in {said}, map them" in warnings
        assert f"its name says {written:g} Hz, its command alternates at {1 / period_s:.3g} Hz." in warnings

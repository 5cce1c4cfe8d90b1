"""What is read and not used is said: a measured voltage, with what the supply made of the command, and a payload."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, load_campaign, recording_from_arrays
from bayes_dea.campaign.unused import supplied, unused_warnings

REFERENCE = Actuator("reference", 399, 25e-6, 2.8, 7.5602e-5, 1.145e-4, 10.261e-3, max_voltage_V=1200)


def driven(measured, name="r", hold="end", actuator=REFERENCE, seed=1):
    """A sine of 1 Hz of 500 +- 500 V for 4 s at 200 Hz; measured: what of its command (n,) was measured."""
    rng = np.random.default_rng(seed)
    t = np.arange(800) / 200.0
    V = 500.0 - 500.0 * np.cos(2 * np.pi * t)
    columns = {"time_s": t, "voltage_V": V, "displacement_m": 8e-11 * V**2 + 4e-6 * rng.standard_normal(t.size)}
    if measured is not None:
        columns["measured_voltage_V"] = measured(V, rng)
    return recording_from_arrays(name, "sine", columns, actuator=actuator, hold=hold)


def test_a_supply_with_a_gain_an_offset_and_a_lag():
    """A lag by three rows is 500 V x 2 pi 1 Hz x 15 ms across the phase, of which RMS is the 1/sqrt 2."""
    found = supplied(driven(lambda V, rng: 0.98 * np.roll(V, 3) + 4.0))
    phase = 2 * np.pi * 3 / 200
    assert found.gain == pytest.approx(0.98 * np.cos(phase), rel=1e-9)
    assert found.offset_V == pytest.approx(4.0 + 490.0 * (1.0 - np.cos(phase)), rel=1e-9)
    assert found.rms_V == pytest.approx(490.0 * np.sin(phase) / np.sqrt(2), rel=1e-9)
    assert found.largest_V == 1000.0


def test_gaps_a_constant_command_and_a_command_from_its_row_on():
    def with_gaps(V, rng):
        return np.where(np.arange(V.size) % 7 == 0, np.nan, 1.01 * V)

    assert supplied(driven(with_gaps)).gain == pytest.approx(1.01, rel=1e-12)
    for late in (lambda V, rng: np.append(V[:1], V[:-1]), lambda V, rng: V):
        assert supplied(driven(late, hold="start")).rms_V == pytest.approx(0.0, abs=1e-9)
    t = np.arange(20.0)
    held = {"time_s": t, "voltage_V": np.full(20, 800.0), "displacement_m": 1e-9 * t, "measured_voltage_V": 790.0 + t}
    found = supplied(recording_from_arrays("h", "voltage", held))
    assert (found.gain, found.offset_V) == (1.0, pytest.approx(-0.5))


@pytest.mark.parametrize(("sensor", "measured", "said"), [
    (Sensor(1.0, 5.0), lambda V, rng: V + rng.standard_normal(V.size), "agrees with the command within"),
    (Sensor(1.0, 5.0), lambda V, rng: 0.99 * V, r"more than [sensor.voltage] states: gain 0.99 (b)"),
    (Sensor(1.0, 5.0), lambda V, rng: V + 3.0 * rng.standard_normal(V.size), "V RMS (b). The supply does something"),
    (Sensor(accuracy=20.0), lambda V, rng: 0.99 * V, "agrees with the command within"),
    (None, lambda V, rng: 0.99 * V, "states nothing to judge it by; it differs from the command by gain 0.99 (b)"),
])
def test_by_how_much_it_differs_is_said_where_it_is_more_than_stated(sensor, measured, said):
    recordings = [driven(lambda V, rng: V + 0.5, "a"), driven(measured, "b", seed=2), driven(None, "c", seed=3)]
    (line,) = unused_warnings(recordings, {} if sensor is None else {"voltage": sensor})
    assert line.startswith("measured_voltage_V (a, b) was read, but drives no model, and diagnose alone looks at it: ")
    assert said in line


def test_a_payload_is_said_with_its_weight():
    loaded = driven(None, "b", actuator=replace(REFERENCE, payload_kg=0.1))
    campaign = campaign_from_recordings([driven(None, "a", seed=2), loaded], {"displacement": Sensor(4e-6)})
    (line,) = [w for w in campaign.warnings if "payload" in w]
    # 0.981 N on 1.145e-4 m^2
    assert line.startswith("payload_kg = 0.1 (b) is not used by any model. Its weight (0.981 N, 8.57 kPa ")
    assert unused_warnings([driven(None)], {}) == []


def test_the_remedy_that_is_named_works(folder, as_csv, data):
    columns = data()
    columns["measured_voltage_V"] = 0.97 * columns["voltage_V"]
    recording = '[[recording]]\nfile = "creep.csv"\nkind = "creep"\n'
    files = {"creep.csv": as_csv(columns)}
    (line,) = load_campaign(folder(recording, files)).warnings
    assert 'set columns.voltage_V = "measured_voltage_V" in [format] and hold = "linear"' in line
    mapped = 'hold = "linear"\nformat.columns.voltage_V = "measured_voltage_V"\n'
    campaign = load_campaign(folder(recording + mapped, files, name="mapped"))
    np.testing.assert_allclose(campaign.recordings[0].columns["voltage_V"], columns["measured_voltage_V"], rtol=1e-8)
    assert campaign.warnings == ()

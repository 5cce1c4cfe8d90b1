"""Campaigns from arrays run the same checks as those from files."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.errors import InputError

REFERENCE = Actuator("reference", 399, 25e-6, 2.8, 7.5602e-5, 1.1450e-4, 10.261e-3, max_voltage_V=1200.0)


def test_arrays_become_a_campaign(data):
    columns = data()
    first = recording_from_arrays("a", "creep", columns, actuator=REFERENCE)
    second = recording_from_arrays("b", "creep", data(seed=2), "validate", REFERENCE, specimen="B",
                                   hold="start")
    campaign = campaign_from_recordings([first, second], {"displacement": Sensor(4.7e-6)}, name="mine")
    assert campaign.actuator == REFERENCE
    assert campaign.conventions["hold"] == "end"
    assert [r.name for r in campaign.select("validate")] == ["b"]
    columns["time_s"][0] = -99.0  # the caller's array is its own
    assert first.time_s[0] == 0.0
    assert not first.time_s.flags.writeable
    assert campaign.warnings == ()


def test_lists_and_views_are_copied(data):
    matrix = np.stack(list(data().values()), axis=1)
    r = recording_from_arrays("a", "creep", {"time_s": list(matrix[:, 0]), "voltage_V": matrix[:, 1],
                                             "displacement_m": matrix[:, 2]})
    before = r.columns["voltage_V"].copy()
    matrix[:] = 0.0
    np.testing.assert_array_equal(r.columns["voltage_V"], before)


@pytest.mark.parametrize(("change", "message"), [
    ({"voltage_V": None}, "column voltage_V is missing"),
    ({"voltage_V": np.zeros(5)}, "different lengths"),
    ({"voltage_V": np.zeros((200, 1))}, "one-dimensional"),
    ({"voltage_V": ["x"] * 200}, "not made of numbers"),
    ({"time_s": np.zeros(200)}, "repeats 0 s"),
])
def test_bad_arrays(data, change, message):
    columns = {k: v for k, v in (data() | change).items() if v is not None}
    with pytest.raises(InputError, match=message):
        recording_from_arrays("a", "creep", columns)


def test_bad_campaigns(data):
    with pytest.raises(InputError, match="no recording"):
        campaign_from_recordings([])
    one = recording_from_arrays("a", "creep", data(), actuator=REFERENCE)
    with pytest.raises(InputError, match='called "a"'):
        campaign_from_recordings([one, one])
    with pytest.raises(InputError, match="hold the same numbers"):
        campaign_from_recordings([one, recording_from_arrays("b", "creep", data(), actuator=REFERENCE)])
    volts = data() | {"voltage_V": data()["voltage_V"] / 1000}
    with pytest.raises(InputError, match="kV"):
        campaign_from_recordings([recording_from_arrays("a", "creep", volts, actuator=REFERENCE)])
    with pytest.raises(InputError, match="role = 'fit' is not known"):
        recording_from_arrays("a", "creep", data(), "fit")


def test_capacitance_needs_no_time():
    x = np.linspace(0, 1e-4, 6)
    r = recording_from_arrays("c", "capacitance", {"displacement_m": x, "capacitance_F": 4e-9 * (1 + x)})
    assert (r.n, r.output) == (6, "capacitance_F")
    assert len(campaign_from_recordings([r]).recordings) == 1


def test_memory_of_specimens(data):
    late = recording_from_arrays("b", "creep", data(seed=2), rested=False, rest_before_s=60.0,
                                 actuator=REFERENCE)
    first = recording_from_arrays("a", "creep", data(), actuator=REFERENCE)
    known = campaign_from_recordings([first, late])
    assert known.recordings[1].rest_before_s == 60.0
    assert not any("rested = false" in w for w in known.warnings)
    unsaid = recording_from_arrays("c", "creep", data(seed=3), rested=False, actuator=REFERENCE)
    (said,) = [w for w in campaign_from_recordings([first, late, unsaid]).warnings if "rested = false" in w]
    assert said.startswith("c: rested = false without rest_before_s is taken as no rest at all")
    with pytest.raises(InputError, match="stands above it"):
        campaign_from_recordings([late, first])

"""A reading that never changes while the drive moves: refused where nothing else was measured, or could be."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.errors import InputError

STACK = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8, stack_height_m=10.261e-3,
                 total_area_m2=1.145e-4)
T = np.arange(0.0, 4.0, 4e-3)


def sine(name, displacement, volts=1000.0, actuator=STACK, kind="sine"):
    v = volts * np.sin(np.pi * T) ** 2
    out = "force_N" if kind == "blocked_force" else "displacement_m"
    return recording_from_arrays(name, kind, {"time_s": T, "voltage_V": v, out: displacement + 0.0 * T},
                                 actuator=actuator)


def moving(seed=0):
    return 1e-4 * np.sin(np.pi * T) ** 4 + 1e-6 * np.random.default_rng(seed).standard_normal(T.size)


def test_nothing_was_measured():
    """Without geometry nothing is expected, but where no recording moves, nothing was measured."""
    dead = [sine("a", 0.0, actuator=Actuator()), sine("b", 2e-6, actuator=Actuator())]
    with pytest.raises(InputError, match=r"a, b: displacement_m never changes \(it stays at 0\) while voltage_V moves"):
        campaign_from_recordings(dead)
    warned = campaign_from_recordings(dead, conventions={"plausibility": "warn"}).warnings
    assert any("is the sensor connected" in w for w in warned)


def test_one_among_several():
    """1000 V make 0.4 mm here; beside live recordings the dead one is refused where the sensor must have seen that."""
    several = [sine("a", moving()), sine("dead", 0.0)]
    with pytest.raises(InputError, match=r"dead: displacement_m never changes .* where about 0\.0004 m are expected"):
        campaign_from_recordings(several, {"displacement": Sensor(resolution=1.5e-7)})


def test_a_small_drive_on_a_coarse_sensor_is_warned_of():
    """10 V make 40 nm by the yardstick; a resolution step of 0.15 um sees nothing of it."""
    found = campaign_from_recordings([sine("a", moving()), sine("small", 0.0, volts=10.0)],
                                     {"displacement": Sensor(resolution=1.5e-7)})
    assert any("small: displacement_m never changes" in w for w in found.warnings)


def test_readings_at_rest_only_are_no_dead_sensor():
    y = np.where(T < 0.02, 0.0, np.nan)
    found = campaign_from_recordings([sine("a", moving()), sine("rest", y)], {"displacement": Sensor(resolution=1e-4)})
    assert any("rest: displacement_m never changes" in w for w in found.warnings)


def test_dead_force_sensors():
    x = 1e-3 * np.sin(np.pi * T / 8.0)
    press = recording_from_arrays("press", "compression", {"time_s": T, "position_m": x, "force_N": 0.0 * T},
                                  actuator=STACK)
    with pytest.raises(InputError, match=r"press: force_N never changes .* while position_m moves"):
        campaign_from_recordings([press, sine("a", moving())])
    with pytest.raises(InputError, match=r"hold: force_N never changes \(it stays at 0\.3\) while voltage_V moves"):
        campaign_from_recordings([sine("hold", 0.3, kind="blocked_force")])

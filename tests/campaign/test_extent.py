"""How far a recording went: the size of its input, whatever its sign."""

import numpy as np
import pytest
from calibrations_by_hand import ACTUATOR, made

import bayes_dea as bd
from bayes_dea.campaign.extent import extent
from bayes_dea.campaign.schema import Actuator, Recording
from bayes_dea.prediction.limits import seen_by, warnings_of
from bayes_dea.prediction.signal import Signal
from bayes_dea.reuse import seen


def test_a_film_is_pulled_to_negative_positions():
    t = np.linspace(0.0, 20.0, 2001)
    pulled = -1.7e-3 * np.sin(np.pi * t / 20.0) + 7e-7  # the sensor's zero is a little off
    known = extent(t, pulled, "position_m")
    assert known["smallest_position_m"] == pytest.approx(-1.7e-3, rel=1e-3)
    assert known["largest_position_m"] == pytest.approx(1.7e-3, rel=1e-3)
    assert warnings_of(Signal("s", "position_m", t, 0.5 * pulled), ACTUATOR, known, "out") == []
    beyond = warnings_of(Signal("s", "position_m", t, 2.0 * pulled), ACTUATOR, known, "out")
    assert len(beyond) == 1
    assert "reaches 0.0033986 m, the recordings that were fitted 0.0016993 m" in beyond[0]


@pytest.mark.parametrize("stored", [0.0, 1000.0])  # the largest value with its sign, as older calibrations hold it
def test_a_command_below_zero_is_a_command(stored):
    c = made("hooke+gm1", n=3, actuator=Actuator(**{**vars(ACTUATOR), "max_voltage_V": None, "max_frequency_Hz": None}))
    t = np.arange(1000) * 0.01
    columns = {"time_s": t, "voltage_V": np.where(t > 1, -1000.0, 0.0)}
    went = seen(Recording("r", None, "creep", "identify", columns, ACTUATOR))
    assert went["largest_voltage_V"] == 1000.0
    entry = {"seen": {**went, "largest_voltage_V": stored}}
    assert seen_by([entry])["largest_voltage_V"] == 1000.0
    c.summary["recordings"][0].update(entry)
    p = bd.command_for(c, {"time_s": t, "displacement_m": np.where(t > 1, 1e-3, 0.0)}, draws=3)
    assert p.values.max() == pytest.approx(1000.0)
    assert any("stays below 1000 V" in w for w in p.warnings)

"""The menu keeps within the limits; commands say what they should; costs are read."""

import numpy as np
import pytest

from bayes_dea.campaign.schema import Actuator
from bayes_dea.errors import InputError
from bayes_dea.experiments.commands import QUIET_S
from bayes_dea.experiments.costs import Costs, costs_toml, read_costs
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment, menu

ACTUATOR = Actuator("stack", 399, 25e-6, 2.8, 7.56e-5, 1.145e-4, 10.261e-3, max_voltage_V=1100.0, max_frequency_Hz=60.0)
LIMITS = limits_of_actuator(ACTUATOR, True)
MENU = menu(LIMITS)


def test_the_menu_is_long_and_has_every_pattern():
    assert 150 <= len(MENU) <= 260
    assert {e.pattern for e in MENU} == {"creep", "staircase", "sine", "triangle", "rectangle", "chirp",
                                         "repeat after a high step", "compression", "relaxation"}
    assert min(e.settings["amplitude_V"] / e.settings["voltage_V"] for e in MENU if e.pattern == "sine") < 0.1
    assert len({e.name for e in MENU}) == len(MENU), "every one has a file name of its own"


@pytest.mark.parametrize("corner", [0.0, 0.37, 1.0])
@pytest.mark.parametrize("pattern", sorted({e.pattern for e in MENU}))
def test_limits_hold_in_every_corner_of_the_settings(pattern, corner):
    point = next(e.point for e in MENU if e.pattern == pattern)
    e = Experiment(pattern, (corner,) * len(point), LIMITS)
    t, v = e.full()
    assert np.all(np.diff(t) > 0)
    assert t[0] == 0.0
    assert v.min() >= 0.0
    assert v[0] == 0.0
    if e.column == "voltage_V":
        assert v.max() <= 1100.0
        assert v[-1] == 0.0
        assert np.all(v[t < QUIET_S - 0.01] == 0.0)
    else:
        assert v.max() <= LIMITS.stroke_m * (1 + 1e-9)
    assert e.settings.get("frequency_Hz", 0.0) <= 60.0
    assert e.settings.get("end_frequency_Hz", 0.0) <= 60.0
    assert t[-1] == pytest.approx(e.duration_s, rel=0.02, abs=0.6)
    r = e.rows
    assert np.all(np.diff(r.time_s) > 0)
    assert r.values.max() <= v.max() * (1 + 1e-9)
    # rows stand for all readings
    assert r.readings.sum() == pytest.approx(e.duration_s * LIMITS.rate_Hz(e.column), rel=0.1)


def test_rows_have_the_mean_square_of_the_command():
    """What drives the actuator is the square of the voltage: few rows must carry as much of it as the whole."""
    for e in MENU:
        if e.column != "voltage_V":
            continue
        t, v = e.full()
        whole = np.sum(np.diff(t) * v[1:] ** 2)
        r = e.rows
        assert np.sum(np.diff(r.time_s) * r.values[1:] ** 2) == pytest.approx(whole, rel=0.04), e.name


def test_without_plates_nothing_is_pressed():
    assert not {e.kind for e in menu(limits_of_actuator(ACTUATOR, False))} & {"compression", "relaxation"}


def test_costs_can_be_edited_and_read_again(tmp_path):
    path = tmp_path / "costs.toml"
    path.write_text(costs_toml(Costs(setup_voltage_s=7.0, rest_s=-1.0)))
    assert read_costs(path) == Costs(setup_voltage_s=7.0)
    path.write_text("longest_rest_s = 60")
    assert read_costs(path).longest_rest_s == 60.0


@pytest.mark.parametrize(("text", "named"), [("setup = 3", "setup"), ("setup_voltage_s = -1", "setup_voltage_s"),
                                             ("setup_plates_s = 'long'", "setup_plates_s"), ("a = = 1", "no TOML")])
def test_costs_that_cannot_be_are_named(tmp_path, text, named):
    path = tmp_path / "costs.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        read_costs(path)


def test_costs_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_costs(tmp_path / "none.toml")

"""Commands for a wanted stroke of models with effects: the whole chain, simulated, follows the wish."""

import numpy as np
import pytest
from calibrations_by_hand import ACTUATOR, made

import bayes_dea as bd
from bayes_dea.campaign.schema import Recording
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.plant import Plant
from bayes_dea.models.supply_kernel import supply
from bayes_dea.prediction.inverse import Limits
from bayes_dea.prediction.inverse_plant import invert_plant
from bayes_dea.report.prediction_page import sentence

T = np.arange(600) * 0.005
#: a rise and a slow wave on it, from rest (m)
WISH = 2e-5 * np.clip(T - 0.5, 0, 1) * (1 + 0.4 * np.sin(2 * np.pi * T))
OF_THE_STROKE = [n for n, e in registered_effects().items() if e.stage != "sensor" and n != "thermal_expansion"]


def mean_by_forward(c, command, hold):
    r = Recording("r", None, "voltage", "validate", {"time_s": T, "voltage_V": command}, ACTUATOR, hold=hold)
    physical = c.structure.model.physical(c.coordinates("A", np.arange(len(c.draws))))
    values = [{k: float(v[i]) for k, v in physical.items()} for i in range(len(c.draws))]
    return np.mean([bd.simulate(c.structure.model, v, r) for v in values], axis=0)


@pytest.mark.parametrize("text", [*(f"hooke+gm1+{name}" for name in OF_THE_STROKE), "yeoh+gm1+strain_stiffening",
                                  "hooke+gkm1+series_resistance", "hooke+gm1+leakage+supply_dead_zone"])  # fmt: skip
@pytest.mark.parametrize("hold", ["end", "start"])
def test_the_whole_chain_follows_the_wish(text, hold):
    c = made(text, n=3, hold=hold)
    p = bd.command_for(c, {"time_s": T, "displacement_m": WISH}, draws=3)
    simulated = mean_by_forward(c, p.values, hold)
    np.testing.assert_allclose(simulated, p.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(simulated, WISH, rtol=0, atol=1.5e-7)  # the resolution of the sensor
    assert p.unmet == ()
    plain = p.summary["wanted"]["met_to_m"] == 1e-9  # lags of V^2 alone
    assert ("everywhere, to 1.00\u00a0nm" if plain else "everywhere, to 150\u00a0nm") in sentence(p.summary)
    assert p.values.min() >= 0
    assert p.values.max() > 200


def test_a_wish_beyond_a_resistance_is_said_to_be_missed():
    """A step cannot be met at once behind 10 ms, however high the command; it is met as soon as may be."""
    c = made("hooke+gm1+series_resistance", n=3, sd=0.0)
    model = c.structure.model
    x = model.to_prior_coordinates(c.structure.map[None, : model.dimension])
    capacitance = 399 * 8.8541878128e-12 * 2.8 * 7.5602e-5 / 25e-6
    x[:, model.priors.names.index("R_s_ohm")] = np.log(0.010 / capacitance)
    c.structure.map[: model.dimension] = model.from_prior_coordinates(x)
    c.draws[:] = c.structure.map
    p = bd.command_for(c, {"time_s": T, "displacement_m": np.where(T > 1, 5e-5, 0.0)}, draws=3)
    first = int(np.argmax(T > 1))
    assert p.values[first] == 1200.0
    assert p.unmet[0].t_start_s == T[first]
    assert p.unmet[0].t_end_s < T[first] + 0.03
    late = first + 6
    np.testing.assert_allclose(p.mean[late:], 5e-5, rtol=0, atol=1.5e-7)


def test_what_the_sensor_does_is_not_made_up_for_but_said():
    plain, late = (made(text, n=3, sd=0.0) for text in ("hooke+gm1", "hooke+gm1+acquisition_delay"))
    ours, theirs = (bd.command_for(c, {"time_s": T, "displacement_m": WISH}, draws=3) for c in (plain, late))
    np.testing.assert_allclose(theirs.values, ours.values, rtol=0, atol=1e-9)
    assert theirs.unmet == ()
    delay = float(late.structure.model.physical(late.coordinates("A"))["T_d_s"][0])
    shown = np.interp(T - delay, T, WISH)
    np.testing.assert_allclose(theirs.mean, shown, rtol=0, atol=1e-9)
    away = f"differs from that stroke by up to {1e6 * np.max(np.abs(shown - WISH)):.3g} um"
    assert sum("acquisition_delay" in w and away in w for w in theirs.warnings) == 1
    assert not any("reading alone" in w for w in ours.warnings)
    assert "shown with acquisition_delay" in theirs.summary["bands"]["displacement_qNN_m"]


@pytest.mark.parametrize("name", ["series_resistance", "parallel_damper", "inertia", "one_quadrant_supply"])
def test_lines_from_row_to_row_would_ring_behind_a_lag(name):
    with pytest.raises(bd.InputError, match="take hold = 'end' for the command"):
        bd.command_for(made(f"hooke+gm1+{name}", n=2, hold="linear"), {"time_s": T, "displacement_m": WISH}, draws=2)


def test_a_supply_goes_on_from_where_it_was():
    """Two calls for two steps give what one call for both gives."""
    step, room = np.array([[0.01, 0.01], [900.0, 100.0], [900.0, 100.0]]), np.empty((3, 99))
    last, rows = np.empty(2, np.int64), np.ones(2, np.int64)
    limits = (20.0, 800.0, 2e5, 0.02)
    many = supply(*step, rows, *limits, *room, last)
    whole = room[:, :many].copy()
    first = supply(*step[:, :1].copy(), rows[:1], *limits, *room, last)
    v = room[2, first - 1]
    rest = supply(*step[:, 1:].copy(), rows[:1], *limits, *room, last, v)
    np.testing.assert_allclose(room[:, :rest], whole[:, first:], rtol=1e-14)


def test_the_voltage_of_a_row_by_hand():
    """A spring of 1 MPa behind a dead zone of 50 V: strain = f (V - 50)^2/Y."""
    plant = Plant(law=np.array([1e6, 0, 0, 0, 0, 0.0]), Y_Pa=1e6, factor=0.02, stroke_m=0.01, V_dead_V=50.0)
    t = np.arange(4) * 0.1
    wish = np.array([0.0, 0.005, 0.0002, 0.1])
    found = invert_plant(plant, t, np.append(0.0, np.diff(t)), False, wish, Limits(1000.0, 0.0))
    np.testing.assert_allclose(found.voltage, [0.0, 550.0, 150.0, 1000.0], atol=1e-3)
    assert list(found.flag) == [0, 0, 0, 1]

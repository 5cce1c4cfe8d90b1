"""Slow commands in few steps: what is left of the rows, and that no answer notices."""

from dataclasses import replace

import numpy as np
import pytest
from effect_reference import ACTUATOR, BASE, held

from bayes_dea.assemble import assemble
from bayes_dea.campaign import Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.likelihood.plant_group import Reading, enough_for, is_fine, smooth
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes, past_nodes, rough_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.plant_kernel import drive_voltage
from bayes_dea.models.plant_layout import P_WHOLE, X_TRIED
from bayes_dea.models.simulate_plant import simulate_nodes
from bayes_dea.models.slow_lines import bend, corners, turns

UM = 1e-6
SENSOR = Sensor(fluctuation=1e-6, accuracy=5e-6, resolution=1e-8)
T = np.arange(24_000) * 1e-3
PHASE = 0.1 * np.clip(T - 0.5, 0, None) % 1.0
SINE = np.where(T > 0.5, 650 + 400 * np.sin(2 * np.pi * PHASE), 0.0)
TRIANGLE = np.where(T > 0.5, 650 + 400 * (1 - 4 * np.abs((PHASE + 0.25) % 1.0 - 0.5)), 0.0)
ROUGH = ("mains_pickup", "sensor_clipping", "supply_saturation", "inertia")
SMOOTH = [name for name, effect in registered_effects().items() if "voltage" in effect.acts_on
          and name not in ROUGH]


def recording(volts, hold="end"):
    columns = {"time_s": T, "voltage_V": volts, "displacement_m": 0 * T, "temperature_C": 20 + 0.1 * T}
    return recording_from_arrays("slow.csv", "voltage", columns, "identify", ACTUATOR, hold=hold)


def corners_of(volts):
    return corners(volts, bend(volts))


def at_rows(nodes, y):
    """As readings are compared: smooth between the corners and turns of few nodes, straight between all of them."""
    if nodes.corners is None:
        return np.interp(np.arange(nodes.n), nodes.row, y)
    at, weights = smooth(nodes, T, np.arange(nodes.n))
    return np.sum(weights * y[at], axis=0)


def plants(name, n=3, **more):
    m = build_model(f"hooke+gm3{'+' if name else ''}{name}")
    draws = m.priors.to_physical(m.priors.draw(n, np.random.default_rng(11)))
    for i in range(n):
        yield replace(plant_of(m, {**{k: float(v[i]) for k, v in draws.items()}, **BASE}, ACTUATOR), **more)


@pytest.mark.parametrize("volts", [SINE, TRIANGLE], ids=["sine", "triangle"])
@pytest.mark.parametrize("name", ["", *SMOOTH, "supply_current_limit+leakage", "one_quadrant_supply+series_resistance"])
def test_few_nodes_know_what_all_know(name, volts):
    r = recording(volts)
    full, few = make_nodes(r), make_nodes(r, lines=True)
    assert few.size < 0.2 * full.size
    for plant in plants(name):
        assert plant.is_smooth
        y, x = simulate_nodes(plant, full), simulate_nodes(plant, few)
        gap = at_rows(few, x) - at_rows(full, y)
        # of 200 um; what comes late sees a staircase, and a delay is read off where it is straight between nodes; what
        # softens has corners where a maximum is passed again, somewhere on a line: over one of 0.8 % of the command
        # (`FINE`) 3.5 um are moved, and a slope that changes there by a fifth is missed by a quarter of that
        largest, mean = (0.008, 0.002) if plant.is_unhurried else (0.05, 0.015)
        largest = 0.2 if plant.mullins_share > 0.0 else largest
        assert np.abs(gap).max() < largest * UM
        assert np.sqrt(np.mean(gap**2)) < mean * UM


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
@pytest.mark.parametrize("volts", [SINE, TRIANGLE], ids=["sine", "triangle"])
def test_a_model_without_effects_is_known_to_a_third_of_a_nanometre(volts, hold):
    """Of 220 um: with a sensor of 50 nm at 60,000 rows 0.3 nm are a nat. Read straight the sine was out by 5.6 nm, 380
    nats, the triangle by 2.1, 54 nats."""
    r = recording(volts, hold)
    full, few = make_nodes(r), make_nodes(r, lines=True)
    assert few.size < 0.2 * full.size
    (plant,) = plants("", 1)
    gap = at_rows(few, simulate_nodes(plant, few)) - at_rows(full, simulate_nodes(plant, full))
    assert np.sqrt(np.mean(gap**2)) < 0.3e-9
    assert np.abs(gap).max() < 2e-9


@pytest.mark.parametrize("early_s", [0.00098, 0.002])
@pytest.mark.parametrize("volts", [SINE, TRIANGLE], ids=["sine", "triangle"])
def test_readings_that_lead_their_command(volts, early_s):
    """A corner shows before the row that commands it: of a wave's end at 0 V half a stroke, over a whole group of rows.

    What leads by more is worked out at every row.
    """
    ended = np.where(T < 20.3, volts, 0.0)
    r = recording(ended)
    full, few = make_nodes(r), make_nodes(r, lines=True)
    assert few.size < 0.25 * full.size
    for plant in plants("acquisition_delay", T_d_s=-early_s):
        assert plant.is_smooth
        gap = at_rows(few, simulate_nodes(plant, few)) - at_rows(full, simulate_nodes(plant, full))
        assert np.abs(gap).max() < 0.02 * UM
        assert np.sqrt(np.mean(gap**2)) < 0.006 * UM
        all_rows, some = Reading(full, None), Reading(few, None)
        assert enough_for(plant, all_rows, some, fine=False) is some
        assert enough_for(replace(plant, T_d_s=-0.0021), all_rows, some, fine=False) is all_rows


@pytest.mark.parametrize("hold", ["start", "linear"])
def test_other_holds(hold):
    r = recording(SINE, hold)
    full, few = make_nodes(r), make_nodes(r, lines=True)
    assert few.size < 0.2 * full.size
    for plant in plants("series_resistance"):
        gap = at_rows(few, simulate_nodes(plant, few)) - at_rows(full, simulate_nodes(plant, full))
        assert np.abs(gap).max() < 0.03 * UM


def test_a_spring_answers_the_staircase_and_not_the_line():
    r = recording(SINE)
    few = make_nodes(r, lines=True)
    (plant,) = plants("", 1, branches=[])
    y = simulate_nodes(plant, few)
    read = np.delete(np.arange(few.size), few.unread)
    expected = plant.stroke_m * plant.factor * SINE[few.row] ** 2 / plant.Y_Pa
    np.testing.assert_allclose(y[read], expected[read], rtol=1e-12, atol=1e-18)
    # the line is half a row ahead where the rest of it is left to the neighbours
    assert few.unread.size > 500
    assert np.abs(few.command()[1, few.unread] - SINE[few.row[few.unread]]).max() > 0.1
    np.testing.assert_allclose(y, expected, atol=0.02 * UM)


def test_rows_after_jumps_and_kinks_stay():
    for volts, edge, every in ((SINE, 501, 300), (TRIANGLE, 3001, 100)):
        rows = make_nodes(recording(volts), lines=True).row
        assert set(range(edge, edge + every)) <= set(rows.tolist())
        assert {0, T.size - 1} <= set(rows.tolist())


def test_lines_have_the_mean_of_their_rows():
    few = make_nodes(recording(SINE), lines=True)
    start, end = few.command()
    whole = np.add.reduceat(SINE[1:], few.row[:-1])  # rows a + 1 to b of each interval
    np.testing.assert_allclose(0.5 * (start + end)[1:] * np.diff(few.row), whole, rtol=1e-9)


def test_what_is_not_slow_stays_as_it_is():
    rng = np.random.default_rng(2)
    for volts in (SINE + rng.normal(0, 1.0, T.size), 650 + 400 * np.sin(2 * np.pi * 10 * T), np.zeros(T.size)):
        r = recording(volts)
        full, few = make_nodes(r), make_nodes(r, lines=True)
        np.testing.assert_array_equal(full.row, few.row)
        assert few.lines_V is None
    np.testing.assert_array_equal(make_nodes(held(), lines=True).row, make_nodes(held()).row)


def test_a_past_in_few_nodes_ends_alike():
    r = recording(SINE)
    last = replace(held(), rest_before_s=5.0)
    nodes = make_nodes(last)
    for plant in plants("rate_independent_hysteresis", 2):
        full = simulate_nodes(plant, nodes, past_nodes([r], last))
        few = simulate_nodes(plant, nodes, past_nodes([r], last, lines=True))
        assert past_nodes([r], last, lines=True).size < 0.3 * past_nodes([r], last).size
        assert np.abs(full - few).max() < 0.02 * UM


@pytest.mark.parametrize("volts", [SINE, TRIANGLE], ids=["sine", "triangle"])
@pytest.mark.parametrize("name", ["inertia", "inertia+series_resistance", "inertia+rate_independent_hysteresis"])
def test_a_quick_mass_hardly_rings_along_lines(name, volts):
    r = recording(volts)
    full, few = make_nodes(r), make_nodes(r, lines=True)
    for f_1_Hz, zeta in ((101.0, 0.05), (101.0, 0.3), (390.0, 0.0135), (390.0, 0.3)):
        (plant,) = plants(name, 1, f_1_Hz=f_1_Hz, zeta=zeta)
        assert plant.is_smooth
        gap = at_rows(few, simulate_nodes(plant, few)) - at_rows(full, simulate_nodes(plant, full))
        assert np.abs(gap).max() < 0.05 * UM
        assert np.sqrt(np.mean(gap**2)) < 0.015 * UM


def test_limits_corners_and_ringing_need_every_row():
    for name in ROUGH:
        assert not any(p.is_smooth for p in plants(name, **({"f_1_Hz": 99.0} if name == "inertia" else {})))
    assert not any(p.is_smooth for p in plants("inertia", f_1_Hz=390.0, zeta=0.0125))


def test_corners_are_where_a_command_bends_far_more_than_beside():
    jump, kink = 501, np.flatnonzero(np.abs(np.diff(TRIANGLE, 2)) > 0.2)[2:] + 1
    assert corners_of(np.where(T > 0.5, 800.0, 0.0)).tolist() == [jump - 1, jump]
    found = corners_of(TRIANGLE)
    assert set(kink.tolist()) <= set(found.tolist())
    assert found.size <= kink.size + 3
    # a quick sine bends as much at every row as a slow triangle does at its kinks
    quick = 650 + 400 * np.sin(2 * np.pi * 8.0 * T)
    assert np.abs(np.diff(quick, 2)).max() > 3 * np.abs(np.diff(TRIANGLE, 2)[3000:3004]).max()
    assert corners_of(quick).size == 0


def test_a_kink_between_two_rows_is_a_corner_at_both():
    for share in (0.2, 0.5, 0.8):
        t = np.arange(4000) - 2000.0 - share
        found = corners_of(1000.0 - 0.2 * np.abs(t))
        assert {2000, 2001} <= set(found.tolist())
        assert found.size <= 4


def test_turns_are_where_a_command_begins_ends_or_goes_back():
    volts = np.concatenate([np.zeros(5), np.arange(1.0, 6.0), np.full(4, 5.0), np.arange(4.0, 0.0, -1.0)])
    assert turns(volts).tolist() == [4, 9, 13]
    assert turns(np.array([0.0, 1.0, 2.0, 1.0, 0.0])).tolist() == [2]


def test_what_comes_late_takes_every_row_where_readings_are_fine():
    every, few = Reading(make_nodes(recording(SINE)), None), Reading(make_nodes(recording(SINE), lines=True), None)
    (slow,), (late,), (cut,) = plants("", 1), plants("series_resistance", 1), plants("supply_saturation", 1)
    assert [enough_for(slow, every, few, fine) for fine in (False, True)] == [few, few]
    assert [enough_for(late, every, few, fine) for fine in (False, True)] == [few, every]
    assert [enough_for(cut, every, few, fine) for fine in (False, True)] == [every, every]
    assert enough_for(slow, every, None, True) is every


@pytest.mark.parametrize(("sd", "fine"), [(2e-6, False), (5e-8, True)])
def test_readings_are_fine_where_they_would_show_what_lines_miss(sd, fine):
    columns = {"time_s": T, "voltage_V": SINE, "displacement_m": 2e-4 * (SINE / 1050.0) ** 2}
    columns["displacement_m"] = columns["displacement_m"] + sd * np.random.default_rng(3).standard_normal(T.size)
    r = recording_from_arrays("slow.csv", "voltage", columns, "identify", ACTUATOR)
    (p,) = assemble(campaign_from_recordings([r], {"displacement": SENSOR}), build_model("hooke+gm1")).prepared
    assert is_fine(p) == fine


def test_rough_nodes_are_few_also_where_a_command_is_quick():
    quick = 650 + 400 * np.sin(2 * np.pi * 8.0 * T)
    r = recording(np.where(T > 0.5, quick, 0.0))
    # a change of 2 % from row to row leaves no room
    assert make_nodes(r, lines=True).size == make_nodes(r).size
    rough = rough_nodes(r)
    assert rough.size < 0.55 * T.size
    assert make_nodes(r, lines=True).corners is None
    assert not make_nodes(r, lines=True).is_rough
    assert rough.is_rough
    np.testing.assert_array_equal(rough.row[rough.corners], corners_of(r.columns["voltage_V"]))


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
@pytest.mark.parametrize("taken", ["at the stamps", "on the ticks"])
@pytest.mark.parametrize("begins_s", [0.5, 14.0])
def test_rough_nodes_are_few_also_where_stamps_tremble(taken, hold, begins_s):
    """A smooth command that was taken at uneven stamps bends from row to row; it has no more corners for that."""

    def few(stamps, at):
        volts = np.where(begins_s < T, 650 + 400 * np.sin(2 * np.pi * 1.3 * (at - begins_s)), 0.0)
        columns = {"time_s": stamps, "voltage_V": volts, "displacement_m": 0 * T}
        return rough_nodes(recording_from_arrays("slow.csv", "voltage", columns, "identify", ACTUATOR, hold=hold))

    stamps = T + np.append(0.0, 4e-5 * np.random.default_rng(3).standard_normal(T.size - 1))
    even = few(T, T)
    found = few(stamps, stamps if taken == "at the stamps" else T)
    assert found.size < 1.05 * even.size
    assert found.corners.size <= even.corners.size + 2


def test_at_rough_nodes_no_step_is_cut():
    quick = np.where(T > 0.5, 650 + 400 * np.sin(2 * np.pi * 8.0 * T), 0.0)
    nodes = rough_nodes(recording(quick))
    (plant,) = plants("series_resistance", 1, R_s_ohm=5e5)
    command, tried = nodes.command(), []
    for whole in (0.0, 1.0):
        w, out = plant.kernel_numbers(), np.empty(nodes.size)
        w[P_WHOLE] = whole
        drive_voltage(w, plant.law, nodes.durations(), command[0], command[1], out, None)
        tried.append(w[X_TRIED])
    assert tried[1] == nodes.size < tried[0]
    np.testing.assert_array_equal(simulate_nodes(plant, nodes), nodes.read(plant.stroke_m * out))

"""Rows that a logger left out: the clock goes on, and so does what drove the actuator."""

import numpy as np
import pytest

from bayes_dea.campaign import Actuator, recording_from_arrays
from bayes_dea.forward import simulate
from bayes_dea.models.clock import clock_of
from bayes_dea.models.course import course_of
from bayes_dea.models.missing_drive import driven
from bayes_dea.models.model import build_model
from bayes_dea.models.nodes import make_nodes, rough_nodes
from bayes_dea.models.plant import plant_of
from bayes_dea.models.simulate_plant import simulate_nodes

ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
VALUES = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "tau_1_s": 2.0, "k_2_Pa": 50e3, "tau_2_s": 0.03}
MODEL = build_model("hooke+gm2")


def recording(t, V, hold="end", out=()):
    keep = np.delete(np.arange(t.size), list(out))
    columns = {"time_s": t[keep], "voltage_V": V[keep], "displacement_m": 1e-9 * keep}
    return recording_from_arrays("v", "voltage", columns, "identify", ACTUATOR, hold=hold), keep


def triangle(seconds=30.0, hertz=0.1):
    t = 0.001 * np.arange(round(seconds / 0.001) + 1)
    return t, 1000.0 * (1.0 - np.abs(2.0 * ((hertz * t) % 1.0) - 1.0))


def test_the_clock_of_rows_knows_which_are_missing():
    t = 0.001 * np.arange(1000)
    keep = np.delete(np.arange(1000), [100, 400, 401, 402])
    clock = clock_of(t[keep])
    assert clock.step_s == pytest.approx(1e-3, rel=1e-12)
    assert clock.size == 1000
    np.testing.assert_array_equal(clock.after, [100, 399])
    np.testing.assert_array_equal(clock.missing, [1, 3])
    np.testing.assert_array_equal(clock.ticks(np.arange(996)), keep)
    # stamps rounded to a microsecond
    assert clock_of(np.round(t[keep] * 1.024, 6)).step_s == pytest.approx(1.024e-3, rel=1e-6)


@pytest.mark.parametrize("lost", [15, 30, 100])
def test_a_long_hole_in_coarsely_rounded_stamps_is_counted_right(lost):
    """60 Hz in whole milliseconds: steps of 16 and 17 ms, and a hole of a hundred of them is no 98 of 17."""
    keep = np.delete(np.arange(20000), np.arange(5000, 5000 + lost))
    clock = clock_of(np.round(keep / 60.0, 3))
    assert not clock.is_even
    assert clock.step_s == pytest.approx(1.0 / 60.0, rel=1e-5)
    np.testing.assert_array_equal(clock.ticks(np.arange(keep.size)), keep)


def test_stamps_that_tremble_by_much_have_a_clock_where_they_stay_about_its_ticks():
    """Steps of 0.2 to 1.8 ms of a program that asks every millisecond: few nodes are enough for what changes."""
    t, V = triangle(20.0)
    stamps = np.sort(t + 1.5e-4 * np.random.default_rng(2).standard_normal(t.size))
    assert np.max(np.abs(np.diff(stamps) - 1e-3)) > 4e-4
    clock = clock_of(stamps)
    assert not clock.is_even
    assert not clock.after.size
    assert clock.step_s == pytest.approx(1e-3, rel=1e-4)
    assert clock_of(np.delete(stamps, np.arange(9000, 9100))) is None  # a tenth of a second is missing
    part, _ = recording(stamps, V)
    rough, plant = rough_nodes(part), plant_of(MODEL, VALUES, ACTUATOR)
    assert rough.size < 1.3 * rough_nodes(recording(t, V)[0]).size < 0.2 * t.size
    exact = simulate_nodes(plant, make_nodes(part, every_row=True))
    read = np.setdiff1d(np.arange(rough.size), rough.unread)
    np.testing.assert_allclose(simulate_nodes(plant, rough)[read], exact[rough.row[read]], atol=3e-7)


@pytest.mark.parametrize("time_s", [
    np.cumsum(1e-3 * (1.0 + np.random.default_rng(0).random(500))),  # at any pace
    np.concatenate([0.001 * np.arange(100), 0.1 + 0.1 * np.arange(50)]),  # fast, then slow
    0.001 * np.delete(np.arange(1000), np.arange(5, 995, 10)),  # a tenth is missing
])  # fmt: skip
def test_what_is_uneven_has_no_clock(time_s):
    assert clock_of(time_s) is None


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
def test_a_wave_without_some_rows_is_as_cheap_and_the_same(hold):
    """One row, three and fifty, in 0.1 Hz of 1000 V: 9 V of a step where the next command acts all the while."""
    t, V = triangle()
    whole, _ = recording(t, V, hold)
    part, keep = recording(t, V, hold, [1234, *range(7000, 7003), *range(12000, 12050)])
    plant = plant_of(MODEL, VALUES, ACTUATOR)
    exact = simulate(MODEL, VALUES, whole)
    assert np.ptp(exact) > 100e-6
    every = make_nodes(part, every_row=True)
    np.testing.assert_allclose(simulate_nodes(plant, every), exact[keep], atol=2e-10)
    for nodes, within in ((make_nodes(part, lines=True), 1e-9), (rough_nodes(part), 3e-7)):
        as_many = make_nodes(whole, lines=True) if not nodes.is_rough else rough_nodes(whole)
        assert nodes.size < 1.3 * as_many.size < 0.2 * t.size
        assert np.unique(np.round(nodes.durations() / 1e-3)).size == np.unique(nodes.durations()).size
        read = np.setdiff1d(np.arange(nodes.size), [] if nodes.unread is None else nodes.unread)
        np.testing.assert_allclose(simulate_nodes(plant, nodes)[read], exact[keep][nodes.row[read]], atol=within)
    assert not driven(part).leapt.size


def test_a_clock_that_trembles_knows_which_rows_are_missing():
    """Stamps a tenth of a step early or late: few nodes for what changes, and every row for the answer itself."""
    t, V = triangle()
    lost = [1234, *range(7000, 7003)]
    stamps = t + 1e-4 * np.random.default_rng(1).uniform(-1.0, 1.0, t.size)
    part, _ = recording(stamps, V, out=lost)
    clock = clock_of(part.time_s)
    assert not clock.is_even
    np.testing.assert_array_equal(clock.missing, [1, 3])
    assert make_nodes(part, lines=True).size > 0.9 * t.size
    rough = rough_nodes(part)
    assert rough.size < 0.1 * t.size
    np.testing.assert_allclose(rough.durations()[1:], np.diff(part.time_s[rough.row]))
    read = np.setdiff1d(np.arange(rough.size), rough.unread)

    def change(nodes):
        moved = plant_of(MODEL, VALUES | {"k_1_Pa": 77e3, "tau_2_s": 0.033}, ACTUATOR)
        return simulate_nodes(moved, nodes) - simulate_nodes(plant_of(MODEL, VALUES, ACTUATOR), nodes)

    exact = change(make_nodes(part, every_row=True))
    assert np.max(np.abs(exact)) > 0.3e-6
    np.testing.assert_allclose(change(rough)[read], exact[rough.row[read]], atol=0.03 * np.max(np.abs(exact)))


def test_a_command_that_stood_still_did_so_in_rows_that_are_missing():
    t = 0.001 * np.arange(2000)
    V = np.where(t > 0.5, 800.0, 0.0)
    part, keep = recording(t, V, out=range(900, 930))
    found = driven(part)
    assert found.unknown is None or not found.unknown.any()
    np.testing.assert_array_equal(course_of(part).volts, V)
    np.testing.assert_allclose(simulate(MODEL, VALUES, part), simulate(MODEL, VALUES, recording(t, V)[0])[keep],
                               atol=1e-12)


@pytest.mark.parametrize("hold", ["end", "start"])
@pytest.mark.parametrize(("lost", "after"), [(1, 100), (30, 310)])
def test_an_edge_in_rows_that_are_missing_came_at_an_unknown_moment(hold, lost, after):
    """What it sets off is given 0.1 s, and ten times the hole where that is longer than 20 ms."""
    t = 0.001 * np.arange(2000)
    V = np.where(np.arange(2000) >= 500, 800.0, 0.0)
    part, keep = recording(t, V, hold, range(500, 500 + lost))
    unknown = keep[driven(part).unknown]
    behind = 500 + lost
    assert unknown[0] == behind
    assert unknown.size == pytest.approx(after, abs=2)
    # the command of the next row acts all the while; said at the start of its interval, that of the row before
    volts = course_of(part).volts
    assert np.all(volts[:500] == 0.0)
    assert np.all(volts[500 : behind + (hold == "start")] == (800.0 if hold == "end" else 0.0))
    assert np.all(volts[behind + 1 :] == 800.0)


def test_a_bend_of_a_wave_in_a_row_that_is_missing_takes_no_other_rows():
    t, V = triangle(2.0, 1.0)
    part, _ = recording(t, V, out=[500])
    found = driven(part)
    assert found.leapt.size <= 1
    assert not found.unknown.any()


def test_an_empty_cell_behind_rows_that_are_missing_tells_no_more_than_they_do():
    """Said at the start of its interval: what acted until the cell's own reading was in a row that is missing."""
    t = 0.001 * np.arange(1000)
    V = np.where(np.arange(1000) >= 502, 800.0, 0.0)
    V[505:508] = np.nan
    part, keep = recording(t, V, "start", range(500, 505))
    unknown = keep[driven(part).unknown]
    np.testing.assert_array_equal(unknown[:4], 505 + np.arange(4))


@pytest.mark.parametrize("hold", ["end", "start", "linear"])
def test_rows_that_are_missing_here_and_there_do_not_take_a_fast_recording(hold):
    """Each of 40 rows a second takes 12.5 ms behind it, not 100: of the others 1 in exp(0.5) counts, not in exp(4)."""
    t = 0.001 * np.arange(20000)
    V = 500.0 * (1.0 - np.cos(2.0 * np.pi * 100.0 * t))
    part, keep = recording(t, V, hold, 1 + np.random.default_rng(0).permutation(t.size - 2)[:800])
    counts = ~driven(part).unknown
    # whole rows, and one more where the command is said at the start
    assert np.exp(-0.5) - 0.06 < counts.mean() < np.exp(-0.5) + 0.02
    exact = simulate(MODEL, VALUES, recording(t, V, hold)[0])[keep]
    error = simulate_nodes(plant_of(MODEL, VALUES, ACTUATOR), make_nodes(part, every_row=True)) - exact
    assert np.ptp(exact) > 200e-6
    assert np.sqrt(np.mean(error[counts] ** 2)) < 0.1e-6

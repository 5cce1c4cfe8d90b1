"""False readings in residuals: found beside edges, and nothing else is."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.noise.isolated import isolated_outliers, recurrence

STEP = 1e-3


def wave(n=6000, period=100):
    """A rectangle of 10 Hz at 1 kHz, its input and recurrence."""
    u = np.where(np.arange(n) % period < period // 2, 1050.0, 250.0)
    u[:500] = 0.0
    return u, recurrence(u, period * STEP)


def noise(n, rho, rng, sd=4e-6):
    e = rng.standard_normal(n)
    e[1:] *= np.sqrt(1 - rho**2)
    return sd * lfilter([1.0], [1.0, -rho], e)


def found(r, back, rho=0.0, sd=4e-6):
    return np.flatnonzero(isolated_outliers(r, STEP * np.arange(r.size), sd, rho, back))


@pytest.mark.parametrize("rho", [*(pytest.param(r, marks=pytest.mark.long) for r in (0.0, 0.5)), 0.8])
def test_no_false_alarm_on_normal_noise(rho):
    """200 recordings at 1e-3 each at most: more than two alarms come once in 900 times."""
    _, back = wave()
    rng = np.random.default_rng(3)
    alarms = sum(found(noise(6000, rho, rng), back, rho).size > 0 for _ in range(200))
    assert alarms <= 2


@pytest.mark.parametrize("rho", [0.0, 0.7])
@pytest.mark.parametrize("lag", [0, 1, 2, 5, 30])
def test_a_single_reading_beside_an_edge_is_found(rho, lag):
    _, back = wave()
    r = noise(6000, rho, np.random.default_rng(4), 4e-6)
    row = int(back.edges[20]) + lag
    r[row] += 60e-6
    assert found(r, back, rho).tolist() == [row]


def test_a_run_and_the_first_and_the_last_row_are_found():
    _, back = wave()
    r = noise(6000, 0.0, np.random.default_rng(5))
    rows = [0, 3033, 3034, 5999]
    r[rows] -= 80e-6
    assert found(r, back).tolist() == rows


@pytest.mark.parametrize("rho", [0.0, 0.5])
@pytest.mark.parametrize("rows", [4, 8])
def test_a_run_of_several_readings_that_noise_surrounds_is_found(rho, rows):
    """Of twelve sds, at twenty places: each row has to stand five above what lies beside the run."""
    _, back = wave()
    rng = np.random.default_rng(12)
    hits = 0
    for row in range(1010, 3010, 100):
        r = noise(6000, rho, rng)
        r[row : row + rows] -= 48e-6
        hits += found(r, back, rho).tolist() == list(range(row, row + rows))
    assert hits >= 18


def test_what_swells_and_falls_or_rings_once_is_no_false_reading():
    _, back = wave()
    r = noise(6000, 0.0, np.random.default_rng(13))
    swell, ringing = r.copy(), r.copy()
    swell[2020:2060] += 60e-6 * np.sin(np.pi * np.arange(40) / 40)
    t = np.arange(60)
    ringing[2020:2080] += 60e-6 * np.exp(-t / 25) * np.sin(np.pi * t / 8)
    assert found(swell, back).size == 0
    assert found(ringing, back).size == 0


@pytest.mark.parametrize("rows", [1, 2, 3, 5, 8])
def test_what_comes_back_at_every_edge_is_physics(rows):
    """An error of one to eight samples right after each edge, as a delay leaves it."""
    _, back = wave()
    r = noise(6000, 0.0, np.random.default_rng(6))
    for k in range(rows):
        r[back.edges + k] += 60e-6 * np.sign(back.jump)
    assert found(r, back).size == 0


def test_what_comes_back_at_one_edge_in_eight_is_physics():
    _, back = wave()
    r = noise(6000, 0.0, np.random.default_rng(7))
    r[back.edges[4::8]] += 60e-6
    assert found(r, back).size == 0


def test_decays_steps_and_ringing_are_no_false_readings():
    """One edge alone: nothing to compare with, so the shape decides."""
    u = np.where(np.arange(4000) >= 1000, 900.0, 0.0)
    back = recurrence(u, 0.0)
    t = np.maximum(np.arange(4000) - 1000, 0) * STEP
    on = np.arange(4000) >= 1000
    for shape in (np.exp(-t / 0.006), np.exp(-t / 0.002), np.ones(4000),
                  np.exp(-t / 0.02) * np.cos(2 * np.pi * 390 * t)):  # fmt: skip
        r = noise(4000, 0.0, np.random.default_rng(8), 1e-6) + 50e-6 * np.where(on, shape, 0.0)
        assert found(r, back, sd=1e-6).size == 0


def test_a_single_row_at_the_only_edge_is_left_alone():
    u = np.where(np.arange(4000) >= 1000, 900.0, 0.0)
    back = recurrence(u, 0.0)
    r = noise(4000, 0.0, np.random.default_rng(9))
    r[1000] += 80e-6
    assert found(r, back).size == 0
    r[2000] += 80e-6
    assert found(r, back).tolist() == [2000]


def test_at_an_only_edge_other_recordings_tell():
    """One step down at the end: with the same step elsewhere, what shows there alone is a false reading."""
    u = np.where(np.arange(3000) < 2000, 650.0, 0.0)
    u[:200] = 0.0
    back = recurrence(u, 0.0)
    edge = int(back.edges[np.argmin(back.jump)])
    rng = np.random.default_rng(7)
    r = noise(3000, 0.3, rng)
    r[edge] += 150e-6
    others = [(noise(3000, 0.3, rng), back) for _ in range(3)]

    def flagged(elsewhere):
        rows = isolated_outliers(r, STEP * np.arange(3000), 4e-6, 0.3, back, elsewhere=elsewhere)
        return list(np.flatnonzero(rows))

    assert flagged(others) == [edge]
    assert flagged([]) == []
    # one other edge tells of what is late, as a step as large is late as well; of what goes too far two are asked for
    assert flagged(others[:1]) == [edge]
    r[edge] -= 300e-6
    assert flagged(others[:1]) == []
    assert flagged(others) == [edge]
    r[edge] += 300e-6
    answer = [(x + 100e-6 * (np.arange(3000) == edge), at) for x, at in others]
    assert flagged(answer) == []  # it comes back: physics


def test_first_steps_of_other_recordings_tell_where_a_wave_outnumbers_them():
    """A sensor whose range ends hides what a step does at all steps of a rectangle, not at the first one of sines."""
    step = np.where(np.arange(3000) < 500, 0.0, 650.0)
    back, edge = recurrence(step, 0.0), 500
    rng = np.random.default_rng(11)
    shows = 80e-6 * np.isin(np.arange(3000), (edge, edge + 1))
    rectangle = np.where(np.arange(3000) % 100 < 50, 1050.0, 250.0)
    hidden = (noise(3000, 0.3, rng), recurrence(rectangle, 0.1))

    def flagged(*elsewhere):
        r = noise(3000, 0.3, np.random.default_rng(12)) + shows
        return list(np.flatnonzero(isolated_outliers(r, STEP * np.arange(3000), 4e-6, 0.3, back, elsewhere=elsewhere)))

    alike = [(noise(3000, 0.3, rng) + shows, back) for _ in range(2)]
    assert flagged(hidden, *alike) == []
    # one other recording may have a drop-out there as well, and two of nine are not many
    assert flagged(hidden, alike[0]) == [edge, edge + 1]
    assert flagged(hidden, *alike, *[(noise(3000, 0.3, rng), back) for _ in range(6)]) == [edge, edge + 1]


def test_what_a_limit_delays_at_the_largest_step_alone_is_physics():
    """A supply of limited current is late at a step of 1,200 V and in time at 800 V."""
    u = np.zeros(6000)
    for k in range(5):
        u[500 + 800 * k : 900 + 800 * k] = 800.0
    u[5000:] = 1200.0
    back = recurrence(u, 0.0)
    edge = int(back.edges[np.argmax(back.jump)])
    for sign in (-1.0, 1.0):
        r = noise(6000, 0.3, np.random.default_rng(8))
        r[edge] += sign * 80e-6
        # what goes too far is no limit's doing, and would show at smaller steps too
        assert list(found(r, back, 0.3)) == ([] if sign < 0 else [edge])
    # nor is what falls short behind a row that has arrived; one row may be the convention of the command
    for behind, flagged in ((1, []), (2, [edge + 2]), (5, [edge + 5])):
        r = noise(6000, 0.3, np.random.default_rng(8))
        r[edge + behind] -= 80e-6
        assert list(found(r, back, 0.3)) == flagged


def test_what_is_no_fault_now_and_then_is_left_alone():
    _, back = wave()
    rng = np.random.default_rng(10)
    r = noise(6000, 0.0, rng)
    r[np.arange(20, 5990, 25) + rng.integers(0, 8, 239)] += 60e-6
    assert found(r, back).size == 0


def test_at_three_edges_a_reading_that_noise_echoes_once_is_found():
    """A drop-out of eleven sds at one of three falling edges; at another noise happens to lie four sds off."""
    _, back = wave(n=6000, period=2000)
    r = noise(6000, 0.0, np.random.default_rng(3))
    falls = back.edges[back.jump < 0]
    assert falls.size == 3
    r[falls[1] + 1] += 11.3 * 4e-6
    r[falls[2] + 1] = 3.9 * 4e-6
    assert found(r, back).tolist() == [int(falls[1]) + 1]


def test_at_three_edges_what_two_show_is_physics():
    _, back = wave(n=6000, period=2000)
    r = noise(6000, 0.0, np.random.default_rng(3))
    falls = back.edges[back.jump < 0]
    r[falls[:2] + 1] += 11.3 * 4e-6
    assert found(r, back).size == 0


@pytest.mark.parametrize(("rho", "size"), [(0.0, 5.0), (0.6, 6.5)])
def test_a_run_of_readings_that_are_no_outliers_one_by_one_is_found(rho, size):
    """Three readings of a few sds each: together they are 8 of their mean. Power at least 90 %, a neighbour at most
    on either side."""
    _, back = wave()
    rng = np.random.default_rng(6)
    hits = 0
    for _ in range(50):
        r = noise(6000, rho, rng)
        r[2010:2013] += size * 4e-6
        rows = found(r, back, rho)
        hits += rows.size >= 2 and rows[0] >= 2009 and rows[-1] <= 2013
    assert hits >= 45


@pytest.mark.parametrize(("at", "flagged"), [(1013, False), (2000, True)])
def test_a_weak_run_behind_the_only_edge_may_be_what_it_does(at, flagged):
    """Eight rows of 4 sds, twelve after the only edge: a supply that is late may leave them. Far from it they are no
    answer to anything."""
    back = recurrence(np.where(np.arange(5000) > 1000, 1000.0, 0.0), 0.0)
    r = noise(5000, 0.0, np.random.default_rng(2))
    r[at : at + 8] += 16e-6
    assert (found(r, back).size >= 6) == flagged


def test_a_wave_that_begins_with_a_step_has_one_edge_there():
    """10 Hz from 650 V on: 25 V a row behind the step are no edge of their own, to which its answer would be held."""
    t = STEP * np.arange(2500)
    u = np.where((t >= 0.5) & (t < 2.0), 650.0 + 400.0 * np.sin(2 * np.pi * 10.0 * (t - 0.5)), 0.0)
    back = recurrence(u, 0.1)
    assert back.jump.size == 2
    assert np.all(np.abs(np.abs(back.jump) - 650.0) < 60.0)
    pulse = np.zeros(200)
    pulse[100:102] = 600.0  # on, and off again two rows later
    assert list(np.sign(recurrence(pulse, 0.0).jump)) == [1.0, -1.0]


def test_what_a_delay_leaves_behind_the_only_step_of_a_wave_is_no_false_reading():
    """Six rows late behind a step of 650 V; a creep of 1,200 V shows the same, larger."""
    rng = np.random.default_rng(5)
    t = STEP * np.arange(3000)
    u = np.where((t >= 0.5) & (t < 2.5), 650.0 + 400.0 * np.sin(2 * np.pi * 10.0 * (t - 0.5)), 0.0)
    up = recurrence(np.where(t >= 0.5, 1200.0, 0.0), 0.0)
    r, x = noise(3000, 0.0, rng), noise(3000, 0.0, rng)
    r[501:507] -= 3e-5
    x[501:507] -= 1e-4
    flagged = isolated_outliers(r, t, 4e-6, 0.0, recurrence(u, 0.1), elsewhere=[(x, up)])
    assert not flagged.any()


@pytest.mark.parametrize("half_period", [3, 5, 8.3, 11, 16])
def test_a_ring_that_dies_away_is_no_false_reading(half_period):
    """What a wrong mass leaves behind the only step of a creep: where it has come down to a few sds, half periods of
    eight rows were taken for runs of false readings, though none of their neighbours stands out."""
    rng = np.random.default_rng(11)
    n = 6000
    u = np.where(np.arange(n) < 500, 0.0, 1000.0)
    at = np.arange(n) - 500
    flagged = 0
    for _ in range(30):
        swing = np.cos(np.pi * at / half_period + rng.uniform(0.0, 2 * np.pi)) * np.exp(-at / 60.0)
        r = noise(n, 0.0, rng) + np.where(at >= 0, 60e-6 * swing, 0.0)
        flagged += found(r, recurrence(u, 0.0)).size > 0
    assert flagged == 0


def test_what_a_dead_time_of_many_rows_leaves_behind_first_steps_is_no_false_reading():
    """8.6 ms: a rise that a lag stands in for misses the first rows behind it, in every recording at the same lag."""
    rng = np.random.default_rng(25)
    n = 3000
    row = np.arange(n)

    def creep(jump, lag=9):
        u = np.where(row >= 500, jump, 0.0)
        r = noise(n, 0.0, rng, 0.3e-6)
        r[500 + lag : 500 + lag + 7] -= 12e-6 * (jump / 1000.0)
        return r, recurrence(u, 0.0)

    def flagged(own, *elsewhere):
        r, back = own
        return np.flatnonzero(isolated_outliers(r, STEP * row, 0.3e-6, 0.0, back, elsewhere=elsewhere)).tolist()

    own, others = creep(1000.0), [creep(1000.0), creep(900.0), creep(1100.0)]
    assert flagged(own, *others) == []
    # alone, and where nothing like it shows in the others, it is one
    assert flagged(own) == list(range(509, 516))
    assert flagged(own, *(creep(1000.0, 300) for _ in range(3))) == list(range(509, 516))


def test_a_ring_on_a_level_far_behind_the_only_edge_is_no_false_reading():
    """Where it has decayed to some sds no neighbour stands out, and its level is no middle: one of these had eight."""
    t = np.arange(20000) * STEP
    since = np.clip(t - 0.5, 0.0, None)
    back = recurrence(np.where(t >= 0.5, 1000.0, 0.0), 0.0)
    for seed in range(60):
        rng = np.random.default_rng([5, seed])
        e = 0.2e-6 * rng.standard_normal(t.size)
        w, zeta = 2.0 * np.pi * rng.uniform(30.0, 80.0), rng.uniform(0.03, 0.1)
        ring = 8e-6 * np.exp(-zeta * w * since) * np.cos(w * since) - 1.2e-6 * np.exp(-since)
        r = e + np.where(t >= 0.5, ring, 0.0)
        rows = found(r, back, 0.0, 0.2e-6)
        assert not np.any(rows > 500 + 60)
        # one that is false is found all the same, where the ring is gone
        r[5000:5003] += 3e-6
        assert {5000, 5001, 5002} <= set(found(r, back, 0.0, 0.2e-6))

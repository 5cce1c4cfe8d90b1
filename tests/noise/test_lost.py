"""A sensor that loses its target: what is found of it, and what is not taken for it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.noise.lost import find_lost, without_lost

FS, STROKE, NOISE, STEP = 200.0, 100e-6, 1e-6, 0.15e-6


def read(t, x, seed=1, rho=0.0):
    """Readings (n,) of a displacement (n,): AR(1) noise, a resolution step."""
    white = np.random.default_rng(seed).standard_normal(t.size)
    noise = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white)
    return STEP * np.round((x + NOISE * noise) / STEP)


def creep(seconds=60.0):
    t = np.arange(0.0, seconds, 1.0 / FS)
    V = np.where(t >= 5.0, 1000.0, 0.0)
    return t, V, np.where(t >= 5.0, STROKE * (0.8 + 0.2 * (1.0 - np.exp(-(t - 5.0) / 8.0))), 0.0)


def wave(frequency=1.0, seconds=30.0):
    t = np.arange(0.0, seconds, 1.0 / FS)
    V = 650.0 + 400.0 * np.sin(2 * np.pi * frequency * t)
    return t, V, STROKE * (V / 1050.0) ** 2


@pytest.mark.parametrize("value", [5e-3, -1e-3, 99.9999e-3, 0.0, 40e-6])
@pytest.mark.parametrize("rows", [3, 5, 10, 40, 200])
def test_bursts_of_any_length_are_found_wherever_they_stand(value, rows):
    """Also of a value that the readings take elsewhere, and in several places."""
    t, V, x = creep()
    y = read(t, x)
    lost = np.zeros(t.size, dtype=bool)
    for at in (3000, 7000):
        lost[at : at + rows] = True
    y[lost] = value
    assert np.array_equal(find_lost(y, V, resolution=STEP), lost)
    clean = without_lost(y, lost)
    assert np.isnan(clean[lost]).all()
    assert np.array_equal(clean[~lost], y[~lost])


@pytest.mark.parametrize("rows", [12, 60])
def test_a_held_value_a_few_sds_off_is_found_where_chance_makes_no_such_run(rows):
    """A leap of 20 sds of the noise: four times the largest of ten changes is 19 at most but in one of a thousand; what
    is held for less needs twenty sds of the changes, 28."""
    t, V, x = creep()
    y = read(t, x)
    lost = np.zeros(t.size, dtype=bool)
    for at in (3000, 7000):
        lost[at : at + rows] = True
        y[at : at + rows] = STEP * np.round((x[at] - 20 * NOISE) / STEP)
    assert np.array_equal(find_lost(y, V, resolution=STEP), lost)


@pytest.mark.parametrize("hold", [5, 10, 20])
@pytest.mark.parametrize("noise", [0.0, 0.3e-6, 2e-6])
def test_a_sensor_slower_than_the_rows_has_lost_nothing(hold, noise):
    """Each of its readings stands in several rows, also at the top of a wave."""
    t = np.arange(0.0, 20.0, 1e-3)
    for frequency in (0.5, 1.0, 3.0, 10.0):
        V = 650.0 + 400.0 * np.sin(2 * np.pi * frequency * t)
        y = STROKE * (V / 1050.0) ** 2 + noise * np.random.default_rng(1).standard_normal(t.size)
        y = STEP * np.round(y[np.arange(t.size) // hold * hold] / STEP)
        assert not find_lost(y, V, resolution=STEP).any()


def test_bursts_in_a_wave_and_readings_that_scatter_far_off():
    t, V, x = wave()
    y = read(t, x)
    lost = np.zeros(t.size, dtype=bool)
    lost[600:640] = lost[2200:2230] = True
    y[600:640] = 0.0
    y[2200:2230] = 3e-3 + 1e-4 * np.random.default_rng(5).standard_normal(30)
    assert np.array_equal(find_lost(y, V, resolution=STEP), lost)


@pytest.mark.parametrize("rho", [0.0, 0.95])
def test_noise_and_waves_have_none(rho):
    """In 40 recordings of 12,000 readings, at rest, of a step and of waves, white and correlated."""
    for seed in range(10):
        for t, V, x in (creep(), wave(1.0), wave(10.0), (lambda t: (t, 0 * t, 0 * t))(creep()[0])):
            assert not find_lost(read(t, x, seed, rho), V, resolution=STEP).any()


def test_a_ring_to_twice_the_step_has_none():
    t, V, _ = creep()
    since = np.maximum(t - 5.0, 0.0)
    x = np.where(t >= 5.0, STROKE * (1.0 - np.exp(-since / 2.0) * np.cos(2 * np.pi * 20.0 * since)), 0.0)
    assert x.max() > 1.95 * STROKE
    assert not find_lost(read(t, x), V, resolution=STEP).any()


@pytest.mark.parametrize("late", [0, 20])
def test_the_end_of_a_range_is_none(late):
    """Plateaus of a rectangle cut off at one value, readings late by 0.1 s; and the tops of a wave."""
    t = np.arange(0.0, 30.0, 1.0 / FS)
    V = np.where(np.sin(2 * np.pi * 0.2 * t) > 0.7, 1000.0, 300.0)
    x = np.roll(STROKE * (V / 1000.0) ** 2, late)
    y = np.minimum(read(t, x), 60e-6)
    assert np.count_nonzero(y == 60e-6) > 500
    assert not find_lost(y, V, resolution=STEP).any()
    t, V, x = wave()
    assert not find_lost(np.minimum(read(t, x), 60e-6), V, resolution=STEP).any()


def test_a_short_pulse_of_the_input_and_steps_coarser_than_noise_are_none():
    t = np.arange(0.0, 60.0, 1.0 / FS)
    V = np.zeros(t.size)
    V[4000:4008] = V[9000:9008] = 1000.0
    assert not find_lost(read(t, STROKE * (V / 1000.0) ** 2), V, resolution=STEP).any()
    t, V, x = wave(0.1)
    coarse = 5e-6
    y = coarse * np.round((x + 0.4e-6 * np.random.default_rng(1).standard_normal(t.size)) / coarse)
    assert not find_lost(y, V, resolution=coarse).any()


def test_where_much_is_false_nothing_is_known():
    t, V, x = creep()
    y = read(t, x)
    y[2000:3000] = 5e-3
    assert not find_lost(y, V, resolution=STEP).any()


def test_gaps_are_left_alone():
    t, V, x = creep()
    y = read(t, x)
    y[::7] = np.nan
    y[5000:5010] = 5e-3
    found = find_lost(y, V, resolution=STEP)
    assert np.array_equal(np.flatnonzero(found), np.arange(5000, 5010))


@pytest.mark.parametrize("fs", [100.0, 1000.0])
def test_a_stroke_that_fades_for_minutes_is_none(fs):
    """A charge that is kept takes a stroke back to a tenth: its first seconds lie beyond what most readings span."""
    t = np.arange(0.0, 270.0, 1.0 / fs)
    V = np.where(t >= 1.0, 1000.0, 0.0)
    y = read(t, np.where(t >= 1.0, STROKE * (0.1 + 0.9 * np.exp(-(t - 1.0) / 19.0)), 0.0))
    single = np.array([2.5, 4.0]) * fs  # false readings do not make the others false
    y[single.astype(int)] = -2e-4, 3e-4
    assert set(np.flatnonzero(find_lost(y, V, resolution=STEP))) <= set(single.astype(int))


def test_a_run_that_is_lost_in_a_stroke_that_fades_is_found():
    t = np.arange(0.0, 270.0, 1.0 / FS)
    V = np.where(t >= 1.0, 1000.0, 0.0)
    y = read(t, np.where(t >= 1.0, STROKE * (0.1 + 0.9 * np.exp(-(t - 1.0) / 19.0)), 0.0))
    lost = np.zeros(t.size, dtype=bool)
    lost[500:560] = lost[20_000:20_300] = True
    y[lost] = 2e-3 + 1e-4 * np.random.default_rng(2).standard_normal(np.count_nonzero(lost))
    np.testing.assert_array_equal(find_lost(y, V, resolution=STEP), lost)


def test_a_pulse_to_a_level_that_was_held_for_minutes_is_none():
    """It comes with a jump of the input and goes with another; a run that is lost just before it is found."""
    t = np.arange(0.0, 300.0, 1.0 / FS)
    on = (t >= 1.0) & (t < 250.0) | (t >= 280.0) & (t < 280.5)
    fades = np.where(t < 270.0, np.exp(-(t - 1.0) / 5.0), 1.0)
    y = read(t, np.where(on, STROKE * (0.05 + 0.95 * fades), 0.0))
    lost = np.zeros(t.size, dtype=bool)
    lost[55_800:55_900] = True
    y[lost] = 1e-3
    np.testing.assert_array_equal(find_lost(y, np.where(on, 1000.0, 0.0), resolution=STEP), lost)

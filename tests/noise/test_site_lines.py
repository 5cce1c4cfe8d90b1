"""Mains that a recording cannot show by itself, because the drive has a line of its own there."""

import numpy as np
import pytest

from bayes_dea.noise.mains import Mains, MainsLine, find_mains
from bayes_dea.noise.site_lines import site_lines


def mains(amplitude, harmonic=1, frequency=50.0, se=1e-8):
    """One line."""
    line = MainsLine(harmonic, harmonic * frequency, amplitude, se, 0.3, 1e-9)
    return Mains(50.0, frequency, (line,), True)


def test_a_line_that_two_show_is_taken_over_by_the_others():
    out = site_lines([mains(4.4e-6, frequency=50.01, se=1e-8), mains(4.6e-6), None], [500.0] * 3)
    assert out[2].taken_over
    assert out[2].lines[0].amplitude == pytest.approx(4.5e-6)
    assert out[2].lines[0].frequency_Hz in (50.0, 50.01)
    assert not out[0].taken_over


@pytest.mark.parametrize("found", [[mains(4e-6), None], [mains(4e-6), mains(0.4e-6), None], [None, None]])
def test_nothing_is_taken_over_from_one_alone_or_where_they_differ(found):
    assert site_lines(found, [500.0] * len(found)) == found


def test_a_slow_recording_takes_no_line_over_that_it_cannot_hold():
    found = [mains(4e-6), mains(4e-6), None]
    assert site_lines(found, [500.0, 500.0, 50.0])[2] is None


def test_a_further_harmonic_joins_the_one_that_is_there():
    found = [mains(4e-6), mains(1e-6, 3), mains(1.1e-6, 3)]
    out = site_lines(found, [500.0] * 3)
    assert [line.harmonic for line in out[0].lines] == [1, 3]


@pytest.mark.parametrize("shape", ["sine", "triangle"])
def test_a_slow_wave_whose_multiples_lie_close_does_not_hide_mains(shape):
    """The 500th multiple of 0.1 Hz is 50 Hz, and its neighbours are a bin and a half away."""
    rng = np.random.default_rng(7)
    t = np.arange(31_000) * 1e-3
    phase = np.clip(t - 0.5, 0.0, 30.0) * 0.1
    wave = np.sin(2 * np.pi * phase) if shape == "sine" else 2 / np.pi * np.arcsin(np.sin(2 * np.pi * phase))
    u = np.where((t > 0.5) & (t < 30.5), 650.0 + 400.0 * wave, 0.0)
    y = 2e-10 * u**2 + 4.4e-6 * np.cos(2 * np.pi * 50.0 * t + 1.0) + 4.7e-6 * rng.standard_normal(t.size)
    found = find_mains(y, t, u)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(50.0, abs=0.01)
    assert found.amplitude == pytest.approx(4.4e-6, rel=0.1)


def _slowed(rng, amplitude):
    """A creep read at 1 kHz for two seconds behind each edge and every 0.1 s in between, with mains."""
    fast = [np.arange(a, a + 2.0, 1e-3) for a in (2.0, 42.0)]
    t = np.concatenate([np.arange(0.0, 2.0, 0.1), fast[0], np.arange(4.0, 42.0, 0.1), fast[1], [44.0, 44.1]])
    u = np.where((t > 2.0) & (t < 42.0), 800.0, 0.0)
    y = 1e-4 * (u > 0.0) + amplitude * np.cos(2 * np.pi * 50.0 * t + 1.0) + 4.7e-6 * rng.standard_normal(t.size)
    return y, t, u


def test_a_sampler_that_goes_slower_for_a_while_makes_no_mains_of_its_steps():
    """Lines through readings every 0.1 s have lines at every multiple of 10 Hz."""
    for seed in range(20):
        assert find_mains(*_slowed(np.random.default_rng(seed), 0.0)) is None
    found = find_mains(*_slowed(np.random.default_rng(1), 4e-6))
    assert found is not None
    assert found.frequency_Hz == pytest.approx(50.0, abs=0.2)
    assert found.amplitude == pytest.approx(4e-6, rel=0.15)


def test_gaps_are_bridged_and_jitter_of_the_clock_is_none():
    rng = np.random.default_rng(3)
    t = np.arange(20_000) * 1e-3 + 1e-4 * rng.standard_normal(20_000)
    kept = np.ones(t.size, dtype=bool)
    kept[5000:5400] = kept[9000:9030] = False
    y = 4e-6 * np.cos(2 * np.pi * 50.0 * t) + 4.7e-6 * rng.standard_normal(t.size)
    found = find_mains(y[kept], t[kept])
    assert found is not None
    assert found.amplitude == pytest.approx(4e-6, rel=0.1)

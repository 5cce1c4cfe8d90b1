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

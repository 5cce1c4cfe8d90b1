"""Mains wanders by hundredths of a hertz: where the drive hides it, its frequency is that of the recording itself."""

import numpy as np
import pytest

from bayes_dea.noise.mains import MainsLine, find_mains
from bayes_dea.noise.site_frequency import in_this_recording

SHOWN = np.array([49.98, 50.0, 50.02, 50.03, 49.97, 50.01])
LINE = MainsLine(1, 49.994, 6.7e-6, 1e-8, 0.0, 1e-9)


def recording(rng, frequency, shape, hertz, amplitude=6.7e-6):
    """A wave of a whole number of periods in 0.2 s for 20 s, its answer late and creeping, and mains."""
    t = np.arange(21_000) * 1e-3
    phase = np.clip(t - 0.5, 0.0, 20.0) * hertz
    wave = 2.0 * (phase % 1.0) - 1.0 if shape == "sawtooth" else np.sign(np.sin(2 * np.pi * phase) + 1e-12)
    u = np.where((t > 0.5) & (t < 20.5), 650.0 + 400.0 * wave, 0.0)
    y = 2e-10 * u**2
    for k in range(1, t.size):  # a lag of 3 ms
        y[k] = y[k - 1] + (y[k] - y[k - 1]) * (1.0 - np.exp(-1.0 / 3.0))
    y *= 1.0 + 0.005 * np.log1p(t)  # what is linear answers as it did at 50 Hz, however its mean creeps
    y += 0.05 * np.log1p(t) * np.mean(y)
    line = amplitude * np.cos(2 * np.pi * frequency * t + rng.uniform(0, 6.3))
    return t, y + line + 1.7e-6 * rng.standard_normal(t.size), u


@pytest.mark.parametrize(("shape", "hertz"), [("sawtooth", 5.0), ("rectangle", 10.0), ("sawtooth", 1.0)])
def test_it_is_found_beside_a_line_of_the_drive(shape, hertz):
    rng = np.random.default_rng(5)
    for _ in range(4):
        f = 50.0 + 0.02 * rng.standard_normal()
        found = in_this_recording(LINE, SHOWN, *recording(rng, f, shape, hertz)).frequency_Hz
        assert found == pytest.approx(f, abs=0.005)  # a tenth of a turn in 20 s


def test_where_the_others_agree_it_stays_what_they_show():
    t, y, u = recording(np.random.default_rng(6), 50.02, "sawtooth", 5.0)
    assert in_this_recording(LINE, np.full(6, 49.994), t, y, u) is LINE
    assert in_this_recording(LINE, SHOWN[:1], t, y, u) is LINE


def test_a_weak_one_beside_a_strong_answer_that_creeps_stays_what_they_show():
    """What the drive's line loses as the answer creeps is no mains of another frequency."""
    weak = MainsLine(1, 50.0, 0.4e-6, 1e-8, 0.0, 1e-9)
    for seed in range(6):
        t, y, u = recording(np.random.default_rng(seed), 50.0, "sawtooth", 5.0, 0.4e-6)
        assert abs(in_this_recording(weak, SHOWN, t, y, u).frequency_Hz - 50.0) < 0.01


def test_where_nothing_was_read_or_commanded_it_stays_what_they_show():
    t, _, u = recording(np.random.default_rng(7), 50.02, "sawtooth", 5.0)
    assert in_this_recording(LINE, SHOWN, t, np.full(t.size, np.nan), u) is LINE
    assert in_this_recording(LINE, SHOWN, t, np.zeros(t.size), np.zeros(t.size)) is LINE


def test_a_wave_that_begins_within_a_chunk_does_not_pull_the_frequency_of_a_line():
    """Its first half second leaves twice in the record what 0.5 um of mains do: 50.033 Hz were read for 50.01."""
    rng = np.random.default_rng(9)
    t = np.arange(2150) / 500.0
    u = np.where(t >= 0.302, 650.0 + 400.0 * np.sin(2 * np.pi * 10.0 * (t - 0.302)), 0.0)
    off = []
    for phase in np.linspace(0.0, 2 * np.pi, 12, endpoint=False):
        y = 150e-6 * (u / 1050.0) ** 2 + 0.5e-6 * np.sin(2 * np.pi * 50.01 * t + phase)
        mains = find_mains(y + 0.3e-6 * rng.standard_normal(t.size), t, u)
        assert mains is not None
        off.append(mains.frequency_Hz - 50.01)
    # sqrt(6) sd / (pi T A sqrt(n)) is 0.0023 Hz for rows weighted alike, half as much again for a Hann window
    assert np.abs(off).max() < 0.014

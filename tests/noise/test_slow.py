"""What means of many readings miss, and single readings hide."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.noise.blocks import variance_of_mean
from bayes_dea.noise.slow import slow_misfit

COUNT = np.full(60, 400)


def means(seed, rho, wander=0.0):
    """Of 60 blocks of 400 readings of AR(1) noise of one unit, and of a wander of 20 blocks."""
    white = np.random.default_rng(seed).standard_normal(60 * 400)
    noise = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], white).reshape(60, 400).mean(axis=1)
    return noise + wander * np.sin(2 * np.pi * np.arange(60) / 20.0)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_noise_shows_nothing_and_a_wander_of_a_third_of_it_does(rho):
    """In 400 recordings; the wander is 0.35 of one reading's noise where that of a mean is 0.05 and 0.15."""
    variance = variance_of_mean(COUNT, 1.0, rho)
    plain = [slow_misfit(means(seed, rho), variance, COUNT) for seed in range(400)]
    assert not any(s.shows for s in plain)
    assert np.mean([s.chi2 for s in plain]) == pytest.approx(1.0, abs=0.05)
    seen = [slow_misfit(means(seed, rho, 0.5), variance, COUNT) for seed in range(400, 450)]
    assert all(s.shows for s in seen)
    assert np.mean([s.rms for s in seen]) == pytest.approx(0.5 / np.sqrt(2.0), rel=0.1)


def test_few_blocks_and_blocks_of_few_readings_say_nothing():
    assert slow_misfit(np.ones(9), np.ones(9), np.full(9, 400)) is None
    assert slow_misfit(np.ones(60), np.ones(60), np.full(60, 3)) is None
    gaps = np.full(60, np.nan)
    gaps[:20] = 1.0
    assert slow_misfit(gaps, np.ones(60), COUNT).n == 20

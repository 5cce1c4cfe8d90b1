"""A sensor that is read less often than the command is written."""

import numpy as np
import pytest
from scipy.signal import lfilter

from bayes_dea.campaign.rhythm import reading_every, with_a_reading
from bayes_dea.noise.quiet import quiet_noise


def slow(y, every, first=0):
    out = np.full(y.size, np.nan)
    out[first::every] = y[first::every]
    return out


@pytest.mark.parametrize(("every", "first"), [(2, 0), (5, 3), (40, 39)])
def test_the_rhythm_of_readings_is_found_though_some_are_missing(every, first):
    y = slow(np.arange(20_000.0), every, first)
    y[1000:1400] = np.nan
    assert reading_every(y) == (first, every)
    assert with_a_reading(y) == slice(first, None, every)


def test_gaps_in_no_rhythm_are_gaps():
    rng = np.random.default_rng(1)
    y = np.arange(20_000.0)
    assert reading_every(y) == (0, 1)
    assert reading_every(np.where(rng.random(y.size) < 0.8, np.nan, y)) == (0, 1)
    assert reading_every(np.full(y.size, np.nan)) == (0, 1)
    assert reading_every(np.where(np.arange(y.size) < 15_000, np.nan, y)) == (0, 1)


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_noise_at_rest_is_that_of_the_readings(rho):
    """Sd 3, one reading in five rows, on creep of two steps: within 5 %, and rho within 0.05."""
    rng = np.random.default_rng(2)
    t = 1e-3 * np.arange(120_000)
    u = np.where((t > 20.0) & (t < 80.0), 1000.0, 0.0)
    y = 100.0 * lfilter([1e-3], [1.0, -0.999], u / 1000.0)
    noise = lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(t.size // 5 + 500))[500:]
    y = slow(y, 5)
    y[::5] += 3.0 * noise
    found = quiet_noise(y, u, t)
    assert found.n > 10_000
    assert found.sd == pytest.approx(3.0, rel=0.05)
    assert found.rho == pytest.approx(rho, abs=0.05)

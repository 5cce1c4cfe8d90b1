"""A sensor that is read less often than the command is written."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from bayes_dea.campaign.rhythm import reading_every, with_a_reading
from bayes_dea.noise.blocks import block_loglik, block_means, log_blocks
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


def recorded(every, first, rng):
    """A step of the command, and 1,200 readings at every `every`-th row; some are lost, and some put aside."""
    n = 1_200 * every
    t = 1e-3 * np.arange(n)
    u = np.where(t > 0.2 * t[-1], 1000.0, 0.0)
    y = slow(rng.standard_normal(n), every, first)
    read = np.flatnonzero(np.isfinite(y))
    y[read[100:104]] = y[read[300]] = np.nan
    masked = ~np.isin(np.arange(n), read)
    masked[read[[50, 51, 400]]] = True
    return t, u, y, masked


@pytest.mark.parametrize(("every", "first"), [(2, 0), (5, 3), (40, 39)])
def test_readings_of_a_slow_sensor_are_averaged(every, first):
    """What it was not read at cuts no blocks: readings were kept one by one, a hundred times as many."""
    t, u, y, masked = recorded(every, first, np.random.default_rng(3))
    b = log_blocks(t, u, y=y, mask=masked)
    assert b.n < 240
    assert b.count.sum() == np.count_nonzero(np.isfinite(y) & ~masked)
    assert np.all(b.start % every == first)
    assert np.all((b.stop - 1) % every == first)
    # 1 where they touch; of the readings that are lost or left out with their block, so many more
    between = (b.start[1:] - b.stop[:-1] + 1) // every
    np.testing.assert_array_equal(b.gap[1:], between)
    assert {1, 2, 5} <= set(b.gap.tolist())
    assert np.all(np.isfinite(block_means(np.where(masked, np.nan, y), b, masked)))
    # without a mask what was not read is a gap; how many readings are missing is counted all the same
    single = log_blocks(t, u, y=y)
    assert np.all(single.count == 1)
    assert {1, 2, 5} == set(single.gap.tolist())
    # the mean over the rows from reading to reading is that over readings for what is straight
    times = np.array([t[a:z].mean() for a, z in zip(b.start, b.stop, strict=True)])
    whole = np.array([masked[a:z:every].any() for a, z in zip(b.start, b.stop, strict=True)])
    np.testing.assert_allclose(b.time_s[~whole], times[~whole], atol=1e-12)


def test_correlation_is_from_reading_to_reading():
    """Against a dense normal, readings that are lost among them."""
    t, u, y, masked = recorded(5, 3, np.random.default_rng(4))
    masked = ~np.isin(np.arange(t.size), np.arange(3, t.size, 5))
    b = log_blocks(t, u, y=y, mask=masked)
    assert b.n < 240
    index = np.arange(t.size) // 5
    A = np.zeros((b.n, t.size))
    for i in range(b.n):
        A[i, b.start[i]:b.stop[i]:5] = 1.0 / b.count[i]
    S = 2.0**2 * 0.8 ** np.abs(index[:, None] - index[None, :])
    means = block_means(y, b, masked)
    expected = multivariate_normal(np.zeros(b.n), A @ S @ A.T).logpdf(means)
    assert block_loglik(means, b.count, 2.0, 0.8, b.gap) == pytest.approx(expected, abs=1e-6)

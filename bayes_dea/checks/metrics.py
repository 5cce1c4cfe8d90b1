"""Figures that say how well a prediction with its band agrees with a recording.

All functions accept nan cells (gaps, masked readings) and leave them out. Arrays have shape (n,).
R^2 rises with the signal, not with truth: show it beside the reduced chi^2, never alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..campaign.order import differences, median
from ..campaign.scratch import BLOCK, computed, copied, kept, pieces

Array = NDArray[np.float64]


def _columns(*arrays: ArrayLike) -> tuple[Array, ...]:
    """Arrays, scalars among them, as columns of one length (n,)."""
    return tuple(np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float)) for a in arrays)))


def _finite(*arrays: ArrayLike) -> Iterator[tuple[Array, ...]]:
    """Piece by piece the rows at which all arrays (scalars broadcast) are finite."""
    full = _columns(*arrays)
    for part in pieces(full[0].size, BLOCK):
        here = tuple(a[part] for a in full)
        good = np.isfinite(here[0])
        for a in here[1:]:
            good &= np.isfinite(a)
        yield tuple(a[good] for a in here) if not good.all() else here


def rmse(residuals: ArrayLike) -> float:
    """Root mean square of the residuals; nan where there are none."""
    total, n = 0.0, 0
    for (r,) in _finite(residuals):
        total, n = total + float(np.sum(r * r)), n + r.size
    return math.sqrt(total / n) if n else math.nan


def variance(x: ArrayLike) -> float:
    """Mean square distance from the mean; nan where there is nothing."""
    total, n = _sum(np.asarray(x, dtype=float))
    mean = total / n if n else 0.0
    return sum(float(np.sum((a - mean) ** 2)) for (a,) in _finite(x)) / n if n else math.nan


def r2(y: ArrayLike, prediction: ArrayLike) -> float:
    """Coefficient of determination 1 - sum (y - f)^2 / sum (y - mean y)^2; nan for constant y."""
    total, left, n = 0.0, 0.0, 0
    for a, f in _finite(y, prediction):
        total, left, n = total + float(np.sum(a)), left + float(np.sum((a - f) ** 2)), n + a.size
    mean = total / n if n else 0.0
    spread = sum(float(np.sum((a - mean) ** 2)) for a, _ in _finite(y, prediction))
    return 1.0 - left / spread if spread > 0 else math.nan


def reduced_chi2(residuals: ArrayLike, sd: ArrayLike, n_parameters: int = 0) -> float:
    """Sum (r/sd)^2 over the degrees of freedom n - n_parameters; nan where none are left."""
    total, n = 0.0, 0
    for r, s in _finite(residuals, sd):
        total, n = total + float(np.sum((r / s) ** 2)), n + r.size
    freedom = n - n_parameters
    return total / freedom if freedom > 0 else math.nan


def coverage(y: ArrayLike, mean: ArrayLike, sd: ArrayLike, level: float) -> float:
    """Share of y inside the central normal band of probability `level` (0.5, 0.9)."""
    from scipy.special import ndtri

    inside, n, width = 0, 0, ndtri(0.5 + level / 2)
    for a, m, s in _finite(y, mean, sd):
        inside, n = inside + int(np.count_nonzero(np.abs(a - m) <= width * s)), n + a.size
    return inside / n if n else math.nan


def pit(y: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Array:
    """Probability integral transform F(y) under normal predictions; nan where an input is nan."""
    from scipy.special import ndtr

    with np.errstate(divide="ignore", invalid="ignore"):
        return computed(lambda a, m, s: ndtr((a - m) / s), *_columns(y, mean, sd))


@dataclass(frozen=True)
class UniformityTest:
    """Kolmogorov-Smirnov test of PIT values with the effective number of independent ones."""

    statistic: float  # largest distance of the empirical distribution from the diagonal
    p_value: float
    n: int
    n_effective: float


def pit_uniformity(values: ArrayLike) -> UniformityTest:
    """Whether PIT values are uniform, dependence taken into account.

    Samples of one recording are dependent; the test counts n divided by the integrated autocorrelation time
    of the values, which is on the safe side (under AR(1) of 0.8 it rejects less often than stated). On a
    handful of effective samples it says little.
    """
    from scipy.special import kolmogorov

    full = np.asarray(values, dtype=float)
    v = kept(full, _good(full))
    n = v.size
    if n < 2:
        return UniformityTest(math.nan, math.nan, n, float(n))
    effective = effective_size(full)
    ordered = copied(v) if v is full else v
    ordered.sort()
    distance = 0.0
    for part in pieces(n, BLOCK):
        grid = np.arange(part.start + 1, part.stop + 1) / n
        here = ordered[part]
        distance = max(distance, float(np.max(grid - here)), float(np.max(here - grid + 1 / n)))
    root = math.sqrt(effective)
    # finite-size correction of Stephens 1970 (doi 10.1111/j.2517-6161.1970.tb00821.x)
    return UniformityTest(distance, float(kolmogorov(distance * (root + 0.12 + 0.11 / root))), n, effective)


def _good(x: Array) -> NDArray[np.bool_]:
    return computed(np.isfinite, x, dtype=np.bool_)


def _sum(x: Array) -> tuple[float, int]:
    """Sum of what is finite in a column, and how many cells that is."""
    total, n = 0.0, 0
    for (here,) in _finite(x):
        total, n = total + float(np.sum(here)), n + here.size
    return total, n


def autocorrelation(residuals: ArrayLike, lags: int | None = None) -> Array:
    """Autocorrelation at lags 0..lags (default n - 1); nan cells count as absent pairs.

    Each lag is divided by its number of pairs (so gaps do no harm). Shape (lags + 1,); nan where no pair is.
    """
    return _autocorrelation(np.asarray(residuals, dtype=float), lags)[0]


def _autocorrelation(x: Array, lags: int | None) -> tuple[Array, Array]:
    """Autocorrelation and the number of pairs at each lag."""
    from scipy import fft

    n = x.size
    lags = n - 1 if lags is None else min(lags, n - 1)
    total, count = _sum(x)
    if not count or n < 2:
        return np.full(max(lags, 0) + 1, np.nan), np.zeros(max(lags, 0) + 1)
    mean = total / count
    centred = computed(lambda a: np.where(np.isfinite(a), a - mean, 0.0), x)
    good = None if count == n else _good(x)
    pairs = n - np.arange(lags + 1.0)
    if lags <= 64:
        products = np.array([_lagged(centred, k) for k in range(lags + 1)])
        if good is not None:
            pairs = np.array([_pairs(good, k) for k in range(lags + 1)], dtype=float)
    elif n <= BLOCK:
        size = fft.next_fast_len(n + lags, real=True)
        spectrum = fft.rfft(centred, size)
        products = fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[:lags + 1]
        if good is not None:
            spectrum = fft.rfft(good.astype(float), size)
            pairs = np.rint(fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[:lags + 1])
    else:
        products = _products(centred, lags)
        if good is not None:
            pairs = np.rint(_products(good, lags))
    with np.errstate(divide="ignore", invalid="ignore"):
        gamma = np.where(pairs > 0, products / pairs, np.nan)
        return gamma / gamma[0], pairs


def _lagged(x: Array, k: int) -> float:
    """Sum of x_i x_(i + k)."""
    stop = x.size - k
    return sum(float(x[p] @ x[p.start + k:p.stop + k]) for p in pieces(stop, BLOCK))


def _pairs(good: NDArray[np.bool_], k: int) -> int:
    stop = good.size - k
    return sum(int(np.count_nonzero(good[p] & good[p.start + k:p.stop + k])) for p in pieces(stop, BLOCK))


def _products(x: NDArray, lags: int) -> Array:
    """`_lagged` at lags 0..lags of a long column, block against block."""
    from scipy import fft

    width = BLOCK // 2
    size = fft.next_fast_len(2 * width + min(lags + 1, width), real=True)
    out = np.zeros(lags + 1)
    for part in pieces(x.size, width):
        first = np.conj(fft.rfft(x[part].astype(float), size))
        for some in pieces(min(lags + 1, x.size - part.start), width):
            reach = x[part.start + some.start:part.stop + some.stop - 1].astype(float)
            out[some] += fft.irfft(first * fft.rfft(reach, size), size)[:some.stop - some.start]
    return out


def integrated_time(residuals: ArrayLike) -> float:
    """Integrated autocorrelation time 1 + 2 sum rho_k in samples (1: white, not below 0.05).

    Summed while pairs of neighbouring lags stay positive (Geyer 1992, doi 10.1214/ss/1177011137).
    """
    x = np.asarray(residuals, dtype=float)
    n = x.size
    if _sum(x)[1] < 4:
        return 1.0
    lags = min(n // 2, 8)  # white residuals, the usual case, are done at once
    while True:
        rho = np.nan_to_num(autocorrelation(x, lags))
        pairs = rho[:rho.size // 2 * 2].reshape(-1, 2).sum(axis=1)
        negative = np.flatnonzero(pairs <= 0)
        if negative.size or lags >= n // 2:
            stop = int(negative[0]) if negative.size else pairs.size
            # pairs must fall as well: what rises again is noise of the estimate
            return float(max(2 * np.minimum.accumulate(pairs[:stop]).sum() - 1, 0.05))
        lags = min(n // 2, lags * 8)
        if n > BLOCK and lags > BLOCK // 16:
            # so slow that means over a few rows tell: they leave n times the variance of the mean as it is
            width = -(-n // (BLOCK // 2))
            coarse = _means(x, width)
            return width * integrated_time(coarse) * variance(coarse) / variance(x)


def _means(x: Array, width: int) -> Array:
    """Means over so many rows, of what is finite; nan where nothing is."""
    out = np.empty(-(-x.size // width))
    for some in pieces(out.size, max(1, BLOCK // width)):
        here = x[some.start * width:some.stop * width]
        first = np.arange(0, here.size, width)
        good = np.isfinite(here)
        with np.errstate(invalid="ignore"):
            out[some] = np.add.reduceat(np.where(good, here, 0.0), first) / np.add.reduceat(good.astype(float), first)
    return out


def effective_size(residuals: ArrayLike) -> float:
    """Number of finite values over the integrated autocorrelation time, between 1 and that number."""
    n = _sum(np.asarray(residuals, dtype=float))[1]
    return float(min(max(n / integrated_time(residuals), 1.0), max(n, 1)))


@dataclass(frozen=True)
class TestResult:
    """Statistic of a test and its two-sided or upper-tail probability under independence."""

    __test__ = False  # not a test case for pytest

    statistic: float
    p_value: float


def runs_test(residuals: ArrayLike) -> TestResult:
    """Wald-Wolfowitz test: number of runs of one sign, as a standard normal (negative: too few).

    doi 10.1214/aoms/1177731909. Exact zeros and nan cells are left out.
    """
    a, b, turns = 0, 0, 0
    last: NDArray[np.bool_] = np.empty(0, np.bool_)
    for (r,) in _finite(residuals):
        positive = np.concatenate([last, r[r != 0] > 0])
        turns += int(np.count_nonzero(positive[1:] != positive[:-1]))
        a, b = a + int(positive[last.size:].sum()), b + int((~positive[last.size:]).sum())
        last = positive[-1:]
    n = a + b
    if min(a, b) == 0 or n < 3:
        return TestResult(math.nan, math.nan)
    runs = 1 + turns
    expected = 2 * a * b / n + 1
    variance = (expected - 1) * (expected - 2) / (n - 1)
    z = (runs - expected) / math.sqrt(variance) if variance > 0 else 0.0
    return TestResult(float(z), math.erfc(abs(z) / math.sqrt(2)))


def ljung_box(residuals: ArrayLike, lags: int = 20) -> TestResult:
    """Ljung-Box test of no autocorrelation up to `lags` (doi 10.1093/biomet/65.2.297)."""
    from scipy.special import gammaincc

    x = np.asarray(residuals, dtype=float)
    n = int(np.count_nonzero(np.isfinite(x)))
    if n <= lags + 1:
        return TestResult(math.nan, math.nan)
    rho, pairs = _autocorrelation(x, lags)
    # the textbook form has rho divided by n at every lag; here each lag has its own number of pairs
    q = (n + 2) / n * float(np.nansum(pairs[1:] * rho[1:] ** 2))
    return TestResult(q, float(gammaincc(lags / 2, q / 2)))


@dataclass(frozen=True)
class BinnedResiduals:
    """Standardised residuals in bins of time or voltage; shapes (bins + 1,), then (bins,)."""

    edges: Array
    count: NDArray[np.int64]
    mean: Array  # of r/sd: 0 if nothing is wrong
    rms: Array  # of r/sd: 1 if nothing is wrong
    mean_se: Array  # of the mean, from the integrated autocorrelation time of all residuals


def residuals_by_time(residuals: ArrayLike, sd: ArrayLike, time_s: ArrayLike,
                      bins: int = 50) -> BinnedResiduals:
    """Standardised residuals in even bins of time."""
    return _binned(residuals, sd, time_s, bins)


def residuals_by_voltage(residuals: ArrayLike, sd: ArrayLike, voltage_V: ArrayLike,
                         bins: int = 20) -> BinnedResiduals:
    """Standardised residuals in even bins of voltage (any other input will do)."""
    return _binned(residuals, sd, voltage_V, bins)


def _binned(residuals: ArrayLike, sd: ArrayLike, by: ArrayLike, bins: int) -> BinnedResiduals:
    r, s, x = _columns(residuals, sd, by)
    with np.errstate(divide="ignore", invalid="ignore"):
        full = computed(lambda a, b: a / b, r, s)
    low, high, n = math.inf, -math.inf, 0
    for _, at in _finite(full, x):
        if at.size:
            low, high, n = min(low, float(at.min())), max(high, float(at.max())), n + at.size
    if not n:
        nothing = np.full(bins, np.nan)
        return BinnedResiduals(np.full(bins + 1, np.nan), np.zeros(bins, np.int64), nothing, nothing, nothing)
    if high == low:
        high = low + (abs(low) * 1e-9 or 1.0)
    count, total, squares = np.zeros(bins, np.int64), np.zeros(bins), np.zeros(bins)
    for z, at in _finite(full, x):
        index = np.minimum(((at - low) * (bins / (high - low))).astype(np.int64), bins - 1)
        count += np.bincount(index, minlength=bins)
        total += np.bincount(index, z, bins)
        squares += np.bincount(index, z * z, bins)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = total / count
        rms = np.sqrt(squares / count)
        spread = np.sqrt(np.maximum(rms**2 - mean**2, 0))
        se = spread * np.sqrt(np.minimum(max(integrated_time(full), 1.0), count) / count)
    return BinnedResiduals(np.linspace(low, high, bins + 1), count, mean, rms, se)


@dataclass(frozen=True)
class ResidualSpectrum:
    """One-sided power spectral density of residuals, unit^2/Hz, shape (m,)."""

    frequency_Hz: Array
    density: Array
    white: float  # density of white noise of the same variance


def residual_spectrum(residuals: ArrayLike, time_s: ArrayLike, segment: int = 4096) -> ResidualSpectrum:
    """Welch spectrum of the residuals; nan cells count as zero and the density is scaled up for them.

    Uneven time is taken at its median step.
    """
    from scipy.signal import welch

    r, t = np.asarray(residuals, dtype=float), np.asarray(time_s, dtype=float)
    total, seen = _sum(r)
    known = _good(t)
    if seen < 8 or np.count_nonzero(known) < 2:
        return ResidualSpectrum(np.empty(0), np.empty(0), math.nan)
    rate = 1.0 / median(differences(t, known))
    mean = total / seen
    width = min(segment, r.size)
    # pieces of whole segments, each half over the one before; welch leaves out what is over at the end
    step = width - width // 2
    number = (r.size - width) // step + 1
    power = np.zeros(width // 2 + 1)
    for some in pieces(number, max(1, BLOCK // step)):
        here = r[some.start * step:(some.stop - 1) * step + width]
        centred = np.where(np.isfinite(here), here - mean, 0.0)
        f, density = welch(centred, fs=rate, nperseg=width, detrend=False)
        power += density * ((some.stop - some.start) / number)
    return ResidualSpectrum(f[1:], power[1:] * (r.size / seen), 2 * variance(r) / rate)

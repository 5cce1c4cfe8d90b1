"""Figures that say how well a prediction with its band agrees with a recording.

All functions accept nan cells (gaps, masked readings) and leave them out. Arrays have shape (n,).
R^2 rises with the signal, not with truth: show it beside the reduced chi^2, never alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def _finite(*arrays: ArrayLike) -> tuple[Array, ...]:
    """The rows at which all arrays (scalars broadcast) are finite."""
    full = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in arrays))
    good = np.isfinite(full[0])
    for a in full[1:]:
        good &= np.isfinite(a)
    return tuple(a[good] for a in full) if not good.all() else tuple(full)


def rmse(residuals: ArrayLike) -> float:
    """Root mean square of the residuals; nan where there are none."""
    (r,) = _finite(residuals)
    return float(np.sqrt(np.mean(r * r))) if r.size else math.nan


def r2(y: ArrayLike, prediction: ArrayLike) -> float:
    """Coefficient of determination 1 - sum (y - f)^2 / sum (y - mean y)^2; nan for constant y."""
    a, f = _finite(y, prediction)
    total = float(np.sum((a - a.mean()) ** 2)) if a.size else 0.0
    return 1.0 - float(np.sum((a - f) ** 2)) / total if total > 0 else math.nan


def reduced_chi2(residuals: ArrayLike, sd: ArrayLike, n_parameters: int = 0) -> float:
    """Sum (r/sd)^2 over the degrees of freedom n - n_parameters; nan where none are left."""
    r, s = _finite(residuals, sd)
    freedom = r.size - n_parameters
    return float(np.sum((r / s) ** 2)) / freedom if freedom > 0 else math.nan


def coverage(y: ArrayLike, mean: ArrayLike, sd: ArrayLike, level: float) -> float:
    """Share of y inside the central normal band of probability `level` (0.5, 0.9)."""
    from scipy.special import ndtri

    a, m, s = _finite(y, mean, sd)
    return float(np.mean(np.abs(a - m) <= ndtri(0.5 + level / 2) * s)) if a.size else math.nan


def pit(y: ArrayLike, mean: ArrayLike, sd: ArrayLike) -> Array:
    """Probability integral transform F(y) under normal predictions; nan where an input is nan."""
    from scipy.special import ndtr

    with np.errstate(divide="ignore", invalid="ignore"):
        z = (np.asarray(y, dtype=float) - np.asarray(mean, dtype=float)) / np.asarray(sd, dtype=float)
    return np.asarray(ndtr(z), dtype=float)


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
    (v,) = _finite(full)
    n = v.size
    if n < 2:
        return UniformityTest(math.nan, math.nan, n, float(n))
    effective = effective_size(full)
    ordered = np.sort(v)
    grid = np.arange(1, n + 1) / n
    distance = float(max(np.max(grid - ordered), np.max(ordered - grid + 1 / n)))
    root = math.sqrt(effective)
    # finite-size correction of Stephens 1970 (doi 10.1111/j.2517-6161.1970.tb00821.x)
    return UniformityTest(distance, float(kolmogorov(distance * (root + 0.12 + 0.11 / root))), n, effective)


def autocorrelation(residuals: ArrayLike, lags: int | None = None) -> Array:
    """Autocorrelation at lags 0..lags (default n - 1); nan cells count as absent pairs.

    Each lag is divided by its number of pairs (so gaps do no harm). Shape (lags + 1,); nan where no pair is.
    """
    return _autocorrelation(np.asarray(residuals, dtype=float), lags)[0]


def _autocorrelation(x: Array, lags: int | None) -> tuple[Array, Array]:
    """Autocorrelation and the number of pairs at each lag."""
    from scipy import fft

    good = np.isfinite(x)
    n = x.size
    lags = n - 1 if lags is None else min(lags, n - 1)
    if not good.any() or n < 2:
        return np.full(max(lags, 0) + 1, np.nan), np.zeros(max(lags, 0) + 1)
    centred = np.where(good, x - x[good].mean(), 0.0)
    if lags <= 64:
        products = np.array([centred[:n - k] @ centred[k:] for k in range(lags + 1)])
        pairs = np.array([np.count_nonzero(good[:n - k] & good[k:]) for k in range(lags + 1)], dtype=float) \
            if not good.all() else n - np.arange(lags + 1.0)
    else:
        size = fft.next_fast_len(n + lags, real=True)
        spectrum = fft.rfft(centred, size)
        products = fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[:lags + 1]
        if good.all():
            pairs = n - np.arange(lags + 1.0)
        else:
            spectrum = fft.rfft(good.astype(float), size)
            pairs = np.rint(fft.irfft(spectrum.real**2 + spectrum.imag**2, size)[:lags + 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        gamma = np.where(pairs > 0, products / pairs, np.nan)
        return gamma / gamma[0], pairs


def integrated_time(residuals: ArrayLike) -> float:
    """Integrated autocorrelation time 1 + 2 sum rho_k in samples (1: white, not below 0.05).

    Summed while pairs of neighbouring lags stay positive (Geyer 1992, doi 10.1214/ss/1177011137).
    """
    x = np.asarray(residuals, dtype=float)
    n = x.size
    if np.count_nonzero(np.isfinite(x)) < 4:
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


def effective_size(residuals: ArrayLike) -> float:
    """Number of finite values over the integrated autocorrelation time, between 1 and that number."""
    n = int(np.count_nonzero(np.isfinite(np.asarray(residuals, dtype=float))))
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
    (r,) = _finite(residuals)
    positive = r[r != 0] > 0
    a, b = int(positive.sum()), int((~positive).sum())
    n = a + b
    if min(a, b) == 0 or n < 3:
        return TestResult(math.nan, math.nan)
    runs = 1 + int(np.count_nonzero(positive[1:] != positive[:-1]))
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
    r, s, x = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (residuals, sd, by)))
    with np.errstate(divide="ignore", invalid="ignore"):
        full = r / s
    z, x = _finite(full, x)
    if z.size == 0:
        nothing = np.full(bins, np.nan)
        return BinnedResiduals(np.full(bins + 1, np.nan), np.zeros(bins, np.int64), nothing, nothing, nothing)
    low, high = float(x.min()), float(x.max())
    if high == low:
        high = low + (abs(low) * 1e-9 or 1.0)
    index = np.minimum(((x - low) * (bins / (high - low))).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.bincount(index, z, bins) / count
        rms = np.sqrt(np.bincount(index, z * z, bins) / count)
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
    good = np.isfinite(r)
    steps = np.diff(t[np.isfinite(t)])
    if good.sum() < 8 or steps.size == 0:
        return ResidualSpectrum(np.empty(0), np.empty(0), math.nan)
    rate = 1.0 / float(np.median(steps))
    centred = np.where(good, r - r[good].mean(), 0.0)
    f, density = welch(centred, fs=rate, nperseg=min(segment, r.size), detrend=False)
    return ResidualSpectrum(f[1:], density[1:] * (good.size / good.sum()), 2 * float(np.var(r[good])) / rate)

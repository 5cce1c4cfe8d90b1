"""Noise level and autocorrelation from stretches in which nothing happens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from bayes_dea.campaign.order import median
from bayes_dea.campaign.pace import pace_of
from bayes_dea.campaign.rhythm import with_a_reading
from bayes_dea.campaign.scratch import BLOCK, beside, computed, copied, kept, pieces
from bayes_dea.noise.edges import input_noise

from ..compiled import njit

Array = NDArray[np.float64]
LAGS = 20
#: missing readings in a row that are bridged, and the share of a window's rows that has to be read all the same
_BRIDGED, _READ = 8, 0.5
#: correlation times, 1 / (1 - rho) rows, that windows are to be long, and rows of the longest; correlations (of either
#: sign) that windows of any length tell, and the largest of all
_LONG_ENOUGH, _LONGEST, _TOLD, MOST_RHO = 12.0, 1 << 16, 0.99, 0.9999


@dataclass(frozen=True)
class QuietNoise:
    """Noise of one recording, in the unit of its output."""

    sd: float  # marginal standard deviation
    rho: float  # lag-one correlation of the AR(1) process that was fitted
    autocorrelation: Array = field(repr=False)  # lags 0..20, shape (21,); nan without quiet stretches
    n: int  # samples used (fewer where windows are short for the correlation); 0 where there is no quiet stretch
    warnings: tuple[str, ...] = ()


def quiet_noise(y: ArrayLike, u: ArrayLike, time_s: ArrayLike, *, mask: ArrayLike | None = None,
                settle_s: float = 0.3, lines_Hz: Sequence[float] = ()) -> QuietNoise:
    """Sd and autocorrelation of the noise where the input stands still.

    Stretches of constant input, from `settle_s` (and at least one window) after its last change on, are
    cut into windows of 256, 128 or 64 samples, or longer ones where the noise is correlated over more than a twelfth of
    these; a parabola is taken off each, so that creep does not count, and what swings at `lines_Hz`.
    Up to 8 missing readings in a row, drop-outs or gaps, end no stretch: they are bridged for the parabola and do not
    count. Readings beyond five robust sds (MAD) of their window are bridged, and windows of more than six
    times the median variance left out. What is taken off is given back to the autocovariance, exactly for
    an AR(1) process. Mains raises it: name its lines.

    Of a sensor that is read at every k-th row, these rows are looked at (`reading_every`); of one that was read at a
    slower pace for a while, the others (`pace_of`).

    Where no stretch is quiet, the sd comes from fourth differences, as if the noise were white, and a
    warning says so.

    Parameters
    ----------
    y, u, time_s : output, input, time, shape (n,); nan cells of y are gaps.
    mask : True where y is not to be used (drop-outs). lines_Hz : frequencies of mains lines.
    """
    values, drive = np.asarray(y, dtype=float), np.asarray(u, dtype=float)
    t = np.asarray(time_s, dtype=float)
    read = with_a_reading(values)
    values, drive, t = values[read], drive[read], t[read]
    masked = beside(values, np.bool_) if mask is None else np.asarray(mask, dtype=bool)[read]
    known = computed(lambda b, c: np.isfinite(b) & np.isfinite(c), drive, t, dtype=np.bool_)
    good = computed(lambda a, k, m: np.isfinite(a) & k & ~m, values, known, masked, dtype=np.bool_)
    lost = computed(lambda k, g: k & ~g, known, good, dtype=np.bool_)
    pace = pace_of(kept(t, good))
    if pace.slow:
        # rows at a slower pace are correlated otherwise
        good[np.flatnonzero(good)[pace.is_slow(int(np.count_nonzero(good)))]] = False
    finite = kept(drive, good)
    if finite.size < 64:
        return _without_rest(kept(values, good))
    step = pace.step_s
    tolerance = stillness(finite)
    settle = round(settle_s / step) if step > 0 else 0
    whole, filled = good, values
    if lost.any():
        whole, filled = copied(good), copied(values)
        _bridge(filled, whole, drive, lost, tolerance, _BRIDGED)
    angles = [2 * np.pi * f * step for f in lines_Hz]

    def windows(width: int) -> NDArray[np.int64]:
        starts = still_windows(drive, whole, tolerance, width, max(settle, width))
        if whole is good:
            return starts
        return starts[np.array([np.mean(good[k : k + width]) >= _READ for k in starts], dtype=np.bool_)]

    for width in (256, 128, 64):
        starts = windows(width)
        if starts.size >= 8 or (width == 64 and starts.size):
            found = _from_windows(filled, good, starts, width, angles)
            while (1.0 - found.rho) * width < _LONG_ENOUGH and width < _LONGEST:
                # a parabola takes off most of what is correlated over as long as it
                width *= 2
                starts = windows(width)
                if starts.size < 8:
                    break
                found = _from_windows(filled, good, starts, width, angles)
            return found
    return _without_rest(kept(values, good))


@njit(cache=True)
def _bridge(y, good, u, lost, tolerance, most):
    """Straight over runs of up to `most` lost rows, in place, where u (n,) stands still; they are good then."""
    i = 1
    while i < y.size:
        if not lost[i] or not good[i - 1]:
            i += 1
            continue
        j = i + 1
        while j < y.size and lost[j]:
            j += 1
        if j < y.size and good[j] and j - i <= most and u[i - 1 : j + 1].max() - u[i - 1 : j + 1].min() <= tolerance:
            for k in range(i, j):
                y[k] = y[i - 1] + (y[j] - y[i - 1]) * (k - i + 1) / (j - i + 1)
                good[k] = True
        i = j


def standard_errors(n: Sequence[int], rho: Sequence[float]) -> tuple[float, float]:
    """Standard errors of log sd and atanh rho from recordings of n readings of AR(1) noise each; one a number.

    var(sd^2) is 2 sd^4 (1 + rho^2) / ((1 - rho^2) n) and var(rho) is (1 - rho^2) / n (Bartlett): of what is correlated
    over many readings few are independent.
    """
    count, square = np.array(n, dtype=float), np.minimum(np.abs(np.array(rho, dtype=float)), MOST_RHO) ** 2
    level, colour = np.sum(2.0 * count * (1.0 - square) / (1.0 + square)), np.sum(count * (1.0 - square))
    return float(1.0 / np.sqrt(max(level, 1e-9))), float(1.0 / np.sqrt(max(colour, 1e-9)))


def stillness(u: Array) -> float:
    """Within what an input (n,), all finite, stands still, in its unit: half a per cent of its span or its noise."""
    return float(max(0.005 * float(u.max() - u.min()), 8 * input_noise(u)))


@njit(cache=True)
def still_windows(u, good, tolerance, width, settle):
    """First rows of windows inside stretches in which u keeps within the tolerance."""
    n = u.size
    out = np.empty(n // width + 1, dtype=np.int64)
    k = 0
    i = 0
    changed = False  # before the first change the actuator rests: nothing has to settle
    while i < n:
        if not good[i]:
            i += 1
            continue
        j = i + 1
        low = u[i]
        high = u[i]
        while j < n and good[j]:
            low = min(low, u[j])
            high = max(high, u[j])
            if high - low > tolerance:
                break
            j += 1
        first = i + settle if changed else i
        while first + width <= j:
            out[k] = first
            k += 1
            first += width
        if j < n and good[j]:
            changed = True
        i = j
    return out[:k].copy()


def _from_windows(
    y: Array, good: NDArray[np.bool_], starts: NDArray[np.int64], width: int, lines: Sequence[float] = ()
) -> QuietNoise:
    """good (n,): rows that count. lines: angles from sample to sample of what is taken off each window beside a
    parabola."""
    most = 4000 * 256 // width if width > 256 else 4000  # a million samples say enough
    if starts.size > most:
        starts = starts[np.linspace(0, starts.size - 1, most).astype(int)]
    x = np.linspace(-1, 1, width)
    angles = np.arange(width) * np.array(lines)[:, None]
    basis, _ = np.linalg.qr(np.stack([np.ones(width), x, x * x, *np.cos(angles), *np.sin(angles)], axis=1))
    rows, read = y[starts[:, None] + np.arange(width)], good[starts[:, None] + np.arange(width)]
    rows = rows - rows[:, :1]  # keeps digits of small noise on a large offset
    residual = rows - (rows @ basis) @ basis.T
    size = np.abs(residual)
    # a coarse quantisation can make the MAD of a window vanish
    scale = np.maximum(1.4826 * np.median(size, axis=1), 0.2 * float(np.median(size.max(axis=1))))[:, None]
    out = size > 5 * scale
    for _ in range(2 if out.any() else 0):
        # bridged and again: the parabola had bent towards them, and what replaces them must be as correlated
        flat, gone = rows.ravel(), out.ravel()
        at = np.arange(flat.size)
        rows = np.where(gone, np.interp(at, at[~gone], flat[~gone]), flat).reshape(rows.shape)
        residual = rows - (rows @ basis) @ basis.T
        out = np.abs(residual) > 5 * scale
    residual[~read] = 0.0
    variance = np.sum(residual**2, axis=1) / np.sum(read, axis=1)
    # without windows in which something happened; a trimmed mean would be biased: windows of
    # correlated noise hold few independent values
    calm = variance <= 6 * float(np.median(variance))
    keep, read = residual[calm], read[calm]
    pairs = [max(int(np.count_nonzero(read[:, :width - k] & read[:, k:])), 1) for k in range(LAGS + 1)]
    observed = np.array([float(np.sum(keep[:, :width - k] * keep[:, k:])) / pairs[k] for k in range(LAGS + 1)])
    if not observed[0] > 0:
        return QuietNoise(0.0, 0.0, np.r_[1.0, np.zeros(LAGS)], pairs[0],
                          ("the recording does not scatter at all where its input stands still",))
    # what is correlated over longer than a window cannot be told from creep
    largest = min(max(_TOLD, 1.0 - 2.0 / width), MOST_RHO)
    rho = float(np.clip(observed[1] / observed[0], -0.95, 0.95))
    gamma = observed
    for _ in range(8):
        taken = _ar1_expected(rho, width, basis)
        true = rho ** np.arange(LAGS + 1)
        level = observed[0] / taken[0]
        gamma = observed + level * (true - taken)
        rho = float(np.clip(gamma[1] / gamma[0], -_TOLD, largest))
    # short windows tell less of it than they have readings
    told = min(1.0, (1.0 - rho) * width / _LONG_ENOUGH)
    return QuietNoise(float(np.sqrt(gamma[0])), rho, gamma / gamma[0], max(int(told * pairs[0]), 1))


def _ar1_expected(rho: float, width: int, basis: Array) -> Array:
    """Expected autocovariances, lags 0..20, of unit AR(1) noise after the projection.

    Means of the diagonals of (1 - BB') R (1 - BB') with basis B (width, m); of R, RB alone is made, by recursions.
    """
    recursion = [1.0], [1.0, -rho]
    RB = lfilter(*recursion, basis, axis=0) + lfilter(*recursion, basis[::-1], axis=0)[::-1] - basis
    BRB = basis @ (basis.T @ RB)
    out = np.empty(LAGS + 1)
    for k in range(LAGS + 1):
        early, late = slice(0, width - k), slice(k, width)
        one = np.sum(basis[early] * RB[late]) + np.sum(RB[early] * basis[late]) - np.sum(BRB[early] * basis[late])
        out[k] = rho**k - one / (width - k)
    return out


def _without_rest(y: Array) -> QuietNoise:
    nothing = np.full(LAGS + 1, np.nan)
    if y.size < 16:
        return QuietNoise(float("nan"), 0.0, nothing, 0, ("too few rows to estimate the noise",))
    # a piece of fourth differences needs four rows more
    size = median(lambda: (np.abs(np.diff(y[p.start:p.stop + 4], n=4)) for p in pieces(y.size - 4, BLOCK)))
    # variance of a fourth difference of white noise: 1 + 16 + 36 + 16 + 1
    sd = 1.4826 * size / np.sqrt(70.0)
    return QuietNoise(sd, 0.0, nothing, 0,
                      ("no stretch of constant input is long enough; the noise was estimated from "
                       "differences as if it were white: record a rest before the first edge",))

"""Data reduction: means over blocks that are short after edges of the input and grow with time.

Block means of the data are compared with block means of the simulation over the same blocks, never with
its value in the middle. The covariance of block means of AR(1) noise has a closed form and is, off its
diagonal, of rank one on either side (semiseparable), so its exact Cholesky factor costs O(blocks).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.order import differences, median
from bayes_dea.campaign.pace import Pace, pace_of
from bayes_dea.campaign.rhythm import reading_every
from bayes_dea.campaign.scratch import beside, computed, kept
from bayes_dea.errors import InputError
from bayes_dea.noise.edges import find_edges, input_noise

from ..compiled import njit, read_only

Array = NDArray[np.float64]
#: rows read at a slower pace that stay alone; of more than these blocks are cut, as if all were as correlated
_MOST_SLOW = 20_000


@dataclass(frozen=True)
class BlockSettings:
    """How blocks are cut. `per_decade` blocks a decade of time since the last edge."""

    single_after_edge: int = 20  # samples after an edge that stay alone
    # and before one: of correlated noise they tell the size at the edge, without which fast modes lose 3 % in sd
    single_before_edge: int = 10
    per_decade: float = 22.0
    longest_s: float = 5.0
    input_share: float = 0.015  # change of the input within a block, as a share of its range


#: share of a recording for which readings have to be missing for that to be a hole in a picture
LONG = 0.01


@dataclass(frozen=True)
class Blocks:
    """Blocks of rows start[i]..stop[i]-1 of one recording, in rising order, never overlapping.

    gap[i] is the number of sample steps from the last row of block i-1 to the first row of block i
    (1 where they touch); gap[0] is 1. count[i] is the number of rows that are not masked.
    """

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    count: NDArray[np.int64]
    gap: NDArray[np.int64]
    time_s: Array  # mean time of the rows counted
    duration_s: Array  # from the row before the block (its first held interval) to its last row

    @property
    def n(self) -> int:
        """Number of blocks."""
        return int(self.start.size)

    def behind_missing(self) -> NDArray[np.int64]:
        """Blocks (k,) before which readings are missing for more than `LONG` of the recording: no line leads there."""
        apart = np.diff(self.time_s) - 0.5 * (self.duration_s[1:] + self.duration_s[:-1])
        return np.flatnonzero((self.gap[1:] > 1) & (apart > LONG * (self.time_s[-1] - self.time_s[0]))) + 1


def log_blocks(time_s: ArrayLike, u: ArrayLike, settings: BlockSettings | None = None, *,
               y: ArrayLike | None = None, mask: ArrayLike | None = None, kinks: ArrayLike | None = None) -> Blocks:
    """Cut a recording into blocks.

    Every sample stays alone for the first samples after an edge of the input; then blocks grow in
    proportion to the time since the edge, up to `longest_s`. A block never crosses an edge or a gap, and
    within it the input changes by at most `input_share` of its range. Where that cuts blocks short, the
    ones that follow grow from that length, so that the answer to a fast ramp is kept as finely as the ramp.

    Parameters
    ----------
    time_s : shape (n,), rising; nan rows are gaps.
    u : input (voltage, or its square, or position), shape (n,).
    settings : how blocks are cut.
    y : observed column, shape (n,); nan rows are gaps and belong to no block, but for masked ones.
    mask : bool, shape (n,); True rows (drop-outs, what a slow sensor was not read at) stay inside their block
        but do not count. A block with nothing but masked rows is left out. Of a sensor that is read at every
        k-th row a block begins and ends with a reading, and gaps are counted in its readings.
    kinks : rows that are treated like edges although the input does not jump there (`kinks.find_kinks`).

    Raises
    ------
    InputError : lengths differ, or settings are not positive.
    """
    s = settings or BlockSettings()
    t = np.ascontiguousarray(time_s, dtype=float)
    v = np.ascontiguousarray(u, dtype=float)
    masked = beside(t, np.bool_) if mask is None else np.ascontiguousarray(mask, dtype=np.bool_)
    data = t if y is None else np.asarray(y, dtype=float)
    if not t.shape == v.shape == masked.shape == data.shape or t.ndim != 1:
        raise InputError(f"blocks: time, input, data and mask must be rows of one length, got {t.shape}, "
                         f"{v.shape}, {data.shape}, {masked.shape}; check the columns of the recording")
    good = computed(lambda a, b, c, m: np.isfinite(a) & np.isfinite(b) & (np.isfinite(c) | m), t, v, data, masked,
                    dtype=np.bool_)
    if min(s.per_decade, s.longest_s, s.input_share) <= 0 or min(s.single_after_edge, s.single_before_edge) < 0:
        raise InputError(f"blocks: settings must be positive, got {s}")
    edge, alone = beside(t, np.bool_), beside(t, np.bool_)
    finite = kept(v, good)
    at = find_edges(v if finite is v else computed(lambda a, g: np.where(g, a, np.nan), v, good))
    if kinks is not None:
        at = np.union1d(at, np.asarray(kinks, dtype=np.int64))
    edge[at] = True
    for k in range(1, s.single_before_edge + 1):
        alone[np.maximum(np.asarray(at) - k, 0)] = True
    spread = float(finite.max() - finite.min()) if finite.size else 0.0
    tolerance = s.input_share * spread if spread > 0 else math.inf
    # what the scatter of a measured input does must not cut blocks
    noise = input_noise(finite) if spread > 0 else 0.0
    pace = pace_of(kept(t, good)) if finite.size > 1 else Pace(1.0, ())
    step = pace.step_s
    slow = pace.is_slow(finite.size) if pace.slow else np.empty(0, dtype=np.bool_)
    if 0 < np.count_nonzero(slow) <= _MOST_SLOW:
        # means of rows that are nearly independent beside rows that are not: alone each is exact
        alone[np.flatnonzero(good)[slow]] = True
    start, stop = _cut(read_only(t), read_only(v), good, edge, alone, tolerance, noise,
                       10.0 ** (1.0 / s.per_decade) - 1.0, s.longest_s, s.single_after_edge, step)
    count = _counts(masked, start, stop)
    keep = count > 0
    start, stop, count = start[keep], stop[keep], count[keep]
    first, every = reading_every(data)
    if every > 1:
        start = first - every * ((first - start) // every)
        stop = first + every * ((stop - 1 - first) // every) + 1
        step = median(differences(t[first::every], good[first::every]))
    gap = np.ones(start.size, dtype=np.int64)
    if start.size > 1:
        gap[1:] = np.maximum(1, np.rint((t[start[1:]] - t[stop[:-1] - 1]) / step)).astype(np.int64)
    row_before = np.maximum(start - 1, 0)
    before = np.where((start > 0) & good[row_before], t[row_before], t[start] - step)
    blocks = Blocks(start, stop, count, gap, np.empty(0), t[stop - 1] - before)
    return Blocks(start, stop, count, gap, block_means(t, blocks, masked), blocks.duration_s)


@njit(cache=True)
def _cut(t, u, good, edge, alone, tolerance, noise, growth, longest, single, step):
    """Starts and stops of blocks. The range of k rows of noise grows like 2 sd sqrt(2 log k)."""
    n = t.size
    start = np.empty(n, dtype=np.int64)
    stop = np.empty(n, dtype=np.int64)
    k = 0
    i = 0
    origin = 0.0  # time from which blocks grow
    since = n  # rows since the last edge; large before any, so that rest is not kept sample by sample
    fresh = True  # first row of a stretch: no edge is known, blocks grow from its start
    previous = 0.0
    while i < n:
        if not good[i]:
            i += 1
            fresh = True
            continue
        if fresh:
            # behind a gap in which the input stood still, blocks go on to grow from where they did
            stands = k > 0 and not edge[i]
            for j in range(stop[k - 1] if stands else i, i):
                stands = stands and not edge[j] and abs(u[j] - u[i]) <= noise * 8.0
            previous = t[i] - step
            if not stands:
                origin = previous
                since = single
            fresh = False
        if edge[i]:
            origin = previous
            since = 0
        allowed = min(longest, max((previous - origin) * growth, 0.0)) * (1 + 1e-9)
        low = u[i]
        high = u[i]
        j = i + 1
        cut_by_input = False
        if since >= single and not alone[i]:
            while j < n and good[j] and not edge[j] and not alone[j] and t[j] - previous <= allowed:
                low = min(low, u[j])
                high = max(high, u[j])
                if high - low > tolerance and high - low > noise * (4.0 + 2.0 * math.sqrt(2.0 * math.log(j + 1.0 - i))):
                    cut_by_input = True
                    break
                j += 1
        if j < n and good[j] and not edge[j] and not cut_by_input:
            # a step of the input by itself larger than the tolerance restarts growth as well
            cut_by_input = abs(u[j] - u[j - 1]) > max(tolerance, 8.0 * noise)
        start[k] = i
        stop[k] = j
        k += 1
        since += j - i
        length = t[j - 1] - previous
        previous = t[j - 1]
        if cut_by_input:
            # as if an edge lay so far back that blocks of this length are due
            origin = max(origin, previous - length / growth)
        i = j
    return start[:k].copy(), stop[:k].copy()


@njit(cache=True)
def _counts(masked, start, stop):
    out = np.empty(start.size, dtype=np.int64)
    for k in range(start.size):
        m = 0
        for i in range(start[k], stop[k]):
            if not masked[i]:
                m += 1
        out[k] = m
    return out


def block_means(x: ArrayLike, blocks: Blocks, mask: ArrayLike | None = None) -> Array:
    """Means over blocks of rows that are not masked.

    x has shape (..., n); the result (..., blocks.n). Pass the mask given to `log_blocks` to data and
    simulation alike, so that both are averaged over the same rows.
    """
    a = np.asarray(x, dtype=float)
    flat = read_only(a.reshape(-1, a.shape[-1]))
    masked = beside(flat[0], np.bool_) if mask is None else np.ascontiguousarray(mask, np.bool_)
    return _means(flat, masked, blocks.start, blocks.stop).reshape(*a.shape[:-1], blocks.n)


@njit(cache=True)
def _means(x, masked, start, stop):
    out = np.empty((x.shape[0], start.size))
    for r in range(x.shape[0]):
        for k in range(start.size):
            total = 0.0
            m = 0
            for i in range(start[k], stop[k]):
                if not masked[i]:
                    total += x[r, i]
                    m += 1
            out[r, k] = total / m if m else np.nan
    return out


@njit(cache=True)
def _sums(m, rho):
    """(sum of rho^k for k < m, sum of (m - k) rho^k for 1 <= k < m, rho^(m - 1)); m >= 1, |rho| < 1."""
    if m == 1 or rho == 0.0:
        return 1.0, 0.0, 1.0 if m == 1 else 0.0
    d = 1.0 - rho
    power = rho ** (m - 1.0)
    if m * d < 0.02:
        # the closed forms lose digits as rho -> 1: binomial series in d
        c = 0.5 * m * (m - 1.0)
        weighted = c
        geometric = m - c * d
        for k in range(3, 9):
            c *= -(m - k + 1.0) / k * d
            weighted += c
            geometric -= c * d
        return geometric, rho * weighted, power
    geometric = (1.0 - power * rho) / d
    return geometric, rho * (m - geometric) / d, power


@njit(cache=True)
def _variance_of_mean(m, sigma, rho):
    out = np.empty(m.size)
    for i in range(m.size):
        _, weighted, _ = _sums(m[i], rho)
        out[i] = sigma * sigma * (m[i] + 2.0 * weighted) / (float(m[i]) * m[i])
    return out


def variance_of_mean(counts: ArrayLike, sigma: float, rho: float) -> Array:
    """Exact variance of the mean of m AR(1) samples: sigma^2/m^2 [m + 2 sum_k (m-k) rho^k], closed form.

    counts: integers >= 1, shape (n,); sigma: marginal sd; rho: lag-one correlation, |rho| < 1.
    """
    _check_noise(sigma, rho)
    return _variance_of_mean(np.ascontiguousarray(counts, dtype=np.int64), float(sigma), float(rho))


@njit(cache=True)
def _covariance_of_neighbours(m, gap, sigma, rho):
    out = np.empty(max(m.size - 1, 0))
    for i in range(1, m.size):
        a, _, _ = _sums(m[i - 1], rho)
        b, _, _ = _sums(m[i], rho)
        lag = 0.0 if rho == 0.0 else rho ** float(gap[i])
        out[i - 1] = sigma * sigma * lag * a * b / (float(m[i - 1]) * m[i])
    return out


def covariance_of_neighbours(counts: ArrayLike, sigma: float, rho: float,
                             gaps: ArrayLike | None = None) -> Array:
    """Exact covariance of the means of blocks i and i+1 of AR(1) noise, shape (n - 1,).

    sigma^2 rho^gap s(m_i) s(m_{i+1}) / (m_i m_{i+1}) with s(m) = (1 - rho^m)/(1 - rho).
    """
    _check_noise(sigma, rho)
    m = np.ascontiguousarray(counts, dtype=np.int64)
    return _covariance_of_neighbours(m, _gaps(gaps, m.size), float(sigma), float(rho))


_SLOTS = 256  # power of two; block lengths of a campaign are about a hundred different numbers


@njit(cache=True)
def _mean_terms(m, sigma, rho, white):
    """Of each block: u = s(m)/m, variance a of its mean, rho^(m-1); powers are taken once a length."""
    key = np.zeros(_SLOTS, dtype=np.int64)
    kept = np.empty((_SLOTS, 3))
    out = np.empty((m.size, 3))
    for i in range(m.size):
        slot = m[i] & (_SLOTS - 1)
        if key[slot] != m[i]:
            s, weighted, through = _sums(m[i], rho)
            size = float(m[i])
            key[slot] = m[i]
            kept[slot, 0] = s / size
            kept[slot, 1] = (size + 2.0 * weighted) / (size * size) * sigma * sigma + white / size
            kept[slot, 2] = through
        out[i, 0] = kept[slot, 0]
        out[i, 1] = kept[slot, 1]
        out[i, 2] = kept[slot, 2]
    return out


@njit(cache=True)
def _whiten(x, m, gap, sigma, rho, white, out):
    """`_whiten_terms` with further white noise of one variance a sample."""
    return _whiten_terms(x, gap, sigma, rho, _mean_terms(m, sigma, rho, white), out)


@njit(cache=True)
def _whiten_terms(x, gap, sigma, rho, terms, out):
    """Forward substitution with the exact Cholesky factor; returns the log-determinant of the covariance."""
    factor = np.empty((4, gap.size))
    logdet = _factor(gap, sigma, rho, terms, factor)
    _substitute(x, factor, out)
    return logdet


@njit(cache=True)
def _factor(gap, sigma, rho, terms, factor):
    """The exact Cholesky factor as a recursion; returns the log-determinant of the covariance.

    Its state, at the last row of the block before: f (one a column), the conditional mean of what remains correlated,
    and p, its variance under the factor. factor (4, n): what a block takes from its mean of f, one over the sd of what
    is left, and what f keeps of itself and takes from the block.
    """
    p = 0.0
    var = sigma * sigma
    logdet = 0.0
    product = 1.0
    for i in range(gap.size):
        u = terms[i, 0]
        a = terms[i, 1]
        through = terms[i, 2]
        lag = rho if gap[i] == 1 else (0.0 if rho == 0.0 else rho ** float(gap[i]))
        p *= lag * lag
        d = a - u * u * p
        w = (u * var - through * u * p) / d
        p = through * through * p + d * w * w
        factor[0, i] = u * lag
        factor[1, i] = 1.0 / math.sqrt(d)
        factor[2, i] = (through - w * u) * lag
        factor[3, i] = w
        product *= d
        if product < 1e-200 or product > 1e200:
            logdet += math.log(product)
            product = 1.0
    return logdet + math.log(product)


@njit(cache=True)
def _substitute(x, factor, out):
    """Columns x (k, n) whitened by a factor (4, n)."""
    for c in range(x.shape[0]):
        f = 0.0
        for i in range(x.shape[1]):
            z = x[c, i]
            out[c, i] = (z - factor[0, i] * f) * factor[1, i]
            f = factor[2, i] * f + factor[3, i] * z


@njit(cache=True)
def _loglik(x, gap, sigma, rho, terms):
    """As `_whiten_terms` for one column: log determinant plus sum of squares, without storing."""
    var = sigma * sigma
    f = 0.0
    p = 0.0
    logdet = 0.0
    squares = 0.0
    product = 1.0
    for i in range(gap.size):
        u = terms[i, 0]
        a = terms[i, 1]
        through = terms[i, 2]
        lag = rho if gap[i] == 1 else (0.0 if rho == 0.0 else rho ** float(gap[i]))
        p *= lag * lag
        up = u * p
        d = a - u * up
        inverse = 1.0 / d
        w = (u * var - through * up) * inverse
        p = through * through * p + d * w * w
        g = lag * f
        z = x[i] - u * g
        squares += z * z * inverse
        f = through * g + w * z
        product *= d
        if product < 1e-200 or product > 1e200:
            logdet += math.log(product)
            product = 1.0
    return logdet + math.log(product) + squares


def block_loglik(residual_means: ArrayLike, counts: ArrayLike, sigma: float, rho: float = 0.0,
                 gaps: ArrayLike | None = None, white_variance: ArrayLike = 0.0) -> float:
    """Exact log density of block means of AR(1) noise, all correlations kept.

    Parameters
    ----------
    residual_means : data minus simulation, block means, shape (n,).
    counts, gaps : of the blocks, shape (n,); see `Blocks`. No gaps: the blocks touch.
    sigma, rho : marginal sd and lag-one correlation of the AR(1) noise.
    white_variance : of further white noise a sample (quantisation: q^2/12), of all blocks or of each (n,).

    Masked rows count as if the rows beside them touched, which is exact where nothing is masked. Returns
    -inf outside sigma > 0, |rho| < 1.
    """
    if not (sigma > 0 and abs(rho) < 1 and np.all(np.asarray(white_variance) >= 0)):
        return -math.inf
    m = np.ascontiguousarray(counts, dtype=np.int64)
    x = np.ascontiguousarray(residual_means, dtype=np.float64)
    value = _loglik(x, _gaps(gaps, m.size), float(sigma), float(rho), _terms(m, sigma, rho, white_variance))
    return -0.5 * (value + m.size * math.log(2 * math.pi))


@dataclass(frozen=True)
class BlockFactor:
    """The Cholesky factor L of the covariance of block means under one noise, and log det of L L^T."""

    recursion: Array  # (4, n), see `_factor`
    logdet: float

    @classmethod
    def of(cls, counts: ArrayLike, sigma: float, rho: float = 0.0, gaps: ArrayLike | None = None,
           white_variance: ArrayLike = 0.0) -> BlockFactor:
        """Arguments and errors of `block_whiten`."""
        _check_noise(sigma, rho)
        if not np.all(np.asarray(white_variance) >= 0):
            raise ValueError(f"white_variance must be >= 0, got {white_variance!r}")
        m = np.ascontiguousarray(counts, dtype=np.int64)
        recursion = np.empty((4, m.size))
        terms = _terms(m, sigma, rho, white_variance)
        logdet = _factor(_gaps(gaps, m.size), float(sigma), float(rho), terms, recursion)
        return cls(recursion, float(logdet))

    def whiten(self, columns: Array) -> Array:
        """L^-1 x of columns x (k, n)."""
        x = np.ascontiguousarray(columns)
        out = np.empty_like(x)
        _substitute(x, self.recursion, out)
        return out


def block_whiten(columns: ArrayLike, counts: ArrayLike, sigma: float, rho: float = 0.0,
                 gaps: ArrayLike | None = None, white_variance: ArrayLike = 0.0) -> tuple[Array, float]:
    """Whitened columns L^-1 x and log det of the covariance L L^T of the block means.

    columns: shape (n,) or (k, n), each a column of block means (residuals, simulation, ones, Jacobian):
    what is linear, offset and gain, is integrated out in these coordinates. Returns the same shape. white_variance: see
    `block_loglik`.

    Raises
    ------
    ValueError : sigma <= 0, |rho| >= 1 or white_variance < 0.
    """
    factor = BlockFactor.of(counts, sigma, rho, gaps, white_variance)
    x = np.asarray(columns, dtype=np.float64)
    return factor.whiten(x.reshape(-1, x.shape[-1])).reshape(x.shape), factor.logdet


def _gaps(gaps: ArrayLike | None, n: int) -> NDArray[np.int64]:
    return np.ones(n, dtype=np.int64) if gaps is None else np.ascontiguousarray(gaps, dtype=np.int64)


def _terms(m: NDArray[np.int64], sigma: float, rho: float, white_variance: ArrayLike) -> Array:
    terms = np.asarray(_mean_terms(m, float(sigma), float(rho), 0.0))
    terms[:, 1] += np.asarray(white_variance, dtype=np.float64) / m
    return terms


def _check_noise(sigma: float, rho: float) -> None:
    if not (sigma > 0 and abs(rho) < 1):
        raise ValueError(f"AR(1) noise needs sigma > 0 and |rho| < 1, got sigma = {sigma}, rho = {rho}")

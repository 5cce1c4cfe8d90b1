"""Drop-outs of a laser sensor: isolated false readings, single or a few in a row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from bayes_dea.campaign.order import of, quantiles
from bayes_dea.campaign.scratch import BLOCK, beside, copied, pieces, rows_where
from bayes_dea.noise.edges import dense, find_edges

from ..compiled import njit, read_only

#: half-width in samples of the one-sided windows that give the local scale
_LOCAL = 25
#: share of its size by which a false reading also misses the straight continuations of either side
_KINK = 0.35
#: share of the readings that are one value where a sensor's range ends there, share of a stretch that makes it no
#: measure of noise, and stretches that are enough
_PILED, _AT_AN_END, _ENOUGH = 0.03, 0.1, 8
#: rows that a pulse of the input lasts at most, and beside it that answer to it
_BESIDE = 2
#: readings of normal noise that may pass for false in a column, however long: with fewer, those of 7 sds are missed in
#: more than a fifth of 100,000
_BY_CHANCE = 1e-2
#: edges of the input below which a lag that repeats cannot be seen, and samples after one in which a mass swings
_FEW_EDGES, _SOON = 10, 15


def find_dropouts(y: ArrayLike, u: ArrayLike, *, threshold: float = 5.2,
                  resolution: float | None = None) -> NDArray[np.bool_]:
    """Mask of drop-outs, True where a reading is false; shape (n,).

    A reading is false when it lies outside the range spanned by the medians of its neighbours *before*
    and *after* it, by more than `threshold` local robust sds, and also misses the straight continuations of
    both sides. So steps, ramps and kinks are not flagged; what the slope adds to the distance of the sides
    is taken off first, by its running median. Local scale: a typical value of the record or, where clearly
    larger, the one-sided medians of 25 samples before and after, so ringing raises its own threshold. Two
    lengths of side windows (3 and 9 samples) find single readings and runs of up to four. What happens at
    one and the same lag after many edges of the input answers to the input and is no drop-out, nor what
    stands beside a pulse of one or two rows;
    nor is what comes twice soon after one of few edges (a mass that swings), nor what noise takes below
    the end of a sensor's range, where most readings are that end.

    On normal noise, white or AR(1), the false-alarm rate is below 1e-6 a sample, and a long column has no more false
    alarms than a short one: the threshold rises with the number of readings (5.5 sds of 300,000).

    Parameters
    ----------
    y : observed column, shape (n,); nan cells are gaps and never flagged.
    u : input, shape (n,).
    threshold : in local robust sds of the difference to the neighbours (1.1 sd of white noise), at least.
    resolution : quantisation step; a spike below three steps is never flagged. None: the smallest step
        that occurs in y.
    """
    values = np.asarray(y, dtype=float)
    mask = beside(values, np.bool_)
    x, good = dense(np.ascontiguousarray(values))
    if x.size < 2 * _LOCAL + 1:
        return mask
    threshold = max(threshold, -float(ndtri(0.5 * _BY_CHANCE / x.size)))
    edges = find_edges(u)
    if good is not None:
        edges = np.unique(np.searchsorted(good, edges))
    edges = edges[edges < x.size].astype(np.int64)
    pulses = _pulses(edges, np.asarray(u, dtype=float), good)
    low, bottom, top, high = quantiles(of(x), [0.001, 0.005, 0.995, 0.999])
    ends = tuple(v for v in (bottom, top) if sum(np.count_nonzero(x[p] == v) for p in pieces(x.size)) > _PILED * x.size)
    floor = max(1e-3 * (high - low), 3.0 * (_smallest_step(x) if resolution is None else resolution))
    found = np.empty(0, dtype=np.int64)
    for side in (3, 9):
        new = _pass(bridged(x, found), side, threshold, floor, ends)
        if side > 3 and edges.size and new.size:
            # a short pulse of the input looks like a run
            reach = np.searchsorted(edges, new + side + 3, side="right") > np.searchsorted(edges, new - side - 3)
            new = new[~reach]
        found = np.union1d(found, new)
    if pulses.size and found.size:
        after = np.searchsorted(pulses, found)
        behind = found - pulses[np.maximum(after - 1, 0)]
        ahead = pulses[np.minimum(after, pulses.size - 1)] - found
        found = found[np.minimum(np.abs(behind), np.abs(ahead)) > _BESIDE]
    while edges.size and found.size:
        answers = _systematic(found, edges)
        if not answers.any():
            break
        found = found[~answers]  # what is left may be most of all at another lag
    mask[found if good is None else good[found]] = True
    return mask


def _pulses(edges: NDArray[np.int64], u: NDArray[np.float64], good: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """First rows of pulses of the input of one or two rows: up and down again, or the other way round."""
    at = edges if good is None else good[edges]
    jump = np.sign(u[at] - u[np.maximum(at - 1, 0)])
    return edges[:-1][(np.diff(edges) <= _BESIDE) & (jump[1:] * jump[:-1] < 0.0)] if edges.size > 1 else edges[:0]


def _smallest_step(x: NDArray[np.float64]) -> float:
    """Quantisation step of data that repeat values, else 0."""
    change = np.abs(np.diff(x[:20_000]))
    moved = change[change > 1e-9 * (max(float(x.max()), -float(x.min())) or 1.0)]
    if moved.size == 0 or moved.size > 0.98 * change.size:
        return 0.0
    return float(moved.min())


def _systematic(found: NDArray[np.int64], edges: NDArray[np.int64], reach: int = 60) -> NDArray[np.bool_]:
    """Which finds come at one lag after a twelfth of the edges, or, most of all, at one and the same lag.

    Where edges are few: right at an edge, or with another soon after the same one, as where a mass swings on a step.
    """
    early = edges - 1  # readings may stand up to a sample before the command
    last = np.searchsorted(early, found, side="right") - 1
    since = np.where(last >= 0, found - early[np.maximum(last, 0)], reach)
    lag = np.minimum(since, reach)
    counts = np.bincount(lag, minlength=reach + 1)[:reach]
    often = np.zeros(reach + 1, dtype=np.bool_)
    # an answer to the input may shift by a sample from edge to edge
    spread = np.convolve(counts, np.ones(3), mode="same")
    often[:reach] = (spread > max(3.0, 0.08 * edges.size)) | (spread > max(3.0, 0.5 * counts.sum()))
    if edges.size >= _FEW_EDGES:
        return np.asarray(often[lag])
    often[:4] = True
    soon = (last >= 0) & (since <= _SOON)
    apart = soon & (np.diff(found, prepend=-2) > 1)
    swings = np.bincount(last[apart], minlength=edges.size) > 1
    return np.asarray(often[lag] | soon & swings[last])


def bridged(x: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """A column (n,) in which some rows, rising, are replaced by straight lines between those beside them."""
    if not rows.size or rows.size == x.size:
        return x
    first = np.diff(rows, prepend=-2) > 1
    last = np.append(first[1:], True)
    ends = np.concatenate([rows[first] - 1, rows[last] + 1])
    ends = np.unique(ends[(ends >= 0) & (ends < x.size)])
    out = copied(x)
    out[rows] = np.interp(rows, ends, x[ends])
    return out


def _pass(x: NDArray[np.float64], side: int, threshold: float, floor: float, ends: tuple[float, ...]
          ) -> NDArray[np.int64]:
    medians = beside(x)
    _running_median(read_only(x), side, medians)
    # window of `side` samples that ends just before, or begins just after, each sample
    shift = side // 2 + 1
    size, difference = beside(x), beside(x)
    for part in pieces(x.size, BLOCK):
        before, after = _shifted(medians, shift, part), _shifted(medians, -shift, part)
        size[part] = np.abs(x[part] - 0.5 * (before + after))
        difference[part] = before - after
    typical = _typical(size, x, ends)
    limit = max(threshold * typical, floor)
    candidates = rows_where(lambda s: s > limit, size)
    keep = np.zeros(candidates.size, dtype=np.bool_)
    _judge(candidates, read_only(x), medians, size, difference, threshold, typical, floor, side, keep)
    return candidates[keep]


def _typical(size: NDArray[np.float64], x: NDArray[np.float64], ends: tuple[float, ...]) -> float:
    """Robust sd that holds where the record is quiet: low quantile of medians over short stretches.

    Where a sensor's range ends, most readings are that end, and their scatter is none: noise is seen elsewhere.
    """
    width = 2 * _LOCAL
    blocks = size[: size.size // width * width].reshape(-1, width)
    if ends:
        readings = x[: blocks.size].reshape(-1, width)
        free = np.mean(np.isin(readings, ends), axis=1) < _AT_AN_END
        blocks = blocks[free] if np.count_nonzero(free) >= _ENOUGH else blocks
    blocks = blocks[:: max(1, blocks.shape[0] // 2000)]
    return 1.4826 * float(np.quantile(np.median(blocks, axis=1), 0.45))


def _shifted(a: NDArray[np.float64], k: int, part: slice) -> NDArray[np.float64]:
    """A part of a moved by k samples to the right, ends filled with the nearest value."""
    return a[np.clip(np.arange(part.start - k, part.stop - k), 0, a.size - 1)]


@njit(cache=True)
def _sort_into(window, x, low, high):
    """x[low:high], rising, into the front of window. For few samples; numba's own takes seconds to compile."""
    for i in range(low, high):
        k = i - low
        while k > 0 and window[k - 1] > x[i]:
            window[k] = window[k - 1]
            k -= 1
        window[k] = x[i]


@njit(cache=True)
def _median(window, x, low, high):
    """Median of x[low:high], with room for it in window."""
    _sort_into(window, x, low, high)
    n = high - low
    return 0.5 * (window[(n - 1) // 2] + window[n // 2])


@njit(cache=True)
def _running_median(x, width, out):
    """Median of `width` (odd) samples centred on each, into out; windows are cut at the ends."""
    n = x.size
    half = width // 2
    window = np.empty(width)
    for i in range(n):
        if half <= i < n - half and width == 3:
            a = x[i - 1]
            b = x[i]
            c = x[i + 1]
            out[i] = max(min(a, b), min(max(a, b), c))
            continue
        low = max(0, i - half)
        high = min(n, i + half + 1)
        if i > half and i + half < n:
            # the sorted window loses one sample and gains one
            gone = x[low - 1]
            new = x[high - 1]
            k = 0
            while window[k] != gone:
                k += 1
            while k < width - 1 and window[k + 1] < new:
                window[k] = window[k + 1]
                k += 1
            while k > 0 and window[k - 1] > new:
                window[k] = window[k - 1]
                k -= 1
            window[k] = new
            out[i] = window[half]
        else:
            _sort_into(window, x, low, high)
            out[i] = window[(high - low) // 2]


@njit(cache=True)
def _judge(candidates, x, medians, size, difference, threshold, typical, floor, side, out):
    n = size.size
    shift = side // 2 + 1
    reach = shift + side
    stretch = shift / side
    window = np.empty(max(25, _LOCAL))
    for i in range(candidates.size):
        c = candidates[i]
        if c < reach or c >= n - reach:
            continue  # too few neighbours on one side: nothing can be said
        # slope: typical difference of the sides around here
        slope = _median(window, difference, max(0, c - 12), min(n, c + 13))
        outside = size[c] - 0.5 * abs(difference[c] - slope)
        if outside <= floor:
            continue
        # at a kink one of the two straight continuations meets the reading; at a false reading neither does
        left, right = medians[c - shift], medians[c + shift]
        a = x[c] - left - (left - medians[c - reach]) * stretch
        b = x[c] - right - (right - medians[c + reach]) * stretch
        sign = 1.0 if x[c] > 0.5 * (left + right) else -1.0
        missed = min(sign * a, sign * b)
        if missed < _KINK * size[c]:
            continue  # on the crest of a smooth wave both continuations lie beyond the reading
        scale = typical
        back = 1.4826 * _median(window, size, max(0, c - _LOCAL), c)
        ahead = 1.4826 * _median(window, size, c + 1, min(n, c + 1 + _LOCAL))
        # a median of 25 scatters by a fifth: only what is clearly above the typical value raises the bar
        if max(back, ahead) > 1.5 * typical:
            scale = max(back, ahead)
        # at the tip of a fast wave the sides lie far below the reading, whatever it is: there it has to miss their
        # continuations by as much as it has to miss level sides elsewhere
        if outside > threshold * scale and missed > min(threshold * scale, size[c] - scale):
            out[i] = True

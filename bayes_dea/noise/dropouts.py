"""Drop-outs of a laser sensor: isolated false readings, single or a few in a row."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from bayes_dea.noise.edges import find_edges

#: half-width in samples of the one-sided windows that give the local scale
_LOCAL = 25
#: share of its size by which a false reading also misses the straight continuations of either side
_KINK = 0.35


def find_dropouts(y: ArrayLike, u: ArrayLike, *, threshold: float = 5.2,
                  resolution: float | None = None) -> NDArray[np.bool_]:
    """Mask of drop-outs, True where a reading is false; shape (n,).

    A reading is false when it lies outside the range spanned by the medians of its neighbours *before*
    and *after* it, by more than `threshold` local robust sds, and also misses the straight continuations of
    both sides. So steps, ramps and kinks are not flagged; what the slope adds to the distance of the sides
    is taken off first, by its running median. Local scale: a typical value of the record or, where clearly
    larger, the one-sided medians of 25 samples before and after, so ringing raises its own threshold. Two
    lengths of side windows (3 and 9 samples) find single readings and runs of up to four. What happens at
    one and the same lag after many edges of the input answers to the input and is no drop-out.

    On normal noise, white or AR(1), the false-alarm rate is below 1e-6 a sample.

    Parameters
    ----------
    y : observed column, shape (n,); nan cells are gaps and never flagged.
    u : input, shape (n,).
    threshold : in local robust sds of the difference to the neighbours (1.1 sd of white noise).
    resolution : quantisation step; a spike below three steps is never flagged. None: the smallest step
        that occurs in y.
    """
    values = np.asarray(y, dtype=float)
    mask = np.zeros(values.size, dtype=np.bool_)
    good = np.flatnonzero(np.isfinite(values))
    if good.size < 2 * _LOCAL + 1:
        return mask
    x = np.ascontiguousarray(values[good])
    edges = np.unique(np.searchsorted(good, find_edges(u)))
    edges = edges[edges < x.size].astype(np.int64)
    floor = max(1e-3 * float(np.quantile(x, 0.999) - np.quantile(x, 0.001)),
                3.0 * (_smallest_step(x) if resolution is None else resolution))
    far = np.full(x.size, x.size, dtype=np.int64)  # rows since the last edge
    if edges.size:
        far[edges[0]:] = _since(x.size, edges)[edges[0]:]
    found = np.zeros(x.size, dtype=np.bool_)
    for side in (3, 9):
        clean = _bridge(x, found)
        new = _pass(clean, side, threshold, floor)
        if side > 3 and edges.size:
            # a short pulse of the input looks like a run
            new &= ~_near(x.size, edges, side + 3)
        found |= new
    if edges.size and found.any():
        found &= ~_systematic(found, far, edges.size)
    mask[good] = found
    return mask


def _smallest_step(x: NDArray[np.float64]) -> float:
    """Quantisation step of data that repeat values, else 0."""
    change = np.abs(np.diff(x[:20_000]))
    moved = change[change > 1e-9 * float(np.max(np.abs(x)) or 1.0)]
    if moved.size == 0 or moved.size > 0.98 * change.size:
        return 0.0
    return float(moved.min())


def _since(n: int, edges: NDArray[np.int64]) -> NDArray[np.int64]:
    start = np.zeros(n, dtype=np.int64)
    start[edges] = edges
    return np.arange(n) - np.maximum.accumulate(start)


def _near(n: int, edges: NDArray[np.int64], reach: int) -> NDArray[np.bool_]:
    near = np.zeros(n, dtype=np.bool_)
    for offset in range(-reach, reach + 1):
        near[np.clip(edges + offset, 0, n - 1)] = True
    return near


def _systematic(found: NDArray[np.bool_], far: NDArray[np.int64], n_edges: int,
                reach: int = 60) -> NDArray[np.bool_]:
    """Finds that come at one lag after a twelfth of the edges, or right at an edge where edges are few."""
    lag = np.where(found & (far < reach), far, reach)
    counts = np.bincount(lag, minlength=reach + 1)[:reach]
    often = np.zeros(reach + 1, dtype=np.bool_)
    # an answer to the input may shift by a sample from edge to edge
    spread = np.convolve(counts, np.ones(3), mode="same")
    often[:reach] = spread > max(3.0, 0.08 * n_edges)
    if n_edges < 10:
        often[:3] = True
    return often[lag]


def _bridge(x: NDArray[np.float64], found: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The data with what was found replaced by straight lines."""
    if not found.any():
        return x
    rows = np.arange(x.size)
    return np.interp(rows, rows[~found], x[~found])


def _pass(x: NDArray[np.float64], side: int, threshold: float, floor: float) -> NDArray[np.bool_]:
    medians = _running_median(x, side)
    # window of `side` samples that ends just before, or begins just after, each sample
    shift = side // 2 + 1
    before, after = _shifted(medians, shift), _shifted(medians, -shift)
    size = np.abs(x - 0.5 * (before + after))
    typical = _typical(size)
    out = np.zeros(x.size, dtype=np.bool_)
    candidates = np.flatnonzero(size > max(threshold * typical, floor))
    if candidates.size:
        _judge(candidates, x, medians, size, before - after, threshold, typical, floor, side, out)
    return out


def _typical(size: NDArray[np.float64]) -> float:
    """Robust sd that holds where the record is quiet: low quantile of medians over short stretches."""
    width = 2 * _LOCAL
    blocks = size[: size.size // width * width].reshape(-1, width)
    blocks = blocks[:: max(1, blocks.shape[0] // 2000)]
    return 1.4826 * float(np.quantile(np.median(blocks, axis=1), 0.45))


def _shifted(a: NDArray[np.float64], k: int) -> NDArray[np.float64]:
    """a moved by k samples to the right, ends filled with the nearest value."""
    out = np.empty_like(a)
    if k > 0:
        out[k:], out[:k] = a[:-k], a[0]
    else:
        out[:k], out[k:] = a[-k:], a[-1]
    return out


@njit(cache=True)
def _running_median(x, width):
    """Median of `width` (odd) samples centred on each; windows are cut at the ends."""
    n = x.size
    half = width // 2
    out = np.empty(n)
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
            m = high - low
            window[:m] = np.sort(x[low:high])
            out[i] = window[m // 2]
    return out


@njit(cache=True)
def _judge(candidates, x, medians, size, difference, threshold, typical, floor, side, out):
    n = size.size
    shift = side // 2 + 1
    reach = shift + side
    stretch = shift / side
    for c in candidates:
        if c < reach or c >= n - reach:
            continue  # too few neighbours on one side: nothing can be said
        # slope: typical difference of the sides around here
        slope = np.median(difference[max(0, c - 12):min(n, c + 13)])
        outside = size[c] - 0.5 * abs(difference[c] - slope)
        if outside <= floor:
            continue
        # at a kink one of the two straight continuations meets the reading; at a false reading neither does
        left, right = medians[c - shift], medians[c + shift]
        a = x[c] - left - (left - medians[c - reach]) * stretch
        b = x[c] - right - (right - medians[c + reach]) * stretch
        sign = 1.0 if x[c] > 0.5 * (left + right) else -1.0
        if min(sign * a, sign * b) < _KINK * size[c]:
            continue  # on the crest of a smooth wave both continuations lie beyond the reading
        scale = typical
        back = 1.4826 * np.median(size[max(0, c - _LOCAL):c])
        ahead = 1.4826 * np.median(size[c + 1:min(n, c + 1 + _LOCAL)])
        # a median of 25 scatters by a fifth: only what is clearly above the typical value raises the bar
        if max(back, ahead) > 1.5 * typical:
            scale = max(back, ahead)
        if outside > threshold * scale:
            out[c] = True

"""Where the input jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.order import quantiles
from bayes_dea.campaign.scratch import BLOCK, computed, kept, numbered, pieces

Array = NDArray[np.float64]


#: part of the quartile of second differences below which a difference is rounding, and a grid without effect
_NO_GRID = 0.01


def dense(x: Array) -> tuple[Array, NDArray[np.int64] | None]:
    """The finite cells of a column (n,), and their rows; None where all are finite."""
    good = computed(np.isfinite, x, dtype=np.bool_)
    if np.count_nonzero(good) == x.size:
        return x, None
    return kept(x, good), numbered(good)


#: share of a value's size that is rounding, and of second differences that vanish, from which on an input is a command
_ROUNDED, _MOSTLY = 1e-12, 0.6


def input_noise(u: ArrayLike) -> float:
    """Robust sd of the scatter of an input (0 for a command), from its second differences.

    Second differences of noise of sd s have sd sqrt(6) s, those of slow inputs vanish. The lower quartile
    of their size is used, so that an input that moves half the time does not count as noisy.
    """
    x, _ = dense(np.asarray(u, dtype=float))
    if x.size < 8:
        return 0.0
    # a piece of second differences needs two rows more
    parts = [slice(p.start, p.stop + 2) for p in pieces(x.size - 2, BLOCK)]
    (low,) = quantiles(lambda: (np.abs(np.diff(x[p], n=2)) for p in parts), [0.25])
    nothing = _ROUNDED * max(float(np.max(np.abs(x[p]))) for p in parts)
    # a command, or readings on a grid so coarse that a quarter of the differences vanish; of noise not many more do
    coarse = low <= nothing
    if coarse:
        zeros = sum(int(np.count_nonzero(np.abs(np.diff(x[p], n=2)) <= nothing)) for p in parts)
        if zeros > _MOSTLY * (x.size - 2):
            return 0.0
    # on the grid of a resolution the quartile jumps from step to step: every value is spread over its own
    least, largest = (nothing, np.inf) if coarse else (_NO_GRID * low, low)
    sizes = (np.abs(np.diff(x[p], n=2)) for p in parts)
    grid = min(float(np.min(d[d > least], initial=largest)) for d in sizes)
    (low,) = quantiles(lambda: (np.abs(np.diff(x[p], n=2) + grid * _spread(p)) for p in parts), [0.25])
    return float(low / (0.3186393639643752 * np.sqrt(6.0)))


def _spread(p: slice) -> Array:
    """Even numbers in (-1/2, 1/2), one for every second difference of a piece: multiples of the golden ratio."""
    return np.asarray((np.arange(p.start, p.stop - 2) * 0.6180339887498949) % 1.0 - 0.5)


def find_edges(u: ArrayLike, share: float = 0.02, contrast: float = 4.0, reach: int = 4) -> NDArray[np.int64]:
    """Indices i at which the input jumps between rows i-1 and i.

    A jump is a change by more than `share` of the range of u (and eight times its scatter) that is also
    `contrast` times larger than the median change of its `reach` neighbours on either side: the steep
    parts of a fast sine are no edges, the corners of a rectangle are.

    Parameters
    ----------
    u : input, shape (n,); nan cells are bridged.

    Returns
    -------
    Rising int64 array of indices in 1..n-1.
    """
    v, rows = dense(np.asarray(u, dtype=float))
    if v.size < 2:
        return np.empty(0, dtype=np.int64)
    low, high = float(v.min()), float(v.max())
    if high == low:
        return np.empty(0, dtype=np.int64)
    limit = max(share * (high - low), 8 * input_noise(v))
    found = [np.empty(0, dtype=np.int64)]
    # of a long fast input most rows may be candidates
    for part in pieces(v.size - 1, BLOCK):
        candidates = part.start + np.flatnonzero(np.abs(np.diff(v[part.start:part.stop + 1])) > limit)
        if candidates.size:
            found.append(candidates[_jumps(v, candidates, contrast, reach)])
    at = np.concatenate(found) + 1
    return at if rows is None else rows[at]


def _jumps(v: Array, candidates: NDArray[np.int64], contrast: float, reach: int) -> NDArray[np.bool_]:
    """Which changes v[i + 1] - v[i] at some rows i stand out of their neighbours."""
    changes = v.size - 1
    offsets = np.concatenate([np.arange(-reach, 0), np.arange(1, reach + 1)])
    around = candidates[:, None] + offsets
    inside = (around >= 0) & (around < changes)
    beside = np.clip(around, 0, changes - 1)
    sizes = np.where(inside, np.abs(v[beside + 1] - v[beside]), np.nan)
    # each side alone: in a rectangle of few samples a half-period the other edge is a neighbour
    quiet = np.full(candidates.size, np.inf)
    for side in (slice(0, reach), slice(reach, 2 * reach)):
        # at the ends of the recording only one side may exist
        there = inside[:, side].any(axis=1)
        quiet[there] = np.minimum(quiet[there], np.nanmedian(sizes[there, side], axis=1))
    quiet[np.isinf(quiet)] = 0.0
    return np.asarray(np.abs(v[candidates + 1] - v[candidates]) > contrast * quiet)

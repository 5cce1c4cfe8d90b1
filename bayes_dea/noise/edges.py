"""Where the input jumps."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def input_noise(u: ArrayLike) -> float:
    """Robust sd of the scatter of an input (0 for a command), from its second differences.

    Second differences of noise of sd s have sd sqrt(6) s, those of slow inputs vanish. The lower quartile
    of their size is used, so that an input that moves half the time does not count as noisy.
    """
    x = np.asarray(u, dtype=float)
    x = x[np.isfinite(x)]
    if x.size < 8:
        return 0.0
    second = np.abs(np.diff(x, n=2))
    return float(np.quantile(second, 0.25) / (0.3186393639643752 * np.sqrt(6.0)))


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
    x = np.asarray(u, dtype=float)
    good = np.flatnonzero(np.isfinite(x))
    if good.size < 2:
        return np.empty(0, dtype=np.int64)
    v = x[good]
    change = np.abs(np.diff(v))
    low, high = float(v.min()), float(v.max())
    if high == low:
        return np.empty(0, dtype=np.int64)
    candidates = np.flatnonzero(change > max(share * (high - low), 8 * input_noise(v)))
    if candidates.size == 0:
        return np.empty(0, dtype=np.int64)
    offsets = np.concatenate([np.arange(-reach, 0), np.arange(1, reach + 1)])
    around = candidates[:, None] + offsets
    inside = (around >= 0) & (around < change.size)
    sizes = np.where(inside, change[np.clip(around, 0, change.size - 1)], np.nan)
    # each side alone: in a rectangle of few samples a half-period the other edge is a neighbour
    quiet = np.full(candidates.size, np.inf)
    for side in (slice(0, reach), slice(reach, 2 * reach)):
        # at the ends of the recording only one side may exist
        there = inside[:, side].any(axis=1)
        quiet[there] = np.minimum(quiet[there], np.nanmedian(sizes[there, side], axis=1))
    quiet[np.isinf(quiet)] = 0.0
    return good[candidates[change[candidates] > contrast * quiet] + 1].astype(np.int64)

"""Where the slope of a measured ramp changes: corners that block means joined by straight lines would cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.noise.edges import input_noise


def find_kinks(u: ArrayLike, *, widths: tuple[int, ...] = (32, 128), threshold: float = 8.0) -> NDArray[np.int64]:
    """Rows at which the slope of u changes, rising int64 array.

    The mean of w rows after a row, less twice the mean of w around it, plus the mean of w before, vanishes on a
    straight line and has the sd sqrt(6/w) of the scatter of u (as `input_noise` finds it). Where it is largest, and
    beyond `threshold` of those, is a kink. Short windows place it, longer ones add what they alone can see. Without
    scatter there are none to report: such a column needs no blocks. Rows that are not finite are bridged.
    """
    x = np.asarray(u, dtype=float)
    good = np.flatnonzero(np.isfinite(x))
    noise = input_noise(x)
    found = np.empty(0, dtype=np.int64)
    if noise <= 0:
        return found
    v = x[good]
    for w in widths:
        if good.size >= 4 * w:
            new = _at_width(v, noise, w, threshold)
            seen = found.size and np.abs(new[:, None] - found[None, :]).min(axis=1) < 2 * w
            found = np.sort(np.concatenate([found, new[~np.asarray(seen, dtype=bool)] if found.size else new]))
    return good[np.minimum(found, good.size - 1)]


def _at_width(v: NDArray[np.float64], noise: float, w: int, threshold: float) -> NDArray[np.int64]:
    total = np.concatenate([[0.0], np.cumsum(v - v[0])])
    mean = (total[w:] - total[:-w]) / w  # of rows i .. i + w - 1
    bend = np.abs(mean[2 * w :] - 2 * mean[w:-w] + mean[: -2 * w])  # centred on row i + 3 w / 2
    limit = threshold * noise * np.sqrt(6.0 / w)
    found = []
    i = 0
    while i < bend.size:
        if bend[i] <= limit:
            i += 1
            continue
        stop = i
        while stop < bend.size and bend[stop] > limit:
            stop += 1
        found.append(i + int(np.argmax(bend[i:stop])) + (3 * w) // 2)
        i = stop
    return np.array(found, dtype=np.int64)

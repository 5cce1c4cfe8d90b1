"""Where the slope of a measured ramp changes: corners that block means joined by straight lines would cut."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.scratch import BLOCK, beside, pieces
from bayes_dea.noise.edges import dense, input_noise


def find_kinks(u: ArrayLike, *, widths: tuple[int, ...] = (32, 128), threshold: float = 8.0) -> NDArray[np.int64]:
    """Rows at which the slope of u changes, rising int64 array.

    The mean of w rows after a row, less twice the mean of w around it, plus the mean of w before, vanishes on a
    straight line and has the sd sqrt(6/w) of the scatter of u (as `input_noise` finds it). Where it is largest, and
    beyond `threshold` of those, is a kink. Short windows place it, longer ones add what they alone can see. Without
    scatter there are none to report: such a column needs no blocks. Rows that are not finite are bridged.
    """
    v, rows = dense(np.asarray(u, dtype=float))
    noise = input_noise(v)
    found = np.empty(0, dtype=np.int64)
    if noise <= 0:
        return found
    for w in widths:
        if v.size >= 4 * w:
            new = _at_width(v, noise, w, threshold)
            seen = found.size and np.abs(new[:, None] - found[None, :]).min(axis=1) < 2 * w
            found = np.sort(np.concatenate([found, new[~np.asarray(seen, dtype=bool)] if found.size else new]))
    at = np.minimum(found, v.size - 1)
    return at if rows is None else rows[at]


def _at_width(v: NDArray[np.float64], noise: float, w: int, threshold: float) -> NDArray[np.int64]:
    total = beside(v, n=v.size + 1)
    for part in pieces(v.size, BLOCK):
        sums = np.concatenate([total[part.start : part.start + 1], v[part] - v[0]])
        total[part.start + 1 : part.stop + 1] = np.cumsum(sums)[1:] if part.start else np.cumsum(sums[1:])
    limit = threshold * noise * np.sqrt(6.0 / w)
    bend = beside(v, n=v.size - 3 * w + 1)
    starts, stops = [], []
    before = False
    for part in pieces(bend.size, BLOCK):
        sums = total[part.start : part.stop + 3 * w]
        mean = (sums[w:] - sums[:-w]) / w  # of rows i .. i + w - 1
        bend[part] = np.abs(mean[2 * w :] - 2 * mean[w:-w] + mean[: -2 * w])  # centred on row i + 3 w / 2
        beyond = np.concatenate([[before], bend[part] > limit])
        turn = np.flatnonzero(beyond[1:] != beyond[:-1])
        starts.append(part.start + turn[beyond[turn + 1]])
        stops.append(part.start + turn[~beyond[turn + 1]])
        before = bool(beyond[-1])
    first = np.concatenate(starts)
    last = np.concatenate([*stops, [bend.size] if before else []]).astype(np.int64)
    return np.array([i + int(np.argmax(bend[i:j])) + (3 * w) // 2 for i, j in zip(first, last, strict=True)], np.int64)

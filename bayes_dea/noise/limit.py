"""The end of a sensor's range, where it cuts off readings with their noise: one value that comes far too often."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.scratch import BLOCK, pieces

Array = NDArray[np.float64]

#: readings at the limit in all, and how many times those of a bin just below it
_LEAST, _TIMES = 20, 4.0
#: part of all readings, and of those at the limit, that may lie beyond it
_BEYOND, _RARE = 2e-3, 0.2
#: bins below the highest reading that it is compared with
_BINS = 6


def find_limit(readings: Sequence[ArrayLike], resolution: float = 0.0) -> float | None:
    """Highest value that the readings of several recordings pile up at; None where they do not.

    The tail of a distribution falls: the highest value of noisy readings comes rarely, and no oftener than values just
    below. Where the highest one comes 20 times or more, and four times as often as any of the six steps of the
    resolution below it, the sensor has cut off what was larger. A sensor whose range ends *before* its noise is added
    leaves no such mark. Drop-outs may lie beyond: readings above are rare then, and the limit is met more than twice.

    readings : columns of one sensor, nan for what was not observed. resolution : its quantisation step; without one
    the highest value must recur to the last digit.
    """
    columns = [np.asarray(r, dtype=float) for r in readings]
    total = sum(int(np.count_nonzero(np.isfinite(x[part]))) for x in columns for part in pieces(x.size, BLOCK))
    if total == 0:
        return None
    top = _highest(columns, 1 + int(2.0 * _BEYOND * total))
    highest = float(top[0])
    width = resolution if resolution > 0 else 1e-9 * max(abs(highest), 1e-300)
    if _piles_up(columns, highest, width):
        return highest
    # values that so few lie above, and all readings of each
    _, first, count = np.unique(np.rint((highest - top) / width), return_index=True, return_counts=True)
    for above, n in zip(first, count, strict=True):
        if above > _BEYOND * total:
            break
        value = float(top[above])
        if n < _LEAST or above > _RARE * n:
            continue
        if _piles_up(columns, value, width) and _visits(columns, value, width) > 2:
            return value
    return None


def _highest(columns: Sequence[Array], n: int) -> Array:
    """The n highest readings (n,), the highest first."""
    out = np.empty(0)
    for x in columns:
        for part in pieces(x.size, BLOCK):
            v = x[part]
            least = out[-1] if out.size == n else -np.inf
            out = np.sort(np.concatenate([out, v[np.isfinite(v) & (v > least)]]))[::-1][:n]
    return out


def limit_warning(readings: Mapping[str, ArrayLike], resolution: float, unit: str) -> str | None:
    """One line that a person can act on, where readings by name of recording end at a limit; else None."""
    value = find_limit(list(readings.values()), resolution)
    if value is None:
        return None
    counts = {name: int(np.count_nonzero(near_limit(y, value, resolution, 0))) for name, y in readings.items()}
    named = ", ".join(f"{name} {n}" for name, n in counts.items() if n)
    return (
        f"{sum(counts.values())} readings stop at {value:.6g} {unit}, as at the end of a sensor's range ({named}). "
        "What was cut off pulls every parameter; add +sensor_clipping to the model, or diagnose, which leaves them out"
    )


def _piles_up(columns: Sequence[Array], value: float, width: float) -> bool:
    counts = np.zeros(_BINS + 1)
    for x in columns:
        for part in pieces(x.size, BLOCK):
            v = x[part]
            near = v[(v > value - (_BINS + 0.5) * width) & (v < value + 0.5 * width)]
            below = np.rint((value - near) / width).astype(np.int64)
            counts += np.bincount(np.clip(below, 0, _BINS), minlength=_BINS + 1)
    return bool(counts[0] >= _LEAST and counts[0] >= _TIMES * max(float(counts[1:].max()), 1.0))


def _visits(columns: Sequence[Array], value: float, width: float) -> int:
    """How often readings come to a value: one that a sensor holds once, for a while, is no limit."""
    total = 0
    for x in columns:
        there = False
        for part in pieces(x.size, BLOCK):
            v = x[part]
            at = np.abs(v[np.isfinite(v)] - value) < 0.5 * width
            if at.size:
                total += int(at[0] and not there) + int(np.count_nonzero(at[1:] & ~at[:-1]))
                there = bool(at[-1])
    return total


def near_limit(y: ArrayLike, limit: float, resolution: float = 0.0, reach: int = 3) -> NDArray[np.bool_]:
    """Rows (n,) at the limit or within `reach` rows of one that is."""
    x = np.asarray(y, dtype=float)
    at = np.abs(x - limit) <= 0.5 * max(resolution, 1e-9 * max(abs(limit), 1e-300))
    out = at.copy()
    for k in range(1, reach + 1):
        out[k:] |= at[:-k]
        out[:-k] |= at[k:]
    return out

"""How far a recording or a command goes: voltage, time, and how fast it repeats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit, read_only

#: a swing counts when it covers this share of the whole span: noise and small corrections are no repetition
_SWING = 0.2


@njit(cache=True)
def _rises(v, swing, out):
    """Rows at which a rise of at least `swing` begins, into out as far as it goes; their number. nan rows do not count.

    The first one may be a start.
    """
    found, direction = 0, 0
    first = 0
    while np.isnan(v[first]):
        first += 1
    low_at, high_at = first, first
    for i in range(first, v.size):
        if np.isnan(v[i]):
            continue
        if v[i] < v[low_at] or (direction < 0 and v[i] == v[low_at]):
            low_at = i
        if v[i] > v[high_at]:
            high_at = i
        if direction >= 0 and v[high_at] - v[i] >= swing:
            direction, low_at = -1, i
        elif direction <= 0 and v[i] - v[low_at] >= swing:
            if found < out.size:
                out[found] = low_at
            found += 1
            direction, high_at = 1, i
    return found


def repetition_Hz(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Highest rate (Hz) at which (n,) values rise again: one over the shortest time between two rises.

    A rise covers a fifth of the whole span. 0.0 with fewer than two: a step, or one slow wave.
    """
    span = float(np.fmax.reduce(values) - np.fmin.reduce(values)) if values.size else 0.0
    if np.count_nonzero(np.isfinite(values)) < 3 or not span > 0:
        return 0.0
    v = read_only(values)
    rows = np.empty(_rises(v, _SWING * span, np.empty(0, np.int64)), np.int64)
    _rises(v, _SWING * span, rows)
    rises = time_s[rows]
    if rises.size < 2:
        return 0.0
    # the median of the shortest three: one early sample is no frequency
    return float(1.0 / np.median(np.sort(np.diff(rises))[:3]))


def median_step(time_s: NDArray[np.float64]) -> float:
    """Median of the steps of a time column (n,); of a long one, of a million steps from all over it."""
    if time_s.size <= 1_000_000:
        return float(np.median(np.diff(time_s)))
    some = np.linspace(0, time_s.size - 2, 1_000_000).astype(int)
    return float(np.median(time_s[some + 1] - time_s[some]))


def extent(time_s: NDArray[np.float64], values: NDArray[np.float64], name: str) -> dict[str, float]:
    """Smallest value and largest magnitude of the column `name`, `duration_s`, `step_s` (median) and `frequency_Hz`.

    A film is pulled to negative positions, and a stack answers to -1000 V as to 1000 V: how far it went has no sign.
    """
    smallest = float(np.nanmin(values))
    return {
        f"smallest_{name}": smallest,
        f"largest_{name}": max(float(np.nanmax(values)), -smallest),
        "duration_s": float(time_s[-1] - time_s[0]),
        "step_s": median_step(time_s),
        "frequency_Hz": repetition_Hz(time_s, values),
    }

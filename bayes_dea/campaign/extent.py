"""How far a recording or a command goes: voltage, time, and how fast it repeats."""

from __future__ import annotations

import numba as nb
import numpy as np
from numpy.typing import NDArray

#: a swing counts when it covers this share of the whole span: noise and small corrections are no repetition
_SWING = 0.2


@nb.njit(cache=True)
def _rises(v, swing, out):
    """Rows at which a rise of at least `swing` begins, into out (n,); their number. The first one may be a start."""
    found, direction = 0, 0
    low_at, high_at = 0, 0
    for i in range(v.size):
        if v[i] < v[low_at] or (direction < 0 and v[i] == v[low_at]):
            low_at = i
        if v[i] > v[high_at]:
            high_at = i
        if direction >= 0 and v[high_at] - v[i] >= swing:
            direction, low_at = -1, i
        elif direction <= 0 and v[i] - v[low_at] >= swing:
            out[found] = low_at
            found += 1
            direction, high_at = 1, i
    return found


def repetition_Hz(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Highest rate (Hz) at which (n,) values rise again: one over the shortest time between two rises.

    A rise covers a fifth of the whole span. 0.0 with fewer than two: a step, or one slow wave.
    """
    good = np.isfinite(values)
    t, v = time_s[good], np.ascontiguousarray(values[good], dtype=np.float64)
    if v.size < 3 or np.ptp(v) == 0:
        return 0.0
    rows = np.empty(v.size, np.int64)
    rises = t[rows[: _rises(v, _SWING * np.ptp(v), rows)]]
    if rises.size < 2:
        return 0.0
    # the median of the shortest three: one early sample is no frequency
    return float(1.0 / np.median(np.sort(np.diff(rises))[:3]))


def extent(time_s: NDArray[np.float64], values: NDArray[np.float64], name: str) -> dict[str, float]:
    """Smallest and largest value of the column `name`, `duration_s`, `step_s` (median) and `frequency_Hz`."""
    return {
        f"smallest_{name}": float(np.nanmin(values)),
        f"largest_{name}": float(np.nanmax(values)),
        "duration_s": float(time_s[-1] - time_s[0]),
        "step_s": float(np.median(np.diff(time_s))),
        "frequency_Hz": repetition_Hz(time_s, values),
    }

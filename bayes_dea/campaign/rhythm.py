"""Sensors that are read less often than rows are written: which rows hold their readings.

A vibrometer of 200 Hz beside a command of 1 kHz fills every fifth row. To whatever looks at neighbouring readings, the
four rows between them are no gaps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

#: readings that show the rhythm, share of the rows that are filled above which there is none, share of the readings
#: that keep it, the rarest that is looked for, and rows that it is looked for in
_LEAST, _FILLED, _KEPT, _RAREST, _ROWS = 64, 0.6, 0.9, 10_000, 2_000_000


def reading_every(y: ArrayLike) -> tuple[int, int]:
    """First row of the readings y (n,), and every how many rows there is one: (0, 1) where at every row or in no order.

    Gaps in a rhythm do not hide it.
    """
    values = np.asarray(y, dtype=float)[:_ROWS]
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < _LEAST or rows.size > _FILLED * values.size:
        return 0, 1
    apart = np.diff(rows)
    every = int(np.argmax(np.bincount(apart[apart < _RAREST], minlength=2)))
    if every < 2:
        return 0, 1
    phase = rows % every
    first = int(np.argmax(np.bincount(phase)))
    return (first, every) if np.mean(phase == first) >= _KEPT else (0, 1)


def with_a_reading(y: ArrayLike) -> slice:
    """Rows that a sensor was read at, gaps of that rhythm among them, as a slice of all rows."""
    first, every = reading_every(y)
    return slice(first, None, every)

"""Readings that stand still to the last digit: no measurement, but a sensor that is stuck, clipped or out of range."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: equal readings one after the other; at the coarsest resolution of a live run, chance makes as many once in 1e10
LEAST = 40


def standing_still(y: NDArray[np.float64], least: int = LEAST) -> NDArray[np.bool_]:
    """Which readings (n,) belong to a run of at least `least` equal ones."""
    if y.size < least:
        return np.zeros(y.size, dtype=bool)
    begins = np.flatnonzero(np.concatenate([[True], y[1:] != y[:-1]]))
    lengths = np.diff(np.append(begins, y.size))
    return np.repeat(lengths >= least, lengths)

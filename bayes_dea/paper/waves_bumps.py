"""How much an answer goes up and down within a period, and how bumpy its rising branch is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .reconstruct import (
    WaveRecording,
)
from .smooth_law import bumpiness

Array = NDArray[np.float64]


def last_period(w: WaveRecording) -> slice:
    """Rows of the last period."""
    rows = round(1.0 / (w.frequency_Hz * float(w.time_s[1] - w.time_s[0])))
    return slice(w.time_s.size - rows, w.time_s.size)


def way_over_stroke(w: WaveRecording, y: Array) -> float:
    """Total variation of the last period over twice its stroke."""
    part = y[last_period(w)]
    around = np.append(part, part[0])
    return float(np.abs(np.diff(around)).sum() / (2.0 * np.ptp(part)))


def branch_bumps(w: WaveRecording, y: Array) -> float:
    """Bumpiness of the rising quarter from the lowest to the highest command of the last period, 60 points."""
    part = last_period(w)
    V, x = np.tile(w.command_V[part], 2), np.tile(y[part], 2)
    first = int(np.argmin(w.command_V[part]))
    last = first + int(np.argmax(V[first : first + w.command_V[part].size]))
    at = np.round(np.linspace(first, last, min(60, last - first + 1))).astype(int)
    return bumpiness(at.astype(float), x[at])

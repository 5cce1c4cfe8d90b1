"""What a block of a recording is like: time since the last edge, level, direction, phase: for the search for where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece
from ...models.missing_drive import drive_values
from ...noise.blocks import block_means
from ...noise.edges import find_edges

Array = NDArray[np.float64]

#: borders of time since an edge in s
SINCE_EDGE = np.array([0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1e9])
HARMONICS = 5


@dataclass(frozen=True)
class Features:
    """Features of the blocks of a piece, each (nb,)."""

    time_s: Array
    level: Array  # mean input over the block: V without its sign, which no actuator feels, or m of position
    speed: Array  # mean rate of the input in units of its range a second
    since_edge_s: Array  # inf before the first edge
    jump: Array  # input after the last edge minus before it; 0 before the first
    span: float  # range of the input: V, or m of position
    frequency_Hz: float  # of the excitation, 0 where none
    phase: Array  # of the excitation in turns, nan outside its periods
    repetition: NDArray[np.int64]  # period of the excitation, -1 outside


def features(piece: Piece) -> Features:
    """Features of a piece's blocks."""
    r = piece.recording
    raw = drive_values(r)
    edges = find_edges(raw)
    u = np.abs(raw) if r.is_voltage else raw
    t, b = r.time_s, piece.blocks
    masked = ~piece.prepared.observed
    span = float(np.ptp(u))
    moving = np.gradient(u, t) / max(span, 1e-300)
    last = np.searchsorted(edges, b.start, side="right") - 1
    since = np.full(b.n, np.inf)
    jump = np.zeros(b.n)
    has = last >= 0
    if has.any():
        at = edges[last[has]]
        since[has] = b.time_s[has] - t[np.maximum(at - 1, 0)]
        jump[has] = u[np.minimum(at + 1, u.size - 1)] - u[np.maximum(at - 1, 0)]
    frequency, begin, end = excitation(t, u)
    phase = np.full(b.n, np.nan)
    repetition = np.full(b.n, -1, dtype=np.int64)
    if frequency > 0:
        turns = (b.time_s - begin) * frequency
        inside = (b.time_s >= begin) & (b.time_s <= end)
        phase[inside] = turns[inside] % 1.0
        last_period = max(round((end - begin) * frequency) - 1, 0)
        repetition[inside] = np.minimum(turns[inside].astype(np.int64), last_period)
    return Features(
        b.time_s,
        block_means(u, b, masked),
        block_means(moving, b, masked),
        since,
        jump,
        span,
        frequency,
        phase,
        repetition,
    )


def excitation(t: Array, u: Array) -> tuple[float, float, float]:
    """Frequency in Hz of a periodic input, and where it begins and ends in s; zeros where it is not periodic.

    From upward crossings of its middle level: at least two whole periods of nearly equal length.
    """
    low, high = float(u.min()), float(u.max())
    if high <= low:
        return 0.0, 0.0, 0.0
    active = u[u > low + 0.02 * (high - low)]
    middle = 0.5 * (float(np.quantile(active, 0.02)) + high) if active.size > 20 else 0.5 * (low + high)
    above = u > middle
    up = np.flatnonzero(above[1:] & ~above[:-1]) + 1
    if up.size < 3:
        return 0.0, 0.0, 0.0
    periods = np.diff(t[up])
    period = float(np.median(periods))
    if np.median(np.abs(periods - period)) > 0.05 * period:
        return 0.0, 0.0, 0.0
    moves = np.flatnonzero(np.diff(u))
    begin, end = float(t[max(moves[0] - 1, 0)]), float(t[min(moves[-1] + 1, t.size - 1)])
    return 1.0 / period, begin, end

"""Slow sines and triangles in few steps: where a command changes at every row, by little.

Many such rows make one step, in which the command is a straight line with the mean of the rows. A held command reaches
a row half a row's change behind that line, and what is quick answers the staircase, not the line. So the last rows of
every group stay steps of their own: a lag of x rows sees line and staircase differ by a share of 1/(12 x) of a row's
change at most, and forgets that by exp(-1/x) in each of them. Only the last one is read; the output is straight between
rows that are read.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: share of a command's largest size from which on a bend from row to row is a jump
_JUMP = 5e-3
#: the same for a kink, and how many times more than two rows before and after the command bends there
_KINK, _SHARP = 1.5e-4, 4.0


@dataclass(frozen=True)
class LineSettings:
    """How long a group may be.

    bend: share of a command's largest size up to which it is smooth where it bends from row to row. missed: the same by
    which a line may miss its rows. change: of the command within a group, as a share of its largest size: the square of
    it, read off straight, is out by a sixth of the square of this on average. after_jump_s, after_kink_s (s): time in
    which every row is kept. since: share of the time since either that a group lasts. fewest: rows of a group, last:
    held rows at its end.
    """

    bend: float = 1e-4
    missed: float = 2.5e-5
    change: float = 0.008
    after_jump_s: float = 0.3
    after_kink_s: float = 0.1
    since: float = 0.05
    fewest: int = 12
    last: int = 2


#: enough for a posterior: within hundredths of what a sensor resolves
FINE = LineSettings()
#: enough for what a small change of the parameters changes: to thousandths of it, at worst a few hundredths
ROUGH = LineSettings(
    bend=_JUMP, missed=3e-3, change=0.15, after_jump_s=0.01, after_kink_s=0.005, since=0.5, fewest=6
)


@dataclass(frozen=True)
class Lines:
    """Rows that are left, and the command between them.

    row (m,): index of the row; start, end (m,) V: the command's line in the interval that ends there; unread: places
    in `row` at which a held command is not answered yet.
    """

    row: NDArray[np.int64]
    start: Array
    end: Array
    unread: NDArray[np.int64]


def slow_lines(
    row: NDArray[np.int64], volts: Array, step_s: float, linear: bool, settings: LineSettings = FINE
) -> Lines | None:
    """Groups of rows (see module) among the rows (m,) that are known so far; None where there are none.

    volts (n,): the command at every row, held until the row or, with `linear`, straight between rows.
    """
    largest = float(np.max(np.abs(volts)))
    if largest == 0.0 or row.size < 3:
        return None
    room = _room(volts, largest, step_s, settings)
    # rows that are left out already stand still
    room[:-1][np.isin(np.arange(volts.size - 1) + 1, row, invert=True)] = 0
    starts = np.flatnonzero(room >= settings.fewest)
    last = 0 if linear else settings.last
    groups = []
    at = 0
    while at < starts.size:
        r = int(starts[at])
        group = _group(volts, r, int(room[r]), last, largest, linear, settings)
        if group is not None:
            groups.append(group)
        at = int(np.searchsorted(starts, r + 1 if group is None else group[1]))
    return _joined(row, volts, groups, last, linear) if groups else None


def corners(volts: Array) -> NDArray[np.int64]:
    """Rows (k,) at which a command (n,) V jumps or kinks: it bends there far more than before and after."""
    bend = _bend(volts)
    beside = np.pad(bend, 2)
    beside = np.maximum(beside[:-4], beside[4:])
    return np.flatnonzero(bend > np.maximum(_KINK * np.max(np.abs(volts)), _SHARP * beside))


def _bend(volts: Array) -> Array:
    """Change of the change (n,) at each row, zero at the ends."""
    out = np.zeros(volts.size)
    out[1:-1] = np.abs(np.diff(volts, 2))
    return out


def _room(volts: Array, largest: float, step_s: float, settings: LineSettings) -> NDArray[np.int64]:
    """Rows (n,) that a group which begins at a row may have, the deviation from a line apart."""
    n = volts.size
    at = np.arange(n)
    change = np.diff(volts)
    bend = _bend(volts)
    rough = bend > settings.bend * largest
    rough[corners(volts)] = True
    rough[[0, -1]] = True
    jump = rough & (bend > _JUMP * largest)
    jump[0] = True
    turns = rough.copy()
    turns[1:-1] |= change[1:] * change[:-1] <= 0.0
    since_jump = at - np.maximum.accumulate(np.where(jump, at, 0))
    since = at - np.maximum.accumulate(np.where(rough, at, 0))
    until = np.minimum.accumulate(np.where(turns, at, n)[::-1])[::-1]
    until = np.append(until[1:], n - 1)  # a group may begin at a turn
    out = np.minimum((settings.since * since).astype(np.int64), until - at)
    out[(since_jump * step_s < settings.after_jump_s) | (since * step_s < settings.after_kink_s)] = 0
    speed = np.abs(np.append(change, 0.0))
    out = np.minimum(out, np.minimum(settings.change * largest / np.maximum(speed, 1e-300), 1e9).astype(np.int64))
    return np.asarray(out)


def _group(
    volts: Array, r: int, room: int, last: int, largest: float, linear: bool, settings: LineSettings
) -> tuple[int, int, float, float] | None:
    """First and last row of a group from row r on, its line's ends (V)."""
    while room >= settings.fewest:
        k = room - last
        rows = volts[r + 1 : r + k + 1]
        slope = float(rows[-1] - rows[0]) / (k - 1)
        if linear:
            mean = float(0.5 * (volts[r] + rows[-1]) + rows[:-1].sum()) / k
            start, end = 2.0 * mean - float(rows[-1]), float(rows[-1])
        else:
            mean = float(rows.mean())
            start, end = mean - 0.5 * slope * k, mean + 0.5 * slope * k
        missed = rows - (mean + slope * (np.arange(k) - 0.5 * (k - 1) + (0.5 if linear else 0.0)))
        if np.abs(missed).max() <= settings.missed * largest and slope != 0.0:
            return r, r + room, start, end
        room = int(0.7 * room)
    return None


def _joined(
    row: NDArray[np.int64], volts: Array, groups: list[tuple[int, int, float, float]], last: int, linear: bool
) -> Lines:
    """The rows without those within groups."""
    keep = np.zeros(volts.size, dtype=bool)
    keep[row] = True
    start = np.concatenate([volts[:1], volts[:-1]]) if linear else volts.copy()
    end = volts.copy()
    unread = np.zeros(volts.size, dtype=bool)
    for first, stop, a, b in groups:
        keep[first + 1 : stop - last] = False
        start[stop - last], end[stop - last] = a, b
        unread[stop - last : stop] = True
    left = np.flatnonzero(keep)
    return Lines(left, start[left], end[left], np.flatnonzero(unread[left]))

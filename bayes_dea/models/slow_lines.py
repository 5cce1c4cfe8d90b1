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

#: a command is smooth where it bends from row to row by this share of its largest size at most, and a bend beyond the
#: second figure is a jump; share by which a line may miss its rows
_BEND, _JUMP, _MISSED = 1e-4, 5e-3, 2.5e-5
#: change of the command within a group, as a share of its largest size: the square of it, read off straight, is out by
#: a sixth of the square of this on average
_CHANGE = 0.008
#: time after a jump and after a kink in which every row is kept (s), share of the time since either that a group lasts
_AFTER_JUMP_S, _AFTER_KINK_S, _SINCE = 0.3, 0.1, 0.05
#: fewest rows of a group, held rows at its end
_FEWEST, _LAST = 12, 2


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


def slow_lines(row: NDArray[np.int64], volts: Array, step_s: float, linear: bool) -> Lines | None:
    """Groups of rows (see module) among the rows (m,) that are known so far; None where there are none.

    volts (n,): the command at every row, held until the row or, with `linear`, straight between rows.
    """
    largest = float(np.max(np.abs(volts)))
    if largest == 0.0 or row.size < 3:
        return None
    room = _room(volts, largest, step_s)
    # rows that are left out already stand still
    room[:-1][np.isin(np.arange(volts.size - 1) + 1, row, invert=True)] = 0
    starts = np.flatnonzero(room >= _FEWEST)
    last = 0 if linear else _LAST
    groups = []
    at = 0
    while at < starts.size:
        r = int(starts[at])
        group = _group(volts, r, int(room[r]), last, largest, linear)
        if group is not None:
            groups.append(group)
        at = int(np.searchsorted(starts, r + 1 if group is None else group[1]))
    return _joined(row, volts, groups, last, linear) if groups else None


def _room(volts: Array, largest: float, step_s: float) -> NDArray[np.int64]:
    """Rows (n,) that a group which begins at a row may have, the deviation from a line apart."""
    n = volts.size
    at = np.arange(n)
    change = np.diff(volts)
    bend = np.zeros(n)
    bend[1:-1] = np.abs(np.diff(change))
    rough = bend > _BEND * largest
    rough[[0, -1]] = True
    jump = rough & (bend > _JUMP * largest)
    jump[0] = True
    turns = rough.copy()
    turns[1:-1] |= change[1:] * change[:-1] <= 0.0
    since_jump = at - np.maximum.accumulate(np.where(jump, at, 0))
    since = at - np.maximum.accumulate(np.where(rough, at, 0))
    until = np.minimum.accumulate(np.where(turns, at, n)[::-1])[::-1]
    until = np.append(until[1:], n - 1)  # a group may begin at a turn
    out = np.minimum((_SINCE * since).astype(np.int64), until - at)
    out[(since_jump * step_s < _AFTER_JUMP_S) | (since * step_s < _AFTER_KINK_S)] = 0
    speed = np.abs(np.append(change, 0.0))
    out = np.minimum(out, np.minimum(_CHANGE * largest / np.maximum(speed, 1e-300), 1e9).astype(np.int64))
    return np.asarray(out)


def _group(
    volts: Array, r: int, room: int, last: int, largest: float, linear: bool
) -> tuple[int, int, float, float] | None:
    """First and last row of a group from row r on, its line's ends (V)."""
    while room >= _FEWEST:
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
        if np.abs(missed).max() <= _MISSED * largest and slope != 0.0:
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

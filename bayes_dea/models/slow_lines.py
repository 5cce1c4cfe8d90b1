"""Slow sines and triangles in few steps: where a command changes at every row, by little.

Many such rows make one step, in which the command is a straight line with the mean of the rows. A held command reaches
a row half a row's change behind that line, and what is quick answers the staircase, not the line. So the last rows of
every group stay steps of their own: a lag of x rows sees line and staircase differ by a share of 1/(12 x) of a row's
change at most, and forgets that by exp(-1/x) in each of them. Only the last one is read; between rows that are read
the output is smooth, but for the corners and turns of the command.

Where rows of a recording are missing all of this is about the ticks of its clock (`course`), those rows among them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit, read_only

Array = NDArray[np.float64]

#: share of a command's largest size from which on a bend from row to row is a jump
_JUMP = 5e-3
#: the same for a kink, and how many times more than two rows before and after the command bends there
_KINK, _SHARP = 1.5e-4, 4.0
#: rows that are kept before a corner of a command; readings may lead it by one less
AHEAD = 3


@dataclass(frozen=True)
class LineSettings:
    """How long a group may be.

    bend: share of a command's largest size up to which it is smooth where it bends from row to row. missed: the same by
    which a line may miss its rows. change: of the command within a group, as a share of its largest size: a delay reads
    its square off straight, which is out by a sixth of the square of this on average. after_jump_s, after_kink_s (s):
    time in which every row is kept, ahead: rows before either that are, too: readings that lead their command show it
    in them. since: share of the time since either that a group lasts. fewest: rows of a group, last: held rows at its
    end.
    """

    bend: float = 1e-4
    missed: float = 2.5e-5
    change: float = 0.008
    after_jump_s: float = 0.3
    after_kink_s: float = 0.1
    since: float = 0.05
    ahead: int = AHEAD
    fewest: int = 12
    last: int = 2


#: enough for a posterior: within hundredths of what a sensor resolves
FINE = LineSettings()
#: enough for what a small change of the parameters changes: to thousandths of it, at worst a few hundredths
ROUGH = LineSettings(
    bend=_JUMP, missed=3e-3, change=0.15, after_jump_s=0.01, after_kink_s=0.005, since=0.5, ahead=0, fewest=6
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
    row: NDArray[np.int64], volts: Array, bends: Array, known: NDArray[np.bool_], step_s: float, linear: bool,
    settings: LineSettings = FINE,
) -> Lines | None:
    """Groups of rows (see module) among the rows (m,) that are known so far; None where there are none.

    volts (n,): the command at every row, held until the row or, with `linear`, straight between rows. bends (n,) V: see
    `bend`. known (n,): rows that a group may begin and end with; the others are missing from the recording.
    """
    largest = float(np.max(np.abs(volts)))
    if largest == 0.0 or row.size < 3:
        return None
    room = _room(volts, bends, largest, step_s, settings)
    # rows that are left out already stand still
    room[:-1][np.isin(np.arange(volts.size - 1) + 1, row, invert=True)] = 0
    starts = np.flatnonzero((room >= settings.fewest) & known)
    last = 0 if linear else settings.last
    # first and last row of each group, its line's ends (V)
    first, stop, start, end = _groups(
        read_only(volts), known, starts, room, last, linear, settings.fewest,
        settings.missed * largest,
    )
    return _joined(row, volts, first, stop, start, end, last, linear) if first.size else None


def corners(volts: Array, bends: Array) -> NDArray[np.int64]:
    """Rows (k,) at which a command (n,) V jumps or kinks: it bends (n,) V there far more than before and after.

    A kink between two rows bends at both.
    """
    beside = np.pad(bends, 2)
    beside = np.maximum(beside[:-4], beside[4:])
    least = _KINK * np.max(np.abs(volts))
    out = bends > np.maximum(least, _SHARP * beside)
    both = bends[:-1] + bends[1:]
    around = np.pad(bends, 2)
    around = np.maximum(around[: both.size], around[5:][: both.size])  # two rows before the first, two after the second
    split = (both > np.maximum(least, 2.0 * _SHARP * around)) & (np.minimum(bends[:-1], bends[1:]) > 0.1 * both)
    out[:-1] |= split
    out[1:] |= split
    return np.flatnonzero(out)


def turns(volts: Array) -> NDArray[np.int64]:
    """Rows (k,) at which a command (n,) V turns, or begins or ceases to move."""
    change = np.sign(np.diff(volts))
    return np.flatnonzero(change[1:] != change[:-1]) + 1


def bend(volts: Array, at: Array | None = None) -> Array:
    """Change (n,) V of a command's change at each row, zero at the ends. at (n,): when it was taken, in steps."""
    change = np.diff(volts)
    out = np.zeros(volts.size)
    out[1:-1] = np.abs(np.diff(change if at is None else change / np.diff(at)))
    return out


def _room(volts: Array, bends: Array, largest: float, step_s: float, settings: LineSettings) -> NDArray[np.int64]:
    """Rows (n,) that a group which begins at a row may have, the deviation from a line apart."""
    n = volts.size
    at = np.arange(n)
    change = np.diff(volts)
    rough = bends > settings.bend * largest
    rough[corners(volts, bends)] = True
    rough[[0, -1]] = True
    jump = rough & (bends > _JUMP * largest)
    jump[0] = True
    ends = rough.copy()
    ends[1:-1] |= change[1:] * change[:-1] <= 0.0
    since_jump = at - np.maximum.accumulate(np.where(jump, at, 0))
    since = at - np.maximum.accumulate(np.where(rough, at, 0))
    # a group may begin at a turn
    until = np.minimum(_next(ends), _next(rough) - settings.ahead)
    out = np.minimum((settings.since * since).astype(np.int64), until - at)
    out[(since_jump * step_s < settings.after_jump_s) | (since * step_s < settings.after_kink_s)] = 0
    speed = np.abs(np.append(change, 0.0))
    out = np.minimum(out, np.minimum(settings.change * largest / np.maximum(speed, 1e-300), 1e9).astype(np.int64))
    return np.asarray(out)


def _next(marks: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The next marked row (n,) behind each row, the last one where there is none."""
    n = marks.size
    following = np.minimum.accumulate(np.where(marks, np.arange(n), n)[::-1])[::-1]
    return np.append(following[1:], n - 1)


@njit(cache=True)
def _groups(volts, known, starts, room, last, linear, fewest, missed):
    """Groups from left to right: first row (k,), last row (k,), and start and end of the line (k,) V of each.

    A group begins at one of the rows `starts`, is as long as its room there or shorter, and ends in `last` held rows
    that are known; missed: volts by which its line may miss a row.
    """
    first, stop = np.empty(starts.size, dtype=np.int64), np.empty(starts.size, dtype=np.int64)
    start, end = np.empty(starts.size), np.empty(starts.size)
    found, at = 0, 0
    while at < starts.size:
        r = starts[at]
        long, go_on = room[r], r + 1
        while long >= fewest:
            there = True
            for i in range(last + 1):
                there = there and known[r + long - i]
            if not there:
                long -= 1
                continue
            k = long - last
            slope = (volts[r + k] - volts[r + 1]) / (k - 1)
            mean = 0.0
            for i in range(1, k + 1):
                mean += volts[r + i]
            middle = 0.5 * (k - 1)
            if linear:
                mean += 0.5 * (volts[r] - volts[r + k])
                middle -= 0.5
            mean /= k
            worst = 0.0
            for i in range(k):
                worst = max(worst, abs(volts[r + 1 + i] - (mean + slope * (i - middle))))
            if worst <= missed and slope != 0.0:
                first[found], stop[found] = r, r + long
                # straight between rows, it has to end where the next one begins
                start[found] = 2.0 * mean - volts[r + k] if linear else mean - 0.5 * slope * k
                end[found] = volts[r + k] if linear else mean + 0.5 * slope * k
                found += 1
                go_on = r + long
                break
            long = int(0.7 * long)
        while at < starts.size and starts[at] < go_on:
            at += 1
    return first[:found], stop[:found], start[:found], end[:found]


def _joined(
    row: NDArray[np.int64], volts: Array, first: NDArray[np.int64], stop: NDArray[np.int64], begin: Array,
    finish: Array, last: int, linear: bool,
) -> Lines:
    """The rows without those within groups; first, stop, begin, finish (k,): see `_groups`."""
    keep = np.zeros(volts.size, dtype=bool)
    keep[row] = True
    start = np.concatenate([volts[:1], volts[:-1]]) if linear else volts.copy()
    end = volts.copy()
    if linear:
        start[row[1:]] = volts[row[:-1]]
    else:
        # across rows that are missing; those that are left out stand still
        start[row[1:]] = volts[row[:-1] + 1]
    unread = np.zeros(volts.size + 1, dtype=np.int64)
    within = np.zeros(volts.size + 1, dtype=np.int64)
    for mark, ahead, behind in ((within, first + 1, stop - last), (unread, stop - last, stop)):
        np.add.at(mark, ahead, 1)
        np.add.at(mark, behind, -1)
    keep &= np.cumsum(within)[:-1] == 0
    start[stop - last], end[stop - last] = begin, finish
    left = np.flatnonzero(keep)
    return Lines(left, start[left], end[left], np.flatnonzero(np.cumsum(unread)[:-1][left] > 0))

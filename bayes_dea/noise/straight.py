"""The straight pieces of a measured input: a testing machine moves at constant speeds or holds.

Between its corners such an input is known far better than by any one reading: a line through hundreds of rows. What is
not straight stays as it was measured. Pieces are found as change points are, by what a split saves in squared
residuals (binary segmentation; Fryzlewicz 2014, doi:10.1214/14-AOS1245), then every border is moved to its best place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from .blocks import Blocks

Array = NDArray[np.float64]

#: squared residuals (in variances) that a split has to save: by chance in less than one of a thousand lines
_SAVED = 25.0
#: passes over the borders, and blocks that are split at first
_PASSES, _PART = 3, 4096
#: sds of a block's mean within which it may belong to either of two lines
_DOUBT = 5.0
#: rows on either side of a corner that are not judged
_BESIDE = 2
#: fewest readings of a line whose error is known as that of a line, and how many lines
_LEAST, _MOST = 4, 40
#: cosines along a line by which it may be bent: fewest blocks for each, highest order, standard errors that show one,
#: how many in all; the orders of a line that is part of a curve
_BLOCKS_A_WAVE, _HIGHEST, _SHOWN, _WAVES, _CURVE = 3, 60, 4.5, 40, (2, 3)
#: standard errors by which the slope of a line differs from rest
_MOVES = 3.0


@dataclass(frozen=True)
class Wave:
    """A cosine along a line: its piece, half-waves, sd in that of one reading, and where its line begins and ends."""

    piece: int
    order: int
    size: float
    start_s: float
    stop_s: float

    def at(self, time_s: Array) -> Array:
        """The cosine (n,) at times (n,) s, of height `size`."""
        along = np.clip((time_s - self.start_s) / (self.stop_s - self.start_s), 0.0, 1.0)
        return np.asarray(self.size * np.cos(math.pi * self.order * along))


@dataclass(frozen=True)
class Straight:
    """Lines through blocks. Piece k covers the blocks first[k] ... stop[k] - 1; of one block it has no slope.

    centre_s, value, slope (k,): the line; rows (k,): readings behind it; spread_s (k,): sd of their times.
    begin_s (k,): where it begins, at the crossing with the line before if the two meet there. time_s, level (c,):
    corners, between which the input is straight. waves: what of the input its lines may miss.
    """

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    centre_s: Array
    value: Array
    slope: Array
    rows: NDArray[np.int64]
    spread_s: Array
    begin_s: Array
    time_s: Array
    level: Array
    waves: tuple[Wave, ...] = ()

    @property
    def corners(self) -> Array:
        """Times and levels of the corners (2, c)."""
        return np.array([self.time_s, self.level])

    def at(self, time_s: Array) -> Array:
        """The input (n,) at times (n,) s; constant before the first corner and after the last."""
        return np.asarray(np.interp(time_s, self.time_s, self.level))

    def errors(self, time_s: Array) -> tuple[Array, NDArray[np.bool_]]:
        """What readings of sd 1 leave in the lines at times (n,) s: columns (k, n) of sd 1, and where none stands (n,).

        Level and slope of the longest lines through several blocks, independent of one another, and how they may be
        bent; elsewhere a mean of readings is as scattered as these.
        """
        several = (self.stop - self.first > 1) & (self.rows >= _LEAST)
        longest = np.argsort(-self.rows * several, kind="stable")[:_MOST]
        piece = np.clip(np.searchsorted(self.begin_s, time_s, side="right") - 1, 0, None)
        columns = []
        for k in np.sort(longest[several[longest]]):
            level = (piece == k) / np.sqrt(self.rows[k])
            columns += [level, level * (time_s - self.centre_s[k]) / self.spread_s[k]]
            columns += [np.where(piece == k, wave.at(time_s), 0.0) for wave in self.waves if wave.piece == k]
        lines = np.array(columns).reshape(-1, time_s.size)
        return lines, ~np.any(lines != 0.0, axis=0)

    def at_corners(self, time_s: Array) -> NDArray[np.bool_]:
        """Times (n,) s within `_BESIDE` steps of a corner at which two lines meet.

        What depends on the speed jumps there, and a machine takes some hundredths of a second to turn: it overshoots or
        cuts the corner by micrometres that no position shows, but a force does.
        """
        out = np.zeros(time_s.size, dtype=bool)
        lines = self.stop - self.first > 1
        bend = np.diff(self.slope)
        for k in np.flatnonzero(lines[:-1] & lines[1:] & (bend != 0.0)):
            at = -float(np.diff(self.value - self.slope * self.centre_s)[k]) / bend[k]
            right = int(np.searchsorted(time_s, at))
            out[max(right - _BESIDE, 0) : right + _BESIDE] = True
        return out


def straight_pieces(time_s: Array, blocks: Blocks, means: Array, sd: float) -> Straight:
    """Pieces of an input that is known by its means (nb,) over blocks; sd: scatter of one of its readings."""
    t, u = np.ascontiguousarray(blocks.time_s), np.ascontiguousarray(means, dtype=float)
    w = blocks.count / sd**2
    borders = _merged(t, u, w, _split(t, u, w))
    for _ in range(_PASSES):
        moved = _merged(t, u, w, _shared(t, u, w, _placed(t, u, w, borders)))
        if np.array_equal(moved, borders):
            break
        borders = moved
    first, stop = borders[:-1], borders[1:]
    lines = [_line(t, u, w, a, b) for a, b in zip(first, stop, strict=True)]
    centre, value, slope, spread = (np.array([line[i] for line in lines]) for i in range(4))
    rows = np.add.reduceat(blocks.count, first)
    # blocks begin and end with rows
    begin, end = time_s[blocks.start[first]], time_s[blocks.stop[stop - 1] - 1]
    begin, time, level = _corners(first, stop, centre, value, slope, begin, end, t, u, w)
    onward = _onward(slope, np.abs(slope) * spread * np.sqrt(rows) > _MOVES * sd)
    waves = _waves(t, u, w, sd, first, stop, onward)
    return Straight(first, stop, centre, value, slope, rows, spread, begin, time, level, waves)


def _onward(slope: Array, moves: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Lines (k,) before or after which the input goes on in the same direction, at another speed."""
    same = moves[1:] & moves[:-1] & (slope[1:] * slope[:-1] > 0.0)
    return np.append(same, False) | np.append(False, same)


def _waves(
    t: Array, u: Array, w: Array, sd: float, first: NDArray[np.int64], stop: NDArray[np.int64],
    curved: NDArray[np.bool_],
) -> tuple[Wave, ...]:
    """How the lines may be bent: a machine gathers speed, or swings about its way.

    What readings show counts by its height. Lines that are part of a curve (k,) may miss of it what the readings do not
    tell.
    """
    found: list[Wave] = []
    for k in np.flatnonzero(stop - first >= _CURVE[0] * _BLOCKS_A_WAVE):
        part = slice(int(first[k]), int(stop[k]))
        orders = np.arange(_CURVE[0], min((part.stop - part.start) // _BLOCKS_A_WAVE, _HIGHEST) + 1)
        along = (t[part] - t[part.start]) / (t[part.stop - 1] - t[part.start])
        root = np.sqrt(w[part])
        line = np.linalg.qr(np.stack([root, root * along]).T)[0]
        rows = root[:, None] * np.cos(math.pi * along[:, None] * orders)
        rows -= line @ (line.T @ rows)
        rest = root * u[part] - line @ (line.T @ (root * u[part]))
        known = np.sum(rows**2, axis=0)
        height, error = rows.T @ rest / known, 1.0 / np.sqrt(known)
        seen = np.abs(height) > _SHOWN * error
        for i in np.flatnonzero(seen | (curved[k] & np.isin(orders, _CURVE))):
            size = math.hypot(height[i], error[i]) / sd
            found.append(Wave(int(k), int(orders[i]), size, float(t[part.start]), float(t[part.stop - 1])))
    largest = sorted(found, key=lambda wave: -wave.size**2 * float(w[first[wave.piece] : stop[wave.piece]].sum()))
    return tuple(largest[:_WAVES])


@njit(cache=True)
def _line(t, u, w, a, b):
    """Centre, value there, slope, sd of the times and squared residuals of the line through the values a ... b - 1."""
    n = ct = cu = tt = tu = uu = 0.0
    for i in range(a, b):
        n += w[i]
        dt, du = t[i] - ct, u[i] - cu
        ct += dt * w[i] / n
        cu += du * w[i] / n
        tt += w[i] * dt * (t[i] - ct)
        tu += w[i] * dt * (u[i] - cu)
        uu += w[i] * du * (u[i] - cu)
    slope = tu / tt if tt > 0.0 else 0.0
    rest = uu - slope * tu if b - a > 2 else 0.0
    return ct, cu, slope, math.sqrt(tt / n), max(rest, 0.0)


@njit(cache=True)
def _rests(t, u, w, start, step, n, line, out):
    """Squared residuals of the lines through the first 1 ... n values from `start` on, forwards or backwards, in `out`.

    From a line (centre, value, slope) near all of them sums stay small numbers.
    """
    total = ct = cu = tt = tu = uu = 0.0
    for j in range(n):
        i = start + step * j
        y = u[i] - line[1] - line[2] * (t[i] - line[0])
        total += w[i]
        dt, du = t[i] - ct, y - cu
        ct += dt * w[i] / total
        cu += du * w[i] / total
        tt += w[i] * dt * (t[i] - ct)
        tu += w[i] * dt * (y - cu)
        uu += w[i] * du * (y - cu)
        out[j] = max(uu - tu * tu / tt, 0.0) if j > 1 and tt > 0.0 else 0.0


@njit(cache=True)
def _best(t, u, w, a, b, room):
    """Where two lines through the values a ... b - 1 save most, and how much; the first of the second line.

    room (2, at least b - a): for sums from either end.
    """
    line = _line(t, u, w, a, b)
    n = b - a
    _rests(t, u, w, a, np.int64(1), n, line, room[0])
    _rests(t, u, w, b - 1, np.int64(-1), n, line, room[1])
    best, least = 1, math.inf
    for k in range(n - 1, 0, -1):
        both = room[0, k - 1] + room[1, n - k - 1]
        if both < least:
            best, least = k, both
    return a + best, line[4] - least


@njit(cache=True)
def _split(t, u, w):
    """Borders, from top to bottom; first of parts of bounded length, whose borders go again where they can."""
    n = t.size
    border = np.zeros(n + 1, dtype=np.bool_)
    border[0] = border[n] = True
    room = np.empty((2, n))
    todo = np.empty((n + 2, 2), dtype=np.int64)
    waiting = 0
    for a in range(0, n, _PART):
        border[a] = True
        todo[waiting, 0], todo[waiting, 1] = a, min(a + _PART, n)
        waiting += 1
    while waiting > 0:
        waiting -= 1
        a, b = todo[waiting]
        if b - a < 2:
            continue
        k, saved = _best(t, u, w, a, b, room)
        if saved > _SAVED:
            border[k] = True
            todo[waiting, 0], todo[waiting, 1] = a, k
            todo[waiting + 1, 0], todo[waiting + 1, 1] = k, b
            waiting += 2
    return np.flatnonzero(border)


@njit(cache=True)
def _placed(t, u, w, borders):
    """Every border at its best place between those beside it."""
    out = borders.copy()
    room = np.empty((2, t.size))
    for i in range(1, out.size - 1):
        k, saved = _best(t, u, w, out[i - 1], out[i + 1], room)
        if saved > 0.0:
            out[i] = k
    return out


@njit(cache=True)
def _shared(t, u, w, borders):
    """Without the pieces that save too little beside the two lines around them, which share their values.

    A turn that readings blur may get a short piece of its own, which neither line alone can take in.
    """
    out = borders.copy()
    m = borders.size
    room = np.empty((2, t.size))
    i = 1
    while i + 2 < m:
        a, b, c, d = out[i - 1], out[i], out[i + 1], out[i + 2]
        parts = _line(t, u, w, a, b)[4] + _line(t, u, w, b, c)[4] + _line(t, u, w, c, d)[4]
        k, saved = _best(t, u, w, a, d, room)
        if _line(t, u, w, a, d)[4] - saved - parts <= _SAVED:
            out[i] = k
            for j in range(i + 1, m - 1):
                out[j] = out[j + 1]
            m -= 1
        else:
            i += 1
    return out[:m]


@njit(cache=True)
def _merged(t, u, w, borders):
    """Without the borders that save too little."""
    out = np.empty_like(borders)
    out[0], m = borders[0], 1
    for i in range(1, borders.size - 1):
        a, k, b = out[m - 1], borders[i], borders[i + 1]
        parts = _line(t, u, w, a, k)[4] + _line(t, u, w, k, b)[4]
        if _line(t, u, w, a, b)[4] - parts > _SAVED:
            out[m] = k
            m += 1
    out[m] = borders[-1]
    return out[: m + 1]


def _corners(
    first: NDArray[np.int64], stop: NDArray[np.int64], centre: Array, value: Array, slope: Array, begin: Array,
    end: Array, t: Array, u: Array, w: Array,
) -> tuple[Array, Array, Array]:
    """Where lines begin, times and levels between which the input is straight.

    Two lines that cross at their border meet there; others are joined from the last row of one to the first row of the
    next. Blocks that lie between the border and the crossing may belong to either line if these are no further apart
    there than `_DOUBT`, or if that they do costs no more in squared residuals than a split has to save: of many corners
    one has noise beside it that moves the border by three rows.
    """
    single, doubt = stop - first == 1, _DOUBT / np.sqrt(w)
    begin = begin.copy()

    def on(k: int, at: float) -> float:
        return float(value[k] + slope[k] * (at - centre[k]))

    def switched(k: int, at: float) -> float:
        """What the blocks between a border and the crossing of its lines cost on the other one."""
        crossing = int(np.searchsorted(t, at))
        part = slice(min(crossing, int(stop[k])), max(crossing, int(stop[k])))
        one, other = (u[part] - value[j] - slope[j] * (t[part] - centre[j]) for j in (k, k + 1))
        cost = float(np.sum(w[part] * (other**2 - one**2)))
        return cost if crossing < stop[k] else -cost

    time, level = [centre[0] if single[0] else begin[0]], [value[0] if single[0] else on(0, begin[0])]
    for k in range(first.size):
        if k + 1 == first.size:
            if not single[k]:
                time.append(end[k])
                level.append(on(k, end[k]))
            break
        bend = slope[k] - slope[k + 1]
        if not single[k] and not single[k + 1] and bend != 0.0:
            at = centre[k] + (value[k + 1] - value[k] + slope[k + 1] * (centre[k] - centre[k + 1])) / bend
            last, following = stop[k] - 1, first[k + 1]
            early, late = abs(bend) * (t[last] - at), abs(bend) * (at - t[following])
            # not before the line begins, itself at a crossing perhaps
            within = max(t[first[k]], begin[k]) < at < t[stop[k + 1] - 1]
            near = max(early - doubt[last], late - doubt[following]) <= 0.0
            if within and (near or switched(k, at) <= _SAVED):
                time.append(at)
                level.append(on(k, at))
                begin[k + 1] = at
                continue
        if not single[k]:
            time.append(max(end[k], begin[k]))
            level.append(on(k, time[-1]))
        time.append(centre[k + 1] if single[k + 1] else begin[k + 1])
        level.append(value[k + 1] if single[k + 1] else on(k + 1, begin[k + 1]))
    order = np.maximum.accumulate(np.array(time))
    return begin, order, np.array(level)

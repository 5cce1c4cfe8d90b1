"""The straight pieces of a measured input: a testing machine moves at constant speeds or holds.

Between its corners such an input is known far better than by any one reading: a line through hundreds of rows. What is
not straight stays as it was measured. Pieces are found as change points are, by what a split saves in squared
residuals (binary segmentation; Fryzlewicz 2014, doi:10.1214/14-AOS1245), then every border is moved to its best place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .blocks import Blocks

Array = NDArray[np.float64]

#: squared residuals (in variances) that a split has to save: by chance in less than one of a thousand lines
_SAVED = 25.0
#: passes over the borders
_PASSES = 3
#: sds of a block's mean within which it may belong to either of two lines
_DOUBT = 5.0
#: fewest readings of a line whose error is known as that of a line, and how many lines
_LEAST, _MOST = 4, 40


@dataclass(frozen=True)
class Straight:
    """Lines through blocks. Piece k covers the blocks first[k] ... stop[k] - 1; of one block it has no slope.

    centre_s, value, slope (k,): the line; rows (k,): readings behind it; spread_s (k,): sd of their times.
    begin_s (k,): where it begins. time_s, level (c,): corners, between which the input is straight.
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

    @property
    def corners(self) -> Array:
        """Times and levels of the corners (2, c)."""
        return np.array([self.time_s, self.level])

    def at(self, time_s: Array) -> Array:
        """The input (n,) at times (n,) s; constant before the first corner and after the last."""
        return np.asarray(np.interp(time_s, self.time_s, self.level))

    def errors(self, time_s: Array) -> tuple[Array, NDArray[np.bool_]]:
        """What readings of sd 1 leave in the lines at times (n,) s: columns (k, n) of sd 1, and where none stands (n,).

        Level and slope of the longest lines through several blocks, independent of one another; elsewhere a mean of
        readings is as scattered as these.
        """
        several = (self.stop - self.first > 1) & (self.rows >= _LEAST)
        longest = np.argsort(-self.rows * several, kind="stable")[:_MOST]
        piece = np.clip(np.searchsorted(self.begin_s, time_s, side="right") - 1, 0, None)
        columns = []
        for k in np.sort(longest[several[longest]]):
            level = (piece == k) / np.sqrt(self.rows[k])
            columns += [level, level * (time_s - self.centre_s[k]) / self.spread_s[k]]
        lines = np.array(columns).reshape(-1, time_s.size)
        return lines, ~np.any(lines != 0.0, axis=0)


def straight_pieces(time_s: Array, blocks: Blocks, means: Array, sd: float) -> Straight:
    """Pieces of an input that is known by its means (nb,) over blocks; sd: scatter of one of its readings."""
    t, u, n = blocks.time_s, np.asarray(means, dtype=float), blocks.count.astype(float)
    w = n / sd**2
    borders = _merged(t, u, w, _split(t, u, w))
    for _ in range(_PASSES):
        moved = _merged(t, u, w, _placed(t, u, w, borders))
        if moved == borders:
            break
        borders = moved
    first, stop = np.array(borders[:-1], dtype=np.int64), np.array(borders[1:], dtype=np.int64)
    lines = [_line(t[a:b], u[a:b], w[a:b]) for a, b in zip(first, stop, strict=True)]
    centre, value, slope, spread = (np.array([line[i] for line in lines]) for i in range(4))
    rows = np.add.reduceat(blocks.count, first)
    # blocks begin and end with rows
    begin, end = time_s[blocks.start[first]], time_s[blocks.stop[stop - 1] - 1]
    corners = _corners(first, stop, centre, value, slope, begin, end, t, _DOUBT / np.sqrt(w))
    return Straight(first, stop, centre, value, slope, rows, spread, begin, *corners)


def _line(t: Array, u: Array, w: Array) -> tuple[float, float, float, float]:
    """Centre, value there, slope and sd of the times of the line through u."""
    total = w.sum()
    centre = float(w @ t / total)
    value = float(w @ u / total)
    d = t - centre
    square = float(w @ (d * d))
    slope = float((w * d) @ (u - value) / square) if t.size > 1 and square > 0 else 0.0
    return centre, value, slope, float(np.sqrt(square / total))


def _sums(t: Array, u: Array, w: Array) -> Array:
    """Squared residuals of the lines through the first 0 ... n values (n + 1,)."""
    d, y = t - t[0], u
    s = np.zeros((6, t.size + 1))
    s[:, 1:] = np.cumsum(np.array([w, w * d, w * d * d, w * y, w * d * y, w * y * y]), axis=1)
    n, sd, sdd, sy, sdy, syy = s
    n = np.where(n > 0, n, 1.0)
    a, b, c = sdd - sd * sd / n, sdy - sd * sy / n, syy - sy * sy / n
    left = c - np.where(a > 1e-12 * sdd, b * b / np.where(a > 0, a, 1.0), 0.0)
    # one value lies on its line, two do
    left[:3] = 0.0
    return np.maximum(left, 0.0)


def _best(t: Array, u: Array, w: Array) -> tuple[int, float]:
    """Where two lines save most, and how much; the first of the second line."""
    if t.size < 2:
        return 0, 0.0
    centre, value, slope, _ = _line(t, u, w)
    r = u - value - slope * (t - centre)  # small numbers: sums of their squares keep what splits them
    before, after = _sums(t, r, w), _sums(-t[::-1], r[::-1], w[::-1])[::-1]
    both = (before + after)[1:-1]
    k = int(np.argmin(both))
    return k + 1, float(before[-1] - both[k])


def _split(t: Array, u: Array, w: Array) -> list[int]:
    """Borders, from top to bottom."""
    found, todo = {0, t.size}, [(0, t.size)]
    while todo:
        a, b = todo.pop()
        k, saved = _best(t[a:b], u[a:b], w[a:b])
        if saved > _SAVED:
            found.add(a + k)
            todo += [(a, a + k), (a + k, b)]
    return sorted(found)


def _placed(t: Array, u: Array, w: Array, borders: list[int]) -> list[int]:
    """Every border at its best place between those beside it."""
    out = list(borders)
    for i in range(1, len(out) - 1):
        a, b = out[i - 1], out[i + 1]
        k, _ = _best(t[a:b], u[a:b], w[a:b])
        out[i] = a + k if 0 < k < b - a else out[i]
    return out


def _merged(t: Array, u: Array, w: Array, borders: list[int]) -> list[int]:
    """Without the borders that save too little."""
    out = [borders[0]]
    for i in range(1, len(borders) - 1):
        a, b, k = out[-1], borders[i + 1], borders[i]
        whole = _sums(t[a:b], _flat(t[a:b], u[a:b], w[a:b]), w[a:b])[-1]
        parts = sum(_sums(t[c:d], _flat(t[c:d], u[c:d], w[c:d]), w[c:d])[-1] for c, d in ((a, k), (k, b)))
        if whole - parts > _SAVED:
            out.append(k)
    return [*out, borders[-1]]


def _flat(t: Array, u: Array, w: Array) -> Array:
    centre, value, slope, _ = _line(t, u, w)
    return np.asarray(u - value - slope * (t - centre))


def _corners(
    first: NDArray[np.int64], stop: NDArray[np.int64], centre: Array, value: Array, slope: Array, begin: Array,
    end: Array, t: Array, doubt: Array,
) -> tuple[Array, Array]:
    """Times and levels between which the input is straight.

    Two lines that cross at their border meet there; others are joined from the last row of one to the first row of the
    next. Blocks that lie between the border and the crossing may belong to either line if these are no further apart
    there than `doubt` (nb,), in the unit of the input.
    """
    single = stop - first == 1

    def on(k: int, at: float) -> float:
        return float(value[k] + slope[k] * (at - centre[k]))

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
            if max(early - doubt[last], late - doubt[following]) <= 0.0 and t[first[k]] < at < t[stop[k + 1] - 1]:
                time.append(at)
                level.append(on(k, at))
                continue
        if not single[k]:
            time.append(end[k])
            level.append(on(k, end[k]))
        time.append(centre[k + 1] if single[k + 1] else begin[k + 1])
        level.append(value[k + 1] if single[k + 1] else on(k + 1, begin[k + 1]))
    order = np.maximum.accumulate(np.array(time))
    return order, np.array(level)

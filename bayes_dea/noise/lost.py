"""A sensor that loses its target: readings that nothing between the rows before and after can have been."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..campaign.scratch import BLOCK, beside, pieces, rows_where
from .edges import find_edges

Array = NDArray[np.float64]

#: levels of the input that readings are sorted by, the quantiles of a level between which its readings lie, and how
#: many of them a level has to have for others to be judged by
_LEVELS, _LOW, _HIGH, _KNOWN = 24, 0.1, 0.9, 20
#: spans by which a reading lies beyond all others: a mass that swings on a step goes to twice the step, at most
_BEYOND = 2.0
#: share of that room by which they leap there and back, the rows on either side of a leap that are looked at, and
#: rows within which an actuator answers a jump of the input
_LEAP, _SIDE, _AT_ONCE = 0.25, 3, 2
#: share of the readings that may be lost; with more of them it is not known which are
_MOST = 0.05
#: what a held value has to jump by on either side: in sds of what noise changes from row to row, in resolution steps,
#: as a share of what is spanned, and in the largest changes of the rows beside it
_SDS, _STEPS, _SHARE, _CHANGES = 20.0, 5.0, 1e-3, 4.0
#: sds that are enough where a value is held for longer than chance makes equal readings, and what chance that is
_SDS_LONG, _CHANCE = 5.0, 1e-12
#: changes beside a jump that are looked at, within how many rows, and rows around it in which the input does not jump
_BESIDE, _NEAR, _QUIET = 5, 250, 5
#: the same before jumps to the largest or smallest reading, where a sensor's range may end: what is late comes then
_QUIET_AT_END = 100
#: jumps of the input to one run of a value from which on the runs are no answer to them
_EDGES_A_RUN = 8
#: readings that levels and changes are learned from, about
_LEARNED = 200_000


def find_lost(y: ArrayLike, u: ArrayLike, *, resolution: float | None = None, most: float = _MOST
              ) -> NDArray[np.bool_]:
    """Mask of readings of a lost target, True where a reading is false; shape (n,). Runs of any length are found.

    A reading is false where it lies beyond what the readings of all levels of the input span by twice that span, and
    they leap there and back: what fades from there, as a stroke that a charge takes back for minutes, is true. And
    where it belongs to a run of one and the same value, two rows or more, that the readings leap to and back from, by
    twenty sds of what noise changes from row to row (five for more rows than chance makes equal) and four times the
    changes beside, while the input does not. Where more than `most` would be false nothing is: it is not known then
    which readings are true.

    Parameters
    ----------
    y : observed column, shape (n,); nan cells are gaps and never flagged.
    u : input, shape (n,).
    resolution : quantisation step.
    most : share of the readings that may be false, by default a twentieth.
    """
    values, drive = np.asarray(y, dtype=float), np.asarray(u, dtype=float)
    mask = beside(values, np.bool_)
    step = resolution or 0.0
    bottom, top = _beyond_all(values, drive, step, mask)
    for first, stop in _held(values, drive, max(_STEPS * step, _SHARE * (top - bottom)), mask, most):
        mask[first:stop] = True
    if np.count_nonzero(mask) > most * values.size:
        mask[:] = False
    return mask


def without_lost(y: Array, lost: NDArray[np.bool_]) -> Array:
    """A column (n,) with gaps where readings are lost; itself where none is."""
    if not lost.any():
        return y
    out = beside(y)
    for part in pieces(y.size, BLOCK):
        out[part] = np.where(lost[part], np.nan, y[part])
    return out


def _beyond_all(y: Array, u: Array, step: float, mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Mark rows far beyond what the levels of the input span; returns that span."""
    low, high = float(np.fmin.reduce(u)), float(np.fmax.reduce(u))
    width = (high - low) / _LEVELS or 1.0

    def level_of(some: Array) -> NDArray[np.int64]:
        at = np.where(np.isfinite(some), (some - low) / width, _LEVELS)
        return np.minimum(at.astype(np.int64), np.where(np.isfinite(some), _LEVELS - 1, _LEVELS))

    every = max(1, y.size // _LEARNED)
    some, at = y[::every], level_of(u[::every])
    bottoms, tops, known = [], [], np.zeros(_LEVELS + 1, dtype=np.bool_)
    for level in range(_LEVELS):
        here = some[(at == level) & np.isfinite(some)]
        if here.size:
            bottom, top = np.quantile(here, [_LOW, _HIGH])
            bottoms.append(float(bottom))
            tops.append(float(top))
            known[level] = here.size >= _KNOWN
    if not bottoms:
        return 0.0, 0.0
    bottom, top = min(bottoms), max(tops)
    room = _BEYOND * max(top - bottom, _STEPS * step)
    for part in pieces(y.size, BLOCK):
        far = part.start + np.flatnonzero((y[part] > top + room) | (y[part] < bottom - room))
        mask[far[known[level_of(u[far])]]] = True
    if mask.any():
        _leave_what_fades(y, u, mask, _LEAP * room)
    return bottom, top


def _leave_what_fades(y: Array, u: Array, far: NDArray[np.bool_], least: float) -> None:
    """Unmark runs of readings far off which they do not leap to, or not back from: a stroke that fades is true.

    So is what comes with one jump of the input and goes with another. least: size of a leap.
    """
    edges = find_edges(u)
    rows = np.flatnonzero(far)
    ends = np.diff(rows) > 1
    first, stop = rows[np.append(True, ends)], rows[np.append(ends, True)] + 1
    for a, b in zip(first.tolist(), stop.tolist(), strict=True):
        before, behind = slice(max(0, a - _SIDE), a), slice(b, b + _SIDE)
        comes = _apart(y[a : min(b, a + _SIDE)], y[before][~far[before]])
        goes = _apart(y[max(a, b - _SIDE) : b], y[behind][~far[behind]])
        turned = [edges[np.searchsorted(edges, row - _AT_ONCE) : np.searchsorted(edges, row, side="right")]
                  for row in (a, b)]
        answers = all(e.size for e in turned) and turned[0][0] != turned[1][-1]
        if min(comes, goes) < least or answers:
            far[a:b] = False


def _apart(some: Array, others: Array) -> float:
    """Distance of the medians of a few readings; infinite where one has none."""
    some, others = some[np.isfinite(some)], others[np.isfinite(others)]
    return abs(float(np.median(some) - np.median(others))) if some.size and others.size else np.inf


def _held(y: Array, u: Array, least: float, known: NDArray[np.bool_], most: float) -> list[tuple[int, int]]:
    """Runs (first row, row behind the last) of one value that readings leap to and back from.

    least: size of a leap; known (n,): readings that are false already, which are no end of a range; most: share of the
    readings that a run may be.
    """
    every = max(1, y.size // _LEARNED)
    # a wave changes from row to row, and hardly its slope
    bends = np.abs(y[2:][::every] - 2.0 * y[1:-1][::every] + y[:-2][::every])
    bends = bends[np.isfinite(bends)]
    if bends.size < 4 * _BESIDE:
        return []
    sd = 1.4826 * float(np.median(bends)) / np.sqrt(3.0)
    leaps = rows_where(lambda b, a: np.abs(b - a) > max(least, _SDS_LONG * sd), y[1:], y[:-1])
    if leaps.size < 2:
        return []
    first, stop = leaps[:-1] + 1, leaps[1:] + 1
    into, out_of = y[leaps[:-1] + 1] - y[leaps[:-1]], y[leaps[1:] + 1] - y[leaps[1:]]
    large = np.minimum(np.abs(into), np.abs(out_of)) > max(least, _SDS * sd)
    long = stop - first >= _longer_than_chance(y)
    likely = (into * out_of < 0.0) & (y[first] == y[stop - 1]) & (large | long)
    likely &= (stop - first >= 2) & (stop - first <= most * y.size)
    if not likely.any():
        return []
    ends = np.inf, -np.inf
    for part in pieces(y.size, BLOCK):
        seen = y[part][~known[part]]
        ends = float(np.fmin.reduce(seen, initial=ends[0])), float(np.fmax.reduce(seen, initial=ends[1]))
    edges = find_edges(u)
    values, count = np.unique(y[first[likely]], return_counts=True)
    often = dict(zip(values.tolist(), count.tolist(), strict=True))
    out = []
    for a, b in zip(first[likely].tolist(), stop[likely].tolist(), strict=True):
        if known[a] or not bool(np.all(y[a:b] == y[a])):
            continue
        usual = max(_largest_change(y[max(0, a - _NEAR) : a][::-1]), _largest_change(y[b : b + _NEAR]))
        if min(abs(y[a] - y[a - 1]), abs(y[b] - y[b - 1])) <= _CHANGES * usual:
            continue
        # an answer to the input comes with it, or a little later, and does so again
        seldom = often[float(y[a])] * _EDGES_A_RUN <= edges.size
        quiet = _QUIET_AT_END if y[a] in ends and not seldom else _QUIET
        near = [np.searchsorted(edges, [row - quiet, row + _QUIET]) for row in (a, b)]
        if all(low == high for low, high in near):
            out.append((a, b))
    return out


def _longer_than_chance(y: Array) -> float:
    """Rows of one value that as many equal neighbours as there are do not make by chance."""
    equal = (1 + rows_where(lambda b, a: b == a, y[1:], y[:-1]).size) / (1 + y.size)
    return float(1.0 + np.log(_CHANCE) / np.log(equal)) if equal < 1.0 else np.inf


def _largest_change(x: Array) -> float:
    """Of the first few from row to row; 0 without any. A sensor slower than the rows changes only now and then."""
    changes = np.abs(np.diff(x))
    return float(np.fmax.reduce(changes[changes > 0.0][:_BESIDE], initial=0.0))

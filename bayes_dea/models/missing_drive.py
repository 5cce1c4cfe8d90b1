"""What drove an actuator where its column has no number: the likeliest course, and the rows that must not count.

A measured position, and a command that is straight between rows, are straight across a gap too: it is two rows further
apart. A held command stood still where it was the same on both sides; where it was on its way at the same pace before
and after, it went straight. Else it changed at an unknown moment: it is held to the end of the gap, as a command is
until another is recorded, and no row counts until what such a moment may have left behind is gone (as in `live.sums`).
Where a logger left out the whole row, as an even clock tells (`clock`), that is a gap without rows.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from ..campaign.scratch import all_finite, computed, kept, rows_where
from .clock import Clock, clock_of

#: a course bends by less than this share of its range over a gap and as long before and after: it went straight
_STRAIGHT = 0.02
#: an unknown change within a gap up to this long (s) is over too soon to be seen after it, but for one that bends by
#: more than this share of the range: what an edge sets off, ringing or charging, is given so long (s)
_SHORT_S, _EDGE, _RINGS_S = 0.02, 0.2, 0.1
#: what is left of an unknown stretch after this many times its length is below a part in thirty of its creep
_FORGET = 10.0
#: what is forgotten within this share of a recording, or as soon as an edge, is brief; all that is brief takes this
#: share of a recording at most
_BRIEF, _MOST = 0.1, 0.5


@dataclass(frozen=True)
class Driven:
    """What drove a recording. values (n,): its column without gaps, V or m. unknown (n,): rows whose answer depends on
    what nobody recorded; None where there are none. leapt (k,): rows behind rows that are missing, in which it neither
    stood still nor went straight. clock: of the recording, None where it has none."""

    values: NDArray[np.float64]
    unknown: NDArray[np.bool_] | None = None
    leapt: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    clock: Clock | None = None


@dataclass(frozen=True)
class _Gaps:
    """Rows first ... stop - 1 (k,) without a number, none where rows are missing. still, lost (k,): the command stood
    still; the course is not known. until_s (k,): when what a lost course left behind is gone."""

    first: NDArray[np.int64]
    stop: NDArray[np.int64]
    still: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    until_s: NDArray[np.float64]


def driven(recording: Recording) -> Driven:
    """What drove a voltage or a mechanical recording, gaps filled; its column itself where it has none."""
    is_voltage = not recording.is_mechanical
    x, time = recording.columns["voltage_V" if is_voltage else "position_m"], recording.time_s
    clock = clock_of(time)
    holes = np.empty(0, dtype=np.int64) if clock is None else clock.after
    if all_finite(x) and not holes.size:
        return Driven(x, clock=clock)
    known = computed(np.isfinite, x, dtype=np.bool_)
    # beside an empty cell they are part of its gap
    holes = holes[known[holes - 1] & known[holes]]
    t_known, x_known = kept(time, known), kept(x, known)
    values = computed(lambda t, v: np.where(np.isfinite(v), v, np.interp(t, t_known, x_known)), time, x)
    unknown = computed(np.isnan, x, dtype=np.bool_)
    held = is_voltage and recording.hold != "linear"
    gaps = _gaps(time, known, holes, t_known, x_known, is_voltage)
    for a, b in zip(gaps.first[gaps.still], gaps.stop[gaps.still], strict=True):
        unknown[a:b] = False
    # what an unknown course left behind goes on where a later command is known
    for a, b, until in zip(gaps.first[gaps.lost], gaps.stop[gaps.lost], gaps.until_s[gaps.lost], strict=True):
        if held and a > 0:
            values[a:b] = x[a - 1]
        unknown[b : np.searchsorted(time, until)] = True
    if held and recording.hold == "start":
        # a row's command acts after it: the reading of a gap's first row answers what is known, that after its last not
        unknown[1:] = unknown[:-1].copy()
        unknown[0] = False
        # but for one behind rows that are missing
        after = np.empty(0, dtype=np.int64) if clock is None else clock.after
        unknown[gaps.first[~gaps.still & np.isin(gaps.first, after)]] = True
    return Driven(values, unknown, gaps.first[(gaps.first == gaps.stop) & gaps.lost], clock)


def drive_values(recording: Recording) -> NDArray[np.float64]:
    """The column (n,) that drives a recording, V or m, gaps filled."""
    return driven(recording).values


def _gaps(
    time: NDArray, known: NDArray[np.bool_], holes: NDArray[np.int64], t: NDArray, x: NDArray, is_voltage: bool
) -> _Gaps:
    """Gaps among rows at `time` (n,) of which some are known, at t (m,) with x, and those before the rows `holes`."""
    n = known.size
    edges = rows_where(np.not_equal, known[1:], known[:-1]) + 1
    edges = np.concatenate([[] if known[0] else [0], edges, [] if known[-1] else [n]]).astype(np.int64)
    first, stop = np.concatenate([edges[::2], holes]), np.concatenate([edges[1::2], holes])
    begin, end = time[np.maximum(first - 1, 0)], time[np.minimum(stop, n - 1)]
    length = end - begin
    # the readings beside a gap, and those beside them
    right = np.minimum(np.searchsorted(t, begin, "right"), t.size - 1)
    left = np.where(first > 0, np.maximum(right - 1, 0), right)
    rise = x[right] - x[left]
    # how far the line across the gap is off as long before it and after it, as far as was recorded
    earlier, later = np.maximum(begin - length, t[0]), np.minimum(end + length, t[-1])
    pace = rise / length
    bend = np.maximum(
        np.abs(np.interp(earlier, t, x) - (x[left] - pace * (begin - earlier))),
        np.abs(np.interp(later, t, x) - (x[right] + pace * (later - end))),
    )
    inside = (first > 0) & (stop < n)
    if is_voltage:
        stood = (x[left] == x[np.maximum(left - 1, 0)]) | (x[right] == x[np.minimum(right + 1, x.size - 1)])
        still = inside & (rise == 0.0) & stood
        # before its first reading a command at nothing was at nothing
        still |= (first == 0) & (x[0] == 0.0)
    else:
        still = np.zeros(first.size, dtype=np.bool_)
    reach = float(np.max(x) - np.min(x))
    straight = bend <= _STRAIGHT * reach
    lost = inside & ~still & ~straight
    if is_voltage:
        lost |= (first == 0) & ~still & (stop < n)
    after = np.where(length > _SHORT_S, _FORGET * length, np.where(bend > _EDGE * reach, _RINGS_S, 0.0))
    # a row here and there of a command that moves at every one would take all of a recording
    duration = float(time[-1] - time[0])
    brief = lost & (after <= max(_RINGS_S, _BRIEF * duration))
    after[brief] *= min(1.0, _MOST * duration / max(float(after[brief].sum()), 1e-300))
    return _Gaps(first, stop, still, lost, end + after)

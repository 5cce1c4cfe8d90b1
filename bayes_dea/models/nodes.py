"""The rows of a recording at which the chain of stages is worked out.

Between two changes of a held command everything is smooth and slows down like the logarithm of time. It is enough to
know it at a row a few per cent further on, because the stages are integrated with exponentials that are exact for a
held input, whatever the length of the step. Slow sines and triangles may be taken as lines of many rows (`slow_lines`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from ..latest import Latest
from .course import Course, course_of
from .electrostatics import filled_input
from .slow_lines import AHEAD, FINE, ROUGH, LineSettings, corners, slow_lines, turns
from .steps import Steps

#: lengths of coarse steps in rows grow by this factor, so that neighbouring steps share their coefficients
_STEP_GRID = 1.2
#: first step of a rest between recordings (s), and the factor by which the following ones end later
_REST_FIRST_S, _REST_GROWTH = 1e-4, 1.1


@dataclass(frozen=True)
class Nodes:
    """A subset of a recording's rows, the first and the last among them.

    time_s (m,) s; volts (m,) V, what was commanded during the interval that ends at the row (for hold = "linear" the
    command at the row); row (m,) index of the row; n: rows of the recording; hold: convention of the recording;
    temperature_C (m,) or None; step_s: the common time step of the rows, 0 where they are uneven. lines_V (2, m) V:
    start and end of the command in the interval that ends at each node, where `volts` and `hold` do not say it.
    unread: nodes at which the output is to be read off straight between their neighbours. corners (k,): nodes at which
    the command jumps, kinks or turns, of nodes that leave out rows in which it moves: between them the output is to be
    read off as smooth. is_rough: whether they are few (`rough_nodes`). zero_m: of the sensor in this recording, where
    the end of its range is a reading and not a displacement. tick (m,): of the recording's clock at each node
    (`course`); None where no row is missing, and ticks are rows.
    """

    time_s: NDArray[np.float64]
    volts: NDArray[np.float64]
    row: NDArray[np.int64]
    n: int
    hold: str = "end"
    temperature_C: NDArray[np.float64] | None = None
    step_s: float = 0.0
    lines_V: NDArray[np.float64] | None = field(default=None, repr=False)
    unread: NDArray[np.int64] | None = field(default=None, repr=False)
    corners: NDArray[np.int64] | None = field(default=None, repr=False)
    is_rough: bool = False
    zero_m: float = 0.0
    tick: NDArray[np.int64] | None = field(default=None, repr=False)

    @property
    def size(self) -> int:
        """Number of nodes."""
        return int(self.row.size)

    @cached_property
    def answers(self) -> Latest[NDArray[np.float64]]:
        """The last displacements of plants at them, by the plant before its sensor and what came before: that of a fit,
        and that of the change of one parameter beside it. What a sensor makes of a displacement changes none of it."""
        return Latest()

    def durations(self) -> NDArray[np.float64]:
        """Time from the node before to each node (m,) s, zero for the first one; not to be written to."""
        return self._durations

    def command(self) -> NDArray[np.float64]:
        """Start and end (2, m) V of the command, straight in the interval that ends at each node."""
        return self._command

    @cached_property
    def _command(self) -> NDArray[np.float64]:
        if self.lines_V is not None:
            return self.lines_V
        if self.hold == "linear":
            return np.stack([np.concatenate([self.volts[:1], self.volts[:-1]]), self.volts])
        return np.stack([self.volts, self.volts])

    def rows(self) -> NDArray[np.int64]:
        """Rows (m,) of the recording that the interval before each node spans, missing ones too, 1 for the first."""
        return self._rows

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        return np.maximum(self.rows_apart, 1)

    @cached_property
    def rows_apart(self) -> NDArray[np.int64]:
        """The same, 0 for the first."""
        return np.diff(self.place, prepend=self.place[:1])

    @property
    def place(self) -> NDArray[np.int64]:
        """Tick (m,) at each node: its row, where none is missing."""
        return self.row if self.tick is None else self.tick

    @property
    def inputs(self) -> tuple[object, ...]:
        """All that predictions at them depend on, their places apart."""
        return self.time_s, self.command(), self.temperature_C, self.hold, self.zero_m

    @cached_property
    def steps(self) -> Steps:
        """What drives the chain, by the command."""
        u0, u1 = self._command
        return Steps(self._durations, u0, u1, self._rows)

    def steps_after(self, past: Nodes) -> Steps:
        """The same after a past, whose nodes come first."""
        h = self._durations
        h = np.concatenate([past.durations(), [1e-6 * float(np.median(h[1:]))], h[1:]])
        u0, u1 = np.concatenate([past.command(), self._command], axis=1)
        return Steps(h, u0, u1, np.concatenate([past.rows(), self._rows]))

    def read(self, y: NDArray[np.float64]) -> NDArray[np.float64]:
        """y (m,) with the nodes that are not read straight between those that are."""
        if self.unread is None or self.unread.size == 0:
            return y
        left, right, share = self._beside
        out = y.copy()
        out[self.unread] = (1.0 - share) * y[left] + share * y[right]
        return out

    @cached_property
    def _beside(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        assert self.unread is not None
        known = np.delete(np.arange(self.size), self.unread)
        after = np.searchsorted(known, self.unread)
        left, right = known[after - 1], known[after]
        t = self.time_s
        return left, right, (t[self.unread] - t[left]) / (t[right] - t[left])

    @cached_property
    def _durations(self) -> NDArray[np.float64]:
        if self.step_s > 0:
            # whole rows, so that equal steps are equal to the last digit
            return self.step_s * self.rows_apart.astype(float)
        return np.diff(self.time_s, prepend=self.time_s[:1])


@dataclass(frozen=True)
class Spacing:
    """How close nodes are: all rows for fine_s (s) after a change of the command and for early_s (s) before it, which
    readings that lead their command are read off between; then `growth` x (time since the change), cap_s (s) at most.
    lines: of slow changes that are taken as lines."""

    fine_s: float = 0.3
    early_s: float = 0.02
    growth: float = 0.025
    cap_s: float = 1.0
    lines: LineSettings = FINE


_FEW = Spacing(fine_s=0.01, early_s=0.0, growth=0.2, cap_s=5.0, lines=ROUGH)


def make_nodes(
    recording: Recording,
    *,
    every_row: bool = False,
    lines: bool = False,
    extra_rows: NDArray[np.int64] | tuple[int, ...] = (),
) -> Nodes:
    """Nodes of a recording with a `voltage_V` column.

    Every row where the command changes, the row before it, and those that `Spacing` has of the rest. All rows of a step
    have the command of the node at its end. lines: slow changes at every row are taken as lines of many rows
    (`slow_lines`). extra_rows: further rows to include, without `lines`.
    """
    return _spaced(recording, course_of(recording), Spacing(), every_row, lines, extra_rows)


def _spaced(
    recording: Recording,
    course: Course,
    spacing: Spacing,
    every_row: bool,
    lines: bool,
    extra_rows: NDArray[np.int64] | tuple[int, ...] = (),
) -> Nodes:
    time_s = np.asarray(recording.time_s, float)
    n = time_s.size
    volts, step = course.at_rows(), course.step_s
    if every_row:
        keep = np.ones(n, dtype=bool)
    else:
        keep = _coarse(time_s, volts, step, spacing)
        keep[np.asarray(extra_rows, dtype=np.int64)] = True
    row = np.flatnonzero(keep)
    linear = recording.hold == "linear"
    slow = None
    # what trembles is no line of even rows, but for what a change of the parameters changes
    pace = course.pace_s if spacing.lines is ROUGH else step
    if lines and pace > 0:
        slow = slow_lines(course.tick[row], course.volts, course.bend, course.known, pace, linear, spacing.lines)
    if slow is not None:
        row = np.searchsorted(course.tick, slow.row)
    temperature = recording.columns.get("temperature_C")
    if temperature is not None:
        temperature = filled_input(np.asarray(temperature, float))[row]
    tick = course.tick[row] if course.has_holes else None
    out = Nodes(time_s[row], np.ascontiguousarray(volts[row]), row, n, recording.hold, temperature, step, tick=tick)
    if slow is None:
        return out if tick is None or linear else replace(out, lines_V=_across(course.volts, tick))
    # friction and softening may kink where a command turns, and readings that lead it show its corners rows before
    ahead = np.append(corners(course.volts, course.bend), course.volts.size - 1)[:, None] - np.arange(AHEAD + 1)
    bends = course.beside(np.union1d(np.clip(ahead, 0, course.volts.size - 1), turns(course.volts)))
    read = np.delete(slow.row, slow.unread)
    bends = np.searchsorted(slow.row, bends[np.isin(bends, read)])
    return replace(out, lines_V=np.stack([slow.start, slow.end]), unread=slow.unread, corners=bends)


def rough_nodes(recording: Recording) -> Nodes:
    """Few nodes: enough for what a change of the parameters changes, not for what the recording is compared with.

    The output is smooth between its corners, and is to be read off as that.
    """
    course = course_of(recording)
    nodes = _spaced(recording, course, _FEW, every_row=False, lines=True)
    bends = np.searchsorted(nodes.place, course.beside(corners(course.volts, course.bend)))
    return replace(nodes, corners=bends, is_rough=True)


def _across(volts: NDArray, tick: NDArray[np.int64]) -> NDArray[np.float64]:
    """Start and end (2, m) V of the command (N,) at all ticks in the interval that ends at each of these (m,)."""
    return np.stack([volts[np.concatenate([tick[:1], tick[:-1] + 1])], volts[tick]])


def _coarse(time_s: NDArray, volts: NDArray, step: float, spacing: Spacing) -> NDArray[np.bool_]:
    n = time_s.size
    changed = np.empty(n, dtype=bool)
    changed[0] = True
    np.not_equal(volts[1:], volts[:-1], out=changed[1:])
    start = np.flatnonzero(changed)
    which = np.cumsum(changed) - 1
    # the row of a change ends an interval with the new command, which began at the row before
    edge = time_s[np.maximum(start - 1, 0)]
    keep = time_s - edge[which] <= spacing.fine_s
    keep[start] = True
    keep[np.maximum(start - 1, 0)] = True
    keep[[0, n - 1]] = True
    end = np.append(start[1:], n)
    before = end[which] - 1  # the row before the next change, or the last
    keep |= (time_s[before] - time_s <= spacing.early_s) & (spacing.early_s > 0.0)
    # one, where rows are further apart than that
    keep[np.maximum(start - 2, 0)] |= spacing.early_s > 0.0
    for k in np.flatnonzero(time_s[end - 1] - edge > spacing.fine_s):
        last = int(end[k]) - 1
        i = int(np.searchsorted(time_s, edge[k] + spacing.fine_s, "right")) - 1
        while i < last:
            keep[i] = True
            wanted = min(spacing.growth * (time_s[i] - edge[k]), spacing.cap_s)
            if step > 0:
                stride = int(_STEP_GRID ** np.floor(np.log(max(wanted / step, 1.0) + 1e-9) / np.log(_STEP_GRID)))
                i += max(1, stride)
            else:  # rows may come at any pace
                i = max(i + 1, int(np.searchsorted(time_s, time_s[i] + wanted, "right")) - 1)
    return keep


def past_nodes(earlier: Sequence[Recording], last: Recording, *, lines: bool = False) -> Nodes | None:
    """Nodes of the recordings before `last` (oldest first) with the rests between them, up to its first row.

    None where there are none. A rest follows a change to 0 V with rows that get wider like those of `make_nodes`, which
    `lines` is for.
    """
    time, command, rows = [np.zeros(0)], [np.zeros((2, 0))], [np.zeros(0, dtype=np.int64)]
    now = 0.0
    for before, after in pairwise([*earlier, last]):
        nodes = make_nodes(before, lines=lines)
        h = nodes.durations()
        h[0] = 1e-6 * float(np.median(h[1:])) if now > 0.0 else 0.0
        time.append(now + np.cumsum(h))
        command.append(nodes.command())
        rows.append(nodes.rows())
        now = float(time[-1][-1])
        rest = after.rest_before_s or 0.0
        if rest > 0.0:
            t = np.append(_REST_FIRST_S * _REST_GROWTH ** np.arange(200), np.inf)
            t = np.append(t[t < rest], rest)
            time.append(now + t)
            command.append(np.zeros((2, t.size)))
            rows.append(np.ones(t.size, dtype=np.int64))
            now += rest
    if not earlier:
        return None
    time_s, lines_V = np.concatenate(time), np.concatenate(command, axis=1)
    # the places of the rows count those that lie within a line
    row = np.cumsum(np.concatenate(rows)) - 1
    return Nodes(time_s, lines_V[1], row, int(row[-1]) + 1, last.hold, lines_V=lines_V)

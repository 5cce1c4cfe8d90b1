"""The command that acts until each tick of a recording's clock, that of rows which its logger left out among them.

What passed a row that is missing is found as that of an empty cell is (`missing_drive`): where the command stood still
or went straight it did so there, too; else the one of the next row acts all the while, as the convention has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Recording
from .clock import Clock
from .missing_drive import driven
from .slow_lines import bend

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """volts (N,) V: the command that acts until each tick, with hold = "linear" the one at the tick; where no row is
    missing, ticks are rows. clock: None where there is none. stamps (N,): when each command was taken, in ticks, where
    stamps tremble about those."""

    volts: Array
    clock: Clock | None
    stamps: Array | None = None

    @property
    def has_holes(self) -> bool:
        """Whether rows are missing."""
        return self.clock is not None and self.clock.after.size > 0

    @property
    def step_s(self) -> float:
        """The common step of the rows; 0 where they are uneven."""
        return 0.0 if self.clock is None or not self.clock.is_even else self.clock.step_s

    @property
    def pace_s(self) -> float:
        """About how far ticks are apart; 0 where there is no telling."""
        return 0.0 if self.clock is None else self.clock.step_s

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Which ticks (N,) have a row."""
        out = np.ones(self.volts.size, dtype=np.bool_)
        if self.has_holes:
            out[:] = False
            out[self.tick] = True
        return out

    @cached_property
    def tick(self) -> NDArray[np.int64]:
        """Tick (n,) of every row."""
        n = self.volts.size if self.clock is None else self.clock.n
        rows = np.arange(n)
        return self.clock.ticks(rows) if self.clock is not None and self.has_holes else rows

    @cached_property
    def bend(self) -> Array:
        """Change (N,) V of the command's change at each tick.

        Where stamps tremble a smooth command was taken either on the ticks, and the stamps are what is late, or when
        the stamps say. That in which it bends less is taken.
        """
        on_ticks = bend(self.volts)
        if self.stamps is None:
            return on_ticks
        by_stamps = bend(self.volts, self.stamps)
        moves = on_ticks > 0.0
        less = moves.any() and np.median(by_stamps[moves]) < np.median(on_ticks[moves])
        return by_stamps if less else on_ticks

    def at_rows(self) -> Array:
        """The command (n,) that acts until each row."""
        return self.volts[self.tick] if self.has_holes else self.volts

    def beside(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Ticks (k,) with those that have no row replaced by the ones with a row before and behind."""
        lost = ~self.known[ticks]
        if not lost.any():
            return ticks
        behind = np.searchsorted(self.tick, ticks[lost])
        return np.union1d(ticks[~lost], self.tick[np.concatenate([behind - 1, behind])])


def course_of(recording: Recording) -> Course:
    """The course of a recording with a `voltage_V` column."""
    found = driven(recording)
    clock = found.clock
    volts = np.asarray(found.values, float)
    if clock is not None and clock.after.size > 0:
        tick = clock.ticks(np.arange(clock.n))
        rows, volts = volts, np.interp(np.arange(clock.size), tick, volts)
        if recording.hold != "linear":
            for row in found.leapt:
                # known from the row before on, or until the row behind
                volts[tick[row - 1] + 1 : tick[row]] = rows[row - (recording.hold == "start")]
    if recording.hold == "start":
        # what acts until a row is the command of the row before; before the first one nothing did
        volts = np.concatenate([[0.0], volts[:-1]])
    stamps = None
    if clock is not None and not clock.is_even:
        stamps = np.interp(np.arange(clock.size), clock.ticks(np.arange(clock.n)), recording.time_s) / clock.step_s
        if recording.hold == "start":
            stamps = np.concatenate([[2.0 * stamps[0] - stamps[1]], stamps[:-1]])
    return Course(volts, clock, stamps)

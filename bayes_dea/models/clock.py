"""The clock of a recording, ticks of rows that its logger left out among them.

A row that is not there leaves the clock as it was: between two rows then lie two ticks. What is even but for that is as
cheap to follow as what is even, step for step of one length. Where stamps tremble about the ticks, as those of a
program that asks a device in a loop, it tells how many rows are missing all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..campaign.order import differences, median
from ..campaign.scratch import BLOCK, pieces
from .lags import even_step

#: share of all ticks that may have no row; what lacks more was read at another pace
_MISSING = 0.05
#: part of a step by which a stamp may be off its tick for the clock to be even, and by which two rows that follow each
#: other may be nearer or farther than that
_OFF, _TREMBLES = 2e-3, 0.3
#: the same for a stamp where steps tremble by more than that, so that a row that is missing could not be told
_ABOUT = 0.75


@dataclass(frozen=True)
class Clock:
    """Ticks step_s (s) apart, the first at the first of n rows. after, missing (k,): rows behind a hole, and the ticks
    without a row before each. is_even: whether stamps are those of the ticks."""

    step_s: float
    n: int
    after: NDArray[np.int64]
    missing: NDArray[np.int64]
    is_even: bool = True

    @property
    def size(self) -> int:
        """Number of ticks from the first row to the last."""
        return self.n + int(self.missing.sum())

    def ticks(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Ticks (m,) of rows (m,)."""
        return np.asarray(rows + self._before[np.searchsorted(self.after, rows, side="right")])

    @cached_property
    def _before(self) -> NDArray[np.int64]:
        return np.concatenate([[0], np.cumsum(self.missing)])


def clock_of(time_s: NDArray[np.float64]) -> Clock | None:
    """The clock of rows at times (n,), rising; None where they come at any pace."""
    n, none = time_s.size, np.empty(0, dtype=np.int64)
    step = even_step(time_s)
    if step > 0:
        return Clock(step, n, none, none)
    if n < 3:
        return None
    common = _step_between(time_s)
    if not common > 0:
        return None
    after, missing, row = [none], [none], 1
    for d in differences(time_s)():
        ticks = np.rint(d / common)
        if not np.max(np.abs(d / common - ticks)) <= _TREMBLES or not ticks.min() > 0:
            return _about_its_ticks(time_s)
        at = np.flatnonzero(ticks != 1)
        after.append(row + at)
        missing.append(ticks[at].astype(np.int64) - 1)
        row += d.size
    holes, lacking = np.concatenate(after), np.concatenate(missing)
    if not lacking.sum() <= _MISSING * n:
        return None
    out = Clock((time_s[-1] - time_s[0]) / (n - 1 + int(lacking.sum())), n, holes, lacking)
    return out if _on_its_ticks(time_s, out) else replace(out, is_even=False)


def _about_its_ticks(time_s: NDArray[np.float64]) -> Clock | None:
    """The clock of rows whose stamps tremble so much that they tell of no missing one; None where they stray."""
    n, none = time_s.size, np.empty(0, dtype=np.int64)
    out = Clock(float(time_s[-1] - time_s[0]) / (n - 1), n, none, none, is_even=False)
    return out if _on_its_ticks(time_s, out, _ABOUT) else None


def _step_between(time_s: NDArray[np.float64]) -> float:
    """The mean step (s) of rows that follow each other; nan where there is none.

    Of stamps that are rounded to a part of a step (60 Hz in whole ms) the median is out by a tick in some tens of them.
    """
    usual = median(differences(time_s))
    total, count = 0.0, 0
    for d in differences(time_s)():
        near = d[np.abs(d - usual) <= _TREMBLES * usual]
        total, count = total + float(near.sum()), count + near.size
    return total / count if count else float("nan")


def _on_its_ticks(time_s: NDArray[np.float64], clock: Clock, off: float = _OFF) -> bool:
    """Whether every stamp (n,) is that of its tick, but for this part of a step."""
    for part in pieces(clock.n, BLOCK):
        ideal = time_s[0] + clock.step_s * clock.ticks(np.arange(part.start, part.stop))
        if not np.max(np.abs(time_s[part] - ideal)) <= off * clock.step_s:
            return False
    return True

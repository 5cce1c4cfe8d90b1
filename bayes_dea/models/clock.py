"""The even clock of a recording, ticks of rows that its logger left out among them.

A row that is not there leaves the clock as it was: between two rows then lie two ticks. What is even but for that is as
cheap to follow as what is even, step for step of one length.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..campaign.order import differences, median
from ..campaign.scratch import BLOCK, pieces
from .lags import even_step

#: share of all ticks that may have no row; what lacks more was read at another pace
_MISSING = 0.05
#: part of a step by which a stamp may be off its tick
_OFF = 2e-3


@dataclass(frozen=True)
class Clock:
    """Ticks step_s (s) apart, the first at the first of n rows. after, missing (k,): rows behind a hole, and the ticks
    without a row before each."""

    step_s: float
    n: int
    after: NDArray[np.int64]
    missing: NDArray[np.int64]

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
    """The clock of rows at times (n,), rising; None where they are uneven."""
    n, none = time_s.size, np.empty(0, dtype=np.int64)
    step = even_step(time_s)
    if step > 0:
        return Clock(step, n, none, none)
    if n < 3:
        return None
    common = median(differences(time_s))
    if not common > 0:
        return None
    after, missing, row = [none], [none], 1
    for d in differences(time_s)():
        ticks = np.rint(d / common).astype(np.int64)
        at = np.flatnonzero(ticks != 1)
        after.append(row + at)
        missing.append(ticks[at] - 1)
        row += d.size
    holes, lacking = np.concatenate(after), np.concatenate(missing)
    if np.any(lacking < 0) or not lacking.sum() <= _MISSING * n:
        return None
    out = Clock((time_s[-1] - time_s[0]) / (n - 1 + int(lacking.sum())), n, holes, lacking)
    for part in pieces(n, BLOCK):
        ideal = time_s[0] + out.step_s * out.ticks(np.arange(part.start, part.stop))
        if not np.max(np.abs(time_s[part] - ideal)) <= _OFF * out.step_s:
            return None
    return out

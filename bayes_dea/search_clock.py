"""How long a search for the maximum will still take: what has been timed so far, times what is still to come."""

from __future__ import annotations

import time
from collections.abc import Callable

#: called with (seconds gone, seconds expected in all, text); 0 of 1 while nothing can be said
Report = Callable[[float, float, str], None]


class SearchClock:
    """Times the two halves of a round, swarms and polishes from their ends, and reports what is left of the round.

    Swarms may end before the iterations that they are allowed, so of them the estimate is what it takes at most. How
    long a polish takes is known after the first one. A further round, which few searches need, is told when it begins.
    """

    def __init__(self, report: Report | None, now: Callable[[], float] = time.monotonic) -> None:
        self._report, self._now = report, now
        self._began = self._part = now()
        self._polish_s: float | None = None  # of one start, as far as is known
        self._again = ""

    def _say(self, left: float | None, text: str) -> None:
        if self._report is None:
            return
        gone = self._now() - self._began
        if left is None or gone <= 0.0:
            self._report(0.0, 1.0, text + self._again)
        else:
            self._report(gone, gone + left, text + self._again)

    def round(self, number: int) -> None:
        """Round `number` (from 1) begins with its swarms."""
        self._part = self._now()
        self._again = f", round {number}: the noise was another" if number > 1 else ""

    def swarms(self, iteration: int, most: int, starts: int) -> None:
        """`iteration` of at most so many is done; `starts` will be polished then."""
        left = (self._now() - self._part) * max(most - iteration, 0) / iteration
        if self._polish_s is not None:
            left += starts * self._polish_s
        self._say(left, f"swarms, iteration {iteration} of at most {most}")

    def polishing(self) -> None:
        """The swarms have ended, the polishes begin."""
        self._part = self._now()

    def polished(self, done: int, of: int) -> None:
        """So many of the starts that need a polish have had theirs."""
        if done > 0:
            self._polish_s = (self._now() - self._part) / done
        self._say(None if self._polish_s is None else self._polish_s * (of - done), f"start {done} of {of}")

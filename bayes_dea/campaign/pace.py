"""Samplers that change their pace: fast behind an edge, slow in between.

Noise that a filter leaves is correlated over time and not from row to row: rows that come at a slower pace tell nearly
independently, and what looks at neighbouring rows has to know.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .order import differences, median

Array = NDArray[np.float64]
#: a step of so many of the common ones is long, and how many of these in a row are a slower pace and no gaps
_LONG, _SLOWER = 1.8, 10
#: a step of this share of the common one is short, and how many in a row are the pace that counts
_SHORT, _FASTER = 0.55, 64


@dataclass(frozen=True)
class Pace:
    """The finest step (s) that a recording keeps up, and stretches of rows (start, stop) read at longer ones."""

    step_s: float
    slow: tuple[tuple[int, int], ...]

    def is_slow(self, n: int) -> NDArray[np.bool_]:
        """Which of n rows were read at a slower pace: those at either end of a long step."""
        out = np.zeros(n, dtype=np.bool_)
        for start, stop in self.slow:
            out[start:stop] = True
        return out

    def longest_fast(self, n: int) -> slice:
        """The longest stretch of n rows that is not slow."""
        starts, stops = [0, *(b - 1 for _, b in self.slow)], [*(a + 1 for a, _ in self.slow), n]
        return max((slice(a, b) for a, b in zip(starts, stops, strict=True)), key=lambda rows: rows.stop - rows.start)


def pace_of(time_s: Array) -> Pace:
    """The pace of rows at times (n,), all finite and rising. A gap is one long step and no slower pace."""
    if time_s.size < 2:
        return Pace(0.0, ())
    step = median(differences(time_s))
    short = _runs(time_s, 0.0, _SHORT * step, _FASTER)
    if short:
        step = float(np.median(np.concatenate([np.diff(time_s[a:b]) for a, b in short])))
    return Pace(step, tuple(_runs(time_s, _LONG * step, np.inf, _SLOWER)))


def _runs(time_s: Array, low: float, high: float, least: int) -> list[tuple[int, int]]:
    """Stretches of rows (start, stop) joined by `least` steps and more in a row that lie between low and high."""
    found, before = [], 0
    for d in differences(time_s)():
        found.append(before + np.flatnonzero((d > low) & (d < high)))
        before += d.size
    at = np.concatenate([np.empty(0, dtype=np.int64), *found])
    if not at.size:
        return []
    runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
    return [(int(run[0]), int(run[-1]) + 2) for run in runs if run.size >= least]

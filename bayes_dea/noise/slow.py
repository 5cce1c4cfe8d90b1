"""What a model misses slowly: nothing beside the noise of a reading, and much beside that of a mean of many."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: readings of a block whose mean counts as slow, and how many such blocks say something
_MANY, _LEAST = 30, 10
#: chance in a recording that noise alone passes, and by how much the noise of a recording may differ from that of all
_FALSE_ALARM, _UNLIKE = 1e-5, 1.3


@dataclass(frozen=True)
class Slow:
    """rms: of the means of blocks of many readings about what is expected, beyond their noise, in the unit of the
    output; chi2: their reduced chi^2; n: how many there are."""

    rms: float
    chi2: float
    n: int

    @property
    def shows(self) -> bool:
        """Whether it is more than noise does."""
        from scipy.stats import chi2

        return self.chi2 > _UNLIKE * float(chi2.isf(_FALSE_ALARM, self.n)) / self.n


def slow_misfit(missed: Array, variance: Array, count: NDArray[np.int64]) -> Slow | None:
    """Of block means: what they miss by (nb,), the variance that they have of noise and parameters, and readings each.

    None where too few blocks hold many readings.
    """
    slow = (count >= _MANY) & np.isfinite(missed) & (variance > 0.0)
    n = int(np.count_nonzero(slow))
    if n < _LEAST:
        return None
    squares, expected = missed[slow] ** 2, variance[slow]
    return Slow(
        math.sqrt(max(float(np.mean(squares - expected)), 0.0)), float(np.mean(squares / expected)), n
    )

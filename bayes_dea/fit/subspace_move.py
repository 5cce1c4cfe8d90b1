"""Differential evolution in some of the coordinates at a time.

Where a density narrows or widens in one direction, a step in all of them at once is nearly always refused: the walkers
that it is made of lie elsewhere. A step in one or a few coordinates is not (crossover of Vrugt et al. 2009,
doi:10.1515/IJNSNS.2009.10.3.273). It suits coordinates that have been straightened.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from emcee.moves import RedBlueMove
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: numbers of coordinates that a step changes
_SIZES = (1, 1, 2, 4)


class SubspaceMove(RedBlueMove):  # type: ignore[misc]
    """A step along the difference of two other walkers in one, two or four coordinates drawn anew for each walker."""

    def get_proposal(self, s: Array, c: Sequence[Array], random: Any) -> tuple[Array, Array]:
        """New points of walkers s (n, d) and the log ratio of proposal densities, which is zero."""
        others = np.concatenate(c, axis=0)
        n, d = s.shape
        first = random.randint(len(others), size=n)
        second = (first + 1 + random.randint(len(others) - 1, size=n)) % len(others)
        size = np.minimum(np.asarray(_SIZES)[random.randint(len(_SIZES), size=n)], d)[:, None]
        moved = np.argsort(np.argsort(random.rand(n, d), axis=1), axis=1) < size
        step = 2.38 / np.sqrt(2.0 * size) * (others[first] - others[second])
        return s + np.where(moved, step, 0.0), np.zeros(n)

"""Predictions beside those of a fit: what changes is worked out at few nodes (`rough_nodes`), added to what is
known.

Few nodes miss a change by thousandths of it, at worst by a few hundredths (a tenth on a grid): nothing beside a fit,
where hardly anything changes, and little as far from it as a search looks around. What a sensor makes of it is worked
out at all nodes (`spread`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.problem import Problem
from ...gauss_newton.refit import Fit
from ...models.plant import Plant

Array = NDArray[np.float64]


class Nearby:
    """Predictions of a fit's model elsewhere, or of another model on its recordings."""

    def __init__(self, fit: Fit) -> None:
        """fit: whose predictions are known."""
        self.fit = fit

    @cached_property
    def _plants(self) -> list[Plant]:
        """The fit's own, by piece."""
        return self.fit.problem.plants(self.fit.q)

    @cached_property
    def _rough(self) -> list[Array]:
        """The fit's own predictions at few nodes, where there are some."""
        problem = self.fit.problem
        there = [i for i, p in enumerate(problem.pieces) if p.rough is not None]
        return problem.clean(self.fit.q, there, [p.rough or p.every for p in problem.pieces])

    def clean(
        self, problem: Problem, q: Array, only: Sequence[int] | None = None, to_look: bool = False,
        corners_stay: bool = False,
    ) -> list[Array]:
        """`Problem.clean` of another problem on the same pieces, but for what few nodes miss of the difference.

        A model that is not gentle (`Plant.is_gentle`) is worked out at all its nodes; to_look: on a grid; corners_stay:
        it has those of the fit (`Plant.corners_stay`).
        """
        found = zip(problem.pieces, problem.roughly(q, self._plants, only, to_look, corners_stay), strict=True)
        return [
            self.fit.clean[i] + (x - self._rough[i]) if x.size and reading is piece.rough else x
            for i, (piece, (reading, x)) in enumerate(found)
        ]

"""What an effect changes on the linear network alone, added to the answer of a model that has more to it.

Other effects and a curved law make it dear to simulate; a network with Hooke's law answers in modes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.problem import Problem
from ...models.bare import bare_of
from ...models.model import Model
from ...models.plant import straightened
from .frame import Frame, insert, own_index

Array = NDArray[np.float64]


class Superposed:
    """What an effect changes on the linear network alone, added to the answer of a fit that has more to it."""

    def __init__(self, frame: Frame, model: Model, added: Sequence[str]) -> None:
        """model: that of the fit with the effects `added`."""
        self.frame, self.model = frame, model
        problem = frame.fit.problem
        # half of the largest displacement (m) of each piece, about which its law is straight; 0 in a press
        self.middle_m = [
            0.5 * float(np.max(np.abs(x), initial=0.0)) if piece.channel == "displacement" else 0.0
            for piece, x in zip(problem.pieces, frame.fit.clean, strict=True)
        ]
        self.plain, self.changed = problem.with_model(bare_of(model)), problem.with_model(bare_of(model, tuple(added)))
        self.before = self._clean(self.plain, insert(frame.fit, model, self._nothing()))

    def value(self, own: Array) -> float:
        """Minus log posterior at the effect's own coordinates (k,), the base moved along; infinite if it has none."""
        q = insert(self.frame.fit, self.model, own)
        log_prior = float(self.model.log_prior(q[None, : self.model.dimension])[0])
        if not math.isfinite(log_prior):
            return math.inf
        after = self._clean(self.changed, q)
        clean = [x + y - z for x, y, z in zip(self.frame.fit.clean, after, self.before, strict=True)]
        if not all(np.isfinite(x).all() for x in clean):
            return math.inf
        return self.frame.value(clean)[0] - log_prior

    def _nothing(self) -> Array:
        return np.zeros(own_index(self.frame.fit, self.model).size)

    def _clean(self, simpler: Problem, q: Array) -> list[Array]:
        """Predictions of a simpler model, its law straight about the middle of the strains of the fit."""
        at = self._coordinates(simpler.model, q)
        plants = zip(simpler.plants(at), self.middle_m, strict=True)
        return simpler.clean(at, plants=[straightened(plant, x / plant.stroke_m if x else 0.0) for plant, x in plants])

    def _coordinates(self, simpler: Model, q: Array) -> Array:
        """Those of a model that has some of the parameters of `model`."""
        names = self.model.priors.names
        kept = [names.index(n) for n in simpler.priors.names]
        return np.concatenate([q[kept], q[self.model.dimension :]])

"""What an effect changes on the network alone, added to the answer of a model that has other effects, too."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..models.bare import bare_of
from ..models.model import Model
from .frame import Frame, insert, own_index

Array = NDArray[np.float64]


class Superposed:
    """What an effect changes on the network alone, added to the answer of a fit that has other effects."""

    def __init__(self, frame: Frame, model: Model, added: Sequence[str]) -> None:
        """model: that of the fit with the effects `added`."""
        self.frame, self.model = frame, model
        problem = frame.fit.problem
        self.plain, self.changed = problem.with_model(bare_of(model)), problem.with_model(bare_of(model, tuple(added)))
        self.before = self.plain.clean(self._coordinates(self.plain.model, insert(frame.fit, model, self._nothing())))

    def value(self, own: Array) -> float:
        """Minus log posterior at the effect's own coordinates (k,), the base moved along; infinite if it has none."""
        q = insert(self.frame.fit, self.model, own)
        log_prior = float(self.model.log_prior(q[None, : self.model.dimension])[0])
        if not math.isfinite(log_prior):
            return math.inf
        after = self.changed.clean(self._coordinates(self.changed.model, q))
        clean = [x + y - z for x, y, z in zip(self.frame.fit.clean, after, self.before, strict=True)]
        if not all(np.isfinite(x).all() for x in clean):
            return math.inf
        return self.frame.value(clean)[0] - log_prior

    def _nothing(self) -> Array:
        return np.zeros(own_index(self.frame.fit, self.model).size)

    def _coordinates(self, simpler: Model, q: Array) -> Array:
        """Those of a model that has some of the parameters of `model`."""
        names = self.model.priors.names
        kept = [names.index(n) for n in simpler.priors.names]
        return np.concatenate([q[kept], q[self.model.dimension :]])

"""The likelihood of any set of recordings of a group from one pass over each of them.

Given noise and model, recordings of a group depend on each other through the gain alone, which acts linearly: what it
needs of each is x'Px and x'P(y - x). Where every value is a simulation, leaving each out in turn costs one pass.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..likelihood.plant_group import PlantGroup
from ..likelihood.posterior import Posterior

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecordTerms:
    """By recording: log likelihood without a gain, x'P(y - x), x'Px, each (B,); prior sd of the gain."""

    alone: Mapping[str, Array] = field(repr=False)
    slope: Mapping[str, Array] = field(repr=False)
    information: Mapping[str, Array] = field(repr=False)
    gain_sd: float

    @classmethod
    def of(cls, posterior: Posterior, group: PlantGroup, q: Array) -> RecordTerms:
        """Terms at draws q (B, d) of all recordings whose zero of position, if they have one, is among them."""
        sigma, rho = posterior.noise_part(q, group.channel)
        z, zeros = posterior.model_part(q, group.specimen), posterior.zeros_part(q)
        alone, slope, information = {}, {}, {}
        for p in (*group.fitted, *group.others):
            if p.recording.is_mechanical and p.name not in zeros:
                continue
            # with a gain of unit prior sd the group says all three
            value, mean, variance, xx = group.evaluate(posterior.model, z, zeros, sigma, rho, [p.name], 1.0).T
            alone[p.name] = value - 0.5 * mean**2 / variance + 0.5 * np.log1p(xx)
            slope[p.name], information[p.name] = mean / variance, xx
        return cls(alone, slope, information, group.gain_sd)

    def log_likelihood(self, names: Collection[str]) -> Array:
        """(B,) joint log likelihood of the recordings of the group that are in `names`, the gain integrated out."""
        chosen = [n for n in self.alone if n in names]
        if not chosen:
            return np.zeros(len(next(iter(self.alone.values()))))
        out = np.sum([self.alone[n] for n in chosen], axis=0)
        if self.gain_sd > 0:
            xd, xx = (np.sum([t[n] for n in chosen], axis=0) for t in (self.slope, self.information))
            out = out + 0.5 * xd**2 / (xx + 1.0 / self.gain_sd**2) - 0.5 * np.log1p(self.gain_sd**2 * xx)
        return np.asarray(out, float)

"""Where a model with effects is sampled from: its maximum, found as the diagnosis finds it.

A swarm over effect and base at once is lost between modes that imitate the effect; the base is searched first, the
effect on a grid with the base moved along, and the best points are refitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...assemble import Assembled, assemble
from ...find_map import MapSettings
from ...gauss_newton.noise_prior import noise_prior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import reduce_campaign
from ...gauss_newton.whitening import Noise
from ...models.bare import bare_of
from ...models.model import Model
from ..where.features import features
from .first_fit import first_fit
from .grid import screen
from .promising import frames_of
from .weigh import refine

Array = NDArray[np.float64]
#: how many points of the grid fits begin from, at most
_STARTS = 4


def effect_starts(
    assembled: Assembled, model: Model, rng: np.random.Generator, settings: MapSettings
) -> list[Array]:
    """Coordinates of the posterior (d,) at refits of `model` from different points of its effects' grid, best first."""
    bare = bare_of(model)
    base_assembled = assemble(assembled.campaign, bare)
    pieces = [p for p in reduce_campaign(base_assembled) if p.identify]
    prior = noise_prior(base_assembled)
    problem = Problem.of(base_assembled, bare, pieces)
    base = first_fit(base_assembled, problem, prior, rng, settings)
    if base is None:
        return []
    frames = frames_of(base, [features(p) for p in pieces], prior)
    screened = screen(frames, model, model.spec.effects)
    if screened is None:
        return []
    out = []
    for n in range(1, _STARTS + 1):
        w = refine(base, screened, prior, n)
        if w is not None:
            d = model.dimension + problem.zero_mean.size
            out.append(np.concatenate([w.fit.q[:d], _noise_part(assembled, w.fit.noise)]))
    return out[::-1]


def _noise_part(assembled: Assembled, noise: Noise) -> Array:
    out: list[float] = []
    for c in assembled.posterior.channels:
        out.append(np.log(noise.sigma[c.channel]))
        out += [float(np.arctanh(r)) for r in noise.rho[c.channel]]
    return np.array(out)

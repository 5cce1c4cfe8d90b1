"""Other maxima of a posterior: where the walkers of a network begin besides the highest one.

What a mode that is not needed may do (be slower than the record, faster than the samples, share the place of another)
makes maxima far apart, the highest of which need not hold most of the probability. Ensembles that begin around one of
them do not find the others. Here the projected search over the time constants (`find_map`) goes down from many places
of the prior; all the ends that matter get walkers in proportion to their Laplace evidence, none of them few.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .find_map import MapResult
from .fit.descent import DescentSettings, descend
from .fit.polish import NewtonSettings, polish_newton
from .likelihood.linear_group import LinearGroup
from .likelihood.posterior import Posterior
from .map_search.voltage import VoltageSearch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BranchSettings:
    """starts: places of the prior gone down from; depth: nats below the highest at which a maximum no longer counts;
    apart: least distance of two maxima, in log time; most: maxima at most."""

    starts: int = 96
    depth: float = 12.0
    apart: float = 0.3
    most: int = 8


def find_branches(
    posterior: Posterior, found: MapResult, rng: np.random.Generator, settings: BranchSettings | None = None
) -> list[MapResult]:
    """Maxima of the posterior, that of `found` first; it alone where no projected search applies."""
    s = settings or BranchSettings()
    model = posterior.model
    fitted = [g for g in posterior.groups if g.fitted]
    groups = [g for g in fitted if isinstance(g, LinearGroup)]
    if len(groups) < len(fitted) or not groups or not model.separable or model.is_black_box or posterior.own:
        return [found]
    sigma, rho = posterior.noise_part(found.x[None], groups[0].channel)
    search = VoltageSearch(model, groups, float(sigma[0]), rho[0], rng)
    if search.dimension < 2:
        return [found]
    starts = search.at(rng.random((s.starts, search.dimension)))
    ends, values, _ = descend(
        lambda x: -search.solve(x)[1], starts, search.scale, DescentSettings(tolerance=1e-2, max_iterations=40)
    )
    ends = search.times.ordered(ends)
    out = [found]
    taken = [found.x[search.nonlinear]]
    for i in np.argsort(values):
        if len(out) >= s.most or values[i] > values.min() + s.depth:
            break
        if min(np.max(np.abs(ends[i] - t)) for t in taken) < s.apart:
            continue
        taken.append(ends[i])
        start = found.x.copy()
        start[: model.dimension] = search.coordinates(ends[i][None])[0]
        polished = polish_newton(posterior.log_prob, start, settings=NewtonSettings(tolerance=0.1, max_iterations=30))
        if polished.value < found.log_posterior - s.depth:
            continue
        if min(np.max(np.abs(polished.x[search.nonlinear] - b.x[search.nonlinear])) for b in out) < s.apart:
            continue
        out.append(replace(found, x=polished.x, log_posterior=polished.value, hessian=polished.hessian))
    return out

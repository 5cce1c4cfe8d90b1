"""A fit of the base to what is slow in the recordings.

A model without the effect often bends a fast branch to imitate it (a resistance becomes a mode of four milliseconds),
and from there no search for the effect finds the way back. Fitted to plateaus and slow waves alone, the base keeps to
what it is meant for; hypotheses are tried from there as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .features import Features
from .noise_prior import NoisePrior
from .reduced import subset
from .refit import Fit, refit

#: kept: blocks later than this after an edge (s), and waves up to this frequency (Hz)
_SETTLED_S, _SLOW_HZ = 0.15, 0.5
#: a start is worth its cost where the base's own fit on the slow blocks is worse by this many nats
_WORTH = 5.0


def slow_start(base: Fit, looks: list[Features], prior: NoisePrior, starts: list[np.ndarray]) -> Fit | None:
    """The base refitted to slow blocks, its sensitivities on all blocks; None where that is no other fit.

    starts: coordinates (d,) to begin from besides the base's own.
    """
    pieces = []
    for piece, f in zip(base.problem.pieces, looks, strict=True):
        settled = ~(f.since_edge_s < _SETTLED_S)
        if f.frequency_Hz > _SLOW_HZ:
            settled &= ~np.isfinite(f.phase)
        if settled.sum() >= 12:
            pieces.append(subset(piece, settled))
    if not pieces:
        return None
    problem = replace(base.problem, pieces=tuple(pieces))
    found = [refit(problem, q, base.noise, prior, fit_noise=False) for q in (base.q, *starts)]
    fits = [fit for fit in found if fit is not None]
    if not fits:
        return None
    best = min(fits, key=lambda f: f.objective)
    gram, logdet, _, _ = problem.gram(base.q, base.noise, with_jacobian=False)
    here = (
        -float(base.problem.log_prior(base.q)[0]) + 0.5 * float(gram[0, 0]) + 0.5 * logdet + prior.minus_log(base.noise)
    )
    if here - best.objective < _WORTH:
        return None
    _, _, clean, slopes = base.problem.gram(best.q, base.noise)
    return replace(base, q=best.q, clean=clean, slopes=slopes)

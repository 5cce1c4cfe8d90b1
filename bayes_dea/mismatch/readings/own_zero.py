"""Recordings that a fit has not seen, joined to it: a mechanical one brings a position of contact of its own.

Where the plates touch belongs to a recording like its offset does, and is found from it under every fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ...assemble import zero_prior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit

Array = NDArray[np.float64]

#: points and half-width, in sds of the prior, of the grid on which the best zero is looked for
_POINTS, _HALF = 49, 4.0


def with_zeros(fit: Fit, held: Sequence[Piece]) -> tuple[Fit, tuple[Piece, ...]]:
    """`fit` with a zero (m) at its best for every mechanical recording of `held`, and those pieces, pointing at it.

    Its curvature is that of the coordinates before; it is there to predict from, and as a start.
    """
    seen = {p.name for p in fit.problem.pieces}
    problem, q, pieces = fit.problem, fit.q, []
    at = problem.model.dimension + problem.zero_mean.size
    for piece in held:
        if piece.path is not None and piece.name not in seen:
            prior = zero_prior(piece.prepared)
            if piece.zero < 0:
                piece = replace(piece, zero=problem.zero_mean.size)
                problem = replace(
                    problem,
                    zero_mean=np.append(problem.zero_mean, prior.mean),
                    zero_sd=np.append(problem.zero_sd, prior.sd),
                )
                q = np.insert(q, at, prior.mean)
                at += 1
            q = _best_zero(problem, q, piece, fit)
        pieces.append(piece)
    return replace(fit, problem=problem, q=q), tuple(pieces)


def _best_zero(problem: Problem, q: Array, piece: Piece, fit: Fit) -> Array:
    """Coordinates with the zero of one piece at its most probable value, the others as they are."""
    alone = replace(problem, pieces=(piece,), shared=None)
    index = problem.model.dimension + piece.zero
    mean, sd = float(problem.zero_mean[piece.zero]), float(problem.zero_sd[piece.zero])

    def moved(zero: float) -> Array:
        out = q.copy()
        out[index] = zero
        return out

    def value(zero: float) -> float:
        gram = alone.gram(moved(zero), fit.noise, with_jacobian=False)[0]
        misfit = 0.5 * float(gram[0, 0]) + 0.5 * ((zero - mean) / sd) ** 2
        return misfit if np.isfinite(misfit) else 1e300

    grid = mean + np.linspace(-_HALF, _HALF, _POINTS) * sd
    step = float(grid[1] - grid[0])
    best = float(grid[int(np.argmin([value(z) for z in grid]))])
    found = minimize_scalar(value, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-9})
    return moved(float(found.x))

"""A sensor whose range ends at one of its readings, its own noise not cut off: zeros of the recordings set it apart.

Where noise comes after the end of the range, no reading lies on it, and it is weighed like any effect: as the end of
the displacement, before the zero of each recording is added. Where that leaves something, the end may be one of what
the sensor shows: in every recording another displacement. Both are found in the field.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import ndtri

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, refit
from ..search.relocate import relocated
from ..search.weigh import Weighed
from ..where.locate import is_adequate
from .reread import Rereading

CLIPPING = "sensor_clipping"
#: times that zeros are taken from a fit and the fit from zeros, at most; nats below which another gains nothing
_ROUNDS, _GAINED = 12, 1.0
#: share of the limit below it within which zeros may lie, at least
_BELOW = 0.1


def limit_of_readings(
    best: Weighed, log_prior: float, prior: NoisePrior, rng: np.random.Generator
) -> Rereading | None:
    """The best explanation with the end of the sensor's range as a reading, where that leaves nothing; else None.

    best: inadequate, with clipping among its effects; log_prior: of it.
    """
    fit = _settled(best.fit, prior)
    if fit is None or fit.log_evidence <= best.fit.log_evidence:
        return None
    if not is_adequate(fit, rng):
        # a mode that was bent to the end of a displacement, or flattened by it, may not find back
        fit = _settled(relocated(fit, prior), prior)
        if fit is None or not is_adequate(fit, rng):
            return None
    return Rereading(fit, fit.log_evidence + log_prior, limit=True)


def _settled(fit: Fit, prior: NoisePrior) -> Fit | None:
    """A fit whose zeros are its own, begun from another one; None where the model has no answer."""
    for _ in range(_ROUNDS):
        pieces = as_shown(fit, fit.problem.pieces)
        moved = refit(replace(fit.problem, pieces=pieces), fit.q, prior.start(), prior)
        if moved is None:
            return None
        gained, fit = moved.log_evidence - fit.log_evidence, moved
        if abs(gained) < _GAINED:
            break
    return fit


def as_shown(fit: Fit, pieces: tuple[Piece, ...]) -> tuple[Piece, ...]:
    """Pieces with the zero of the sensor in each as a fit sees it; mechanical ones as they are."""
    _, gains = fit.problem.beside(fit.q)
    highest = fit.values()["y_max_m"]
    out = []
    for p in pieces:
        if p.nodes is not None:
            (x,) = replace(fit.problem, pieces=(p,)).rows(fit.q)
            gain = 1.0 + float(gains[p.group])
            # rows at the limit say nothing of the zero
            seen = p.prepared.observed & (x < (1.0 - _BELOW) * highest)
            zero = float(np.mean(p.prepared.y[seen] / gain - x[seen])) if seen.any() else 0.0
            p = replace(p, nodes=replace(p.nodes, zero_m=zero))
        out.append(p)
    return tuple(out)


def limit_as_shown(fit: Fit) -> dict[str, float]:
    """The limit as a reading (m): (1 + gain) y_max, by Laplace; `own_parameters` without its prior.

    Gain and stiffness trade where the displacement alone is read, and the limit in the displacement with them; what the
    sensor shows at most is far better known.
    """
    problem = fit.problem
    at = problem.model.priors.names.index("y_max_m")
    (group, *_) = [p.group for p in problem.pieces if p.nodes is not None]
    gain_at = problem.model.dimension + problem.zero_mean.size + group
    _, gains = problem.beside(fit.q)
    size = 1.0 + float(gains[group])
    limit = size * float(fit.values()["y_max_m"])
    slopes = np.zeros(fit.q.size)
    slopes[at] = limit if problem.model.priors.free[at].prior.is_log else size
    slopes[gain_at] = limit  # its coordinate is log(1 + g)
    sd = float(np.sqrt(slopes @ fit.covariance @ slopes))
    low, high = limit + sd * ndtri([0.05, 0.95])
    return {"mean": limit, "sd": sd, "q05": float(low), "q50": limit, "q95": float(high), "map": limit}


def limit_note() -> str:
    """One line on it."""
    return (
        "the range of the displacement sensor ends at one of its readings, gain and zero of each recording included, "
        "and its noise is added beyond: y_max_m is that reading"
    )

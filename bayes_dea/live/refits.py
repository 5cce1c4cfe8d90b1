"""Where the posterior of a first stretch of samples lies: refits as in the diagnosis, far cheaper than a search.

The linear chain is searched (its sums make that cheap), the law takes over from there by Gauss-Newton on block means,
effects from the best points of a grid. What comes out is a mixture of normals to start from; it need not be exact.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import NDArray

from ..assemble import Assembled, assemble, linearised
from ..campaign.schema import Campaign
from ..find_map import find_map
from ..fit.mixture import Mixture
from ..gauss_newton.noise_prior import NoisePrior, noise_prior
from ..gauss_newton.problem import Problem
from ..gauss_newton.reduced import reduce_campaign
from ..gauss_newton.refit import Fit, refit
from ..mismatch.search.grid import screen
from ..mismatch.search.promising import frames_of
from ..mismatch.search.weigh import refine
from ..mismatch.where.features import features
from ..models.bare import bare_of
from ..models.model import PRIMARY, Model
from ..settings import CalibrationSettings

Array = NDArray[np.float64]

#: how many points of the grid of an effect's own parameters a refit is tried from
_STARTS = (1, 4)
#: fits this many nats behind the best are left out
_BEHIND = 8.0
#: components are this much wider than the normal approximation, and twice that
_WIDE = 1.2
#: a normal approximation is no wider than this many sds of the prior
_MOST = 1.0


def refitted(campaign: Campaign, model: Model, rng: np.random.Generator) -> Mixture | None:
    """A mixture over the coordinates of the posterior (model, log sigma, atanh rho) of displacements under a voltage;
    None where no refit has an end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = _fits(campaign, model, rng)
    if found is None:
        return None
    fits, prior, n = found
    parts = [(f, p) for f in fits if (p := _normal(f, model, prior, n)) is not None]
    if not parts:
        return None
    best = max(f.log_evidence for f, _ in parts)
    kept = [(f, p) for f, p in parts if f.log_evidence > best - _BEHIND]
    share = np.array([math.exp(0.5 * (f.log_evidence - best)) for f, _ in kept])
    means = np.array([p[0] for _, p in kept])
    roots = np.array([p[1] for _, p in kept])
    weights = np.concatenate([0.7 * share, 0.3 * share])
    return Mixture(weights / weights.sum(), np.concatenate([means, means]),
                   np.concatenate([_WIDE * roots, 2 * _WIDE * roots]))


def _fits(campaign: Campaign, model: Model, rng: np.random.Generator) -> tuple[list[Fit], NoisePrior, int] | None:
    chain = linearised(model)
    assembled = assemble(campaign, chain)
    found, _ = find_map(assembled.posterior, assembled.search_model, list(assembled.search_groups), rng,
                        CalibrationSettings().map)
    bare = bare_of(model)
    pieces = [p for p in reduce_campaign(assembled) if p.identify]
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, bare, pieces)
    q0 = np.concatenate([_taken_over(assembled, chain, bare, found.x, rng), np.zeros(problem.gain_sd.size)])
    base = refit(problem, q0, prior.start(), prior)
    if base is None:
        return None
    n = sum(p.prepared.n for p in pieces)
    if not model.spec.effects:
        return [base], prior, n
    screened = screen(frames_of(base, [features(p) for p in pieces], prior), model, model.spec.effects)
    if screened is None:
        return None
    refined = [refine(base, screened, prior, starts) for starts in _STARTS]
    fits = [w.fit for w in refined if w is not None]
    return (fits, prior, n) if fits else None


def _taken_over(assembled: Assembled, chain: Model, model: Model, x: Array, rng: np.random.Generator) -> Array:
    """Coordinates (d,) of `model` at those of the linear chain; what the chain has not, at the median of its prior."""
    linear = {k: float(v[0]) for k, v in chain.physical(assembled.posterior.model_part(x[None])).items()}
    values = {k: float(np.median(v)) for k, v in model.physical(model.prior_draws(2000, rng)).items()}
    values |= {k: v for k, v in linear.items() if k in values}
    name, factor = PRIMARY[model.spec.law or "hooke"]
    if name in values:
        values[name] = linear["Y_Pa"] / factor
    return np.asarray(model.from_prior_coordinates(model.priors.to_coordinates(values))[0], float)


def _normal(fit: Fit, model: Model, prior: NoisePrior, n: int) -> tuple[Array, Array] | None:
    """Mean (d,) and root (d, d) of the normal approximation at a fit to n readings."""
    d = model.dimension
    covariance = fit.covariance[:d, :d]
    most = _MOST * np.array([z.std() for z in model.prior_draws(2000, np.random.default_rng(0)).T])
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if not (np.isfinite(covariance).all() and (sd > 0).all()):
        return None
    # a direction that neither readings nor prior seem to bound is as wide as the prior, not wider
    shrink = np.minimum(1.0, most / sd)
    covariance = covariance * shrink[:, None] * shrink
    scale = np.sqrt(np.diag(covariance))
    eig, vec = np.linalg.eigh(covariance / np.outer(scale, scale))
    covariance = (vec * np.maximum(eig, 1e-10)) @ vec.T * np.outer(scale, scale)
    size = d + 2
    root = np.zeros((size, size))
    root[:d, :d] = np.linalg.cholesky(covariance)
    # n readings say this much of the noise
    root[d, d], root[d + 1, d + 1] = 1.0 / math.sqrt(2.0 * n), 1.0 / math.sqrt(n)
    mean = np.concatenate([fit.q[:d], [math.log(fit.noise.sigma["displacement"]),
                                       math.atanh(fit.noise.rho["displacement"][0])]])
    return (mean, root) if np.isfinite(mean).all() else None

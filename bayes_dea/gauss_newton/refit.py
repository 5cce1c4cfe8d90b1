"""Refit of a hypothesis by Gauss-Newton, its noise with it, and its evidence by Laplace."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from .descent import (
    MARGIN,
    Box,
    Effort,
    Linearisation,
    bounded_step,
    bounds,
    descended,
    inner_bounds,
    prior_derivatives,
)
from .journal import digest
from .noise_prior import NoisePrior
from .problem import Kept, Problem
from .whitening import Noise

Array = NDArray[np.float64]
#: the noise may move this many sds of its prior: a wrong model must not excuse itself by it
_NOISE_SDS = 8.0
#: step of its slopes (sds), and the share of the objective by which its last step improved it
_NUDGE, _CLOSE = 1e-3, 1e-9
#: nats by which new noise may improve a fit that is left where it is
_SETTLED = 0.01
#: nats that the last step of a descent by another fit's sensitivities promises
_ON_THE_WAY = 0.05


def laplace(objective: float, hessian: Array) -> float:
    """Laplace's log evidence at a maximum with this Hessian (d, d)."""
    sign, logdet = np.linalg.slogdet(hessian)
    if not sign > 0:
        return -math.inf
    return float(-objective + 0.5 * len(hessian) * math.log(2 * math.pi) - 0.5 * logdet)


@dataclass(frozen=True)
class Fit:
    """A hypothesis at its maximum.

    objective: minus log posterior density (noise included, not its normalisation by the evidence); hessian (d, d):
    Gauss-Newton and the prior's curvature; evidence: Laplace; residual columns can be made again from q and noise.
    """

    problem: Problem
    q: Array
    noise: Noise
    objective: float
    hessian: Array
    log_evidence: float
    at_bound: tuple[str, ...]
    steps: int
    clean: list[Array] = field(repr=False)
    slopes: list[Array] = field(repr=False)

    @property
    def covariance(self) -> Array:
        """Posterior covariance of q (d, d)."""
        return inverse(self.hessian)

    @property
    def linearisation(self) -> Linearisation:
        """Its predictions and sensitivities, for another descent from here."""
        return Linearisation(self.q, self.clean, self.slopes)

    def values(self) -> dict[str, float]:
        """Physical parameters at the maximum."""
        return {
            k: float(v[0]) for k, v in self.problem.model.physical(self.q[None, : self.problem.model.dimension]).items()
        }


def inverse(H: Array) -> Array:
    """Inverse of a symmetric matrix, without the directions that neither recordings nor prior say anything of."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    inner = np.linalg.pinv((H * scale).T * scale, rcond=1e-14, hermitian=True)
    return np.asarray((inner * scale).T * scale, dtype=float)


def refit(
    problem: Problem,
    q0: Array,
    noise: Noise,
    prior: NoisePrior,
    *,
    max_steps: int = 25,
    tolerance: float = 1e-3,
    fit_noise: bool = True,
    kept: Kept | None = None,
    coarse: bool = False,
    known: Linearisation | None = None,
) -> Fit | None:
    """Levenberg-Marquardt from q0; the noise is fitted in between. None where the model has no answer at q0.

    coarse: what is far from an explanation need not be known to a part of a nat; for searches, not for proofs.
    known: sensitivities at or near q0, so that the first need not be worked out.
    """
    box = inner_bounds(problem)
    journal = problem.journal
    key = ""
    if journal.kept:
        about = [None if k is None else k.key for k in (kept, known)]
        key = digest("refit", problem.key, q0, noise.key, prior, max_steps, tolerance, fit_noise, about, coarse)
        if key in journal:
            return _recalled(problem, journal[key], prior, box)
    effort = Effort(max_steps, tolerance, coarse=coarse)
    found = _searched(problem, np.clip(q0, *box), noise, prior, box, effort, fit_noise, kept, known)
    if found is None:
        journal.put(key, None)
        return None
    q, noise, taken, state = found
    journal.put(key, [q.tolist(), dict(noise.sigma), {c: list(r) for c, r in noise.rho.items()}, taken])
    return _fit(problem, q, noise, prior, taken, state, box)


def _recalled(problem: Problem, kept: list[Any] | None, prior: NoisePrior, box: Box) -> Fit | None:
    """The fit whose end a journal has kept."""
    if kept is None:
        return None
    q = np.array(kept[0], dtype=float)
    noise = Noise(kept[1], {c: tuple(r) for c, r in kept[2].items()})
    return _fit(problem, q, noise, prior, kept[3], problem.gram(q, noise), box)


#: Gram, log det, predictions, slopes: see `Problem.gram`
State = tuple[Array, float, list[Array], list[Array]]


def _searched(
    problem: Problem, q: Array, noise: Noise, prior: NoisePrior, box: Box, effort: Effort, fit_noise: bool,
    kept: Kept | None, known: Linearisation | None,
) -> tuple[Array, Noise, int, State] | None:
    """Descents, and the noise in between: coordinates, noise, steps taken, and what was worked out there."""
    taken = 0
    if kept is not None:
        # on the way the base's sensitivities hardly change; at the end all are worked out
        approached = descended(problem, q, noise, box, replace(effort, tolerance=_ON_THE_WAY), kept)
        if approached is None:
            return None
        q, taken = approached.q, approached.steps
    ended = descended(problem, q, noise, box, effort, known=known)
    if ended is None:
        return None
    q, taken = ended.q, taken + ended.steps
    state: State | None = None
    if fit_noise:
        noise = fit_noise_terms(problem, q, ended.clean, noise, prior)
        gram, logdet = problem.sums(q, noise, ended.clean, ended.slopes)
        if _newton(gram, ended.prior, q, box)[1] > _SETTLED:
            # a fit that is wrong by much lies elsewhere once the noise has grown
            there = Linearisation(q, ended.clean, ended.slopes, ended.exact)
            again = descended(problem, q, noise, box, effort, known=there)
            if again is None:
                return None
            ended, q, taken = again, again.q, taken + again.steps
        elif ended.exact:
            state = gram, logdet, ended.clean, ended.slopes
    if state is None and ended.exact:
        state = ended.gram, ended.logdet, ended.clean, ended.slopes
    state = state or problem.gram(q, noise, clean=ended.clean)
    return (q, noise, taken, state) if np.isfinite(state[0]).all() else None


def _fit(
    problem: Problem, q: Array, noise: Noise, prior: NoisePrior, taken: int, state: State, box: Box
) -> Fit:
    """The fit at q, with Laplace's evidence."""
    gram, logdet, clean, slopes = state
    base, _, curvature = prior_derivatives(problem, q)
    objective = base + 0.5 * gram[0, 0] + 0.5 * logdet + prior.minus_log(noise)
    H = gram[1:, 1:] + curvature
    H = 0.5 * (H + H.T)
    low, high = box
    # as far again from there
    margin = np.where(np.isfinite(high - low), MARGIN * (high - low), 0.0)
    names = problem.names
    touching = tuple(
        names[i] for i in range(q.size) if margin[i] > 0 and min(q[i] - low[i], high[i] - q[i]) <= margin[i] + 1e-12
    )
    return Fit(problem, q, noise, objective, H, laplace(objective, H), touching, taken, clean, slopes)


def extrapolated(problem: Problem, fit: Fit, prior: NoisePrior) -> tuple[float, float]:
    """Log evidence of a problem that is a fit's but for what is linear, one step from that fit; and what the step
    promises (nats). Nothing is simulated."""
    gram, logdet = problem.sums(fit.q, fit.noise, fit.clean, fit.slopes)
    base, gradient, curvature = prior_derivatives(problem, fit.q)
    H, promised = _newton(gram, (base, gradient, curvature), fit.q, bounds(problem))
    objective = base + 0.5 * float(gram[0, 0]) + 0.5 * logdet + prior.minus_log(fit.noise) - promised
    return laplace(objective, 0.5 * (H + H.T)), promised


def _newton(gram: Array, prior: tuple[float, Array, Array], q: Array, box: Box) -> tuple[Array, float]:
    """Hessian (d, d) at q, and the nats that a step without damping promises. prior: see `prior_derivatives`."""
    H = gram[1:, 1:] + prior[2]
    g = prior[1] - gram[0, 1:]
    step = bounded_step(H, g, np.zeros_like(H), q, *box)
    return H, -float(g @ step + 0.5 * step @ H @ step)


def fit_noise_terms(problem: Problem, q: Array, clean: list[Array], start: Noise, prior: NoisePrior) -> Noise:
    """sigma and rho of every channel at their posterior maximum, given the predictions."""
    noise = start
    for channel in start.sigma:
        if not any(p.channel == channel for p in problem.pieces):
            continue

        def objective(x: Array, channel: str = channel, noise: Noise = noise) -> float:
            trial = prior.at(noise, channel, x)
            gram, logdet = problem.sums(q, trial, clean, [])
            return prior.minus_log(trial, channel) + 0.5 * float(gram[0, 0]) + 0.5 * logdet

        x0 = np.clip(prior.coordinates(noise, channel), -_NOISE_SDS + 1, _NOISE_SDS - 1)
        within = [(-_NOISE_SDS, _NOISE_SDS)] * x0.size
        # wrong models end in a corner of these bounds, and all have to end at the same place of it to be compared
        found = minimize(objective, x0, method="L-BFGS-B", bounds=within, options={"eps": _NUDGE, "ftol": _CLOSE})
        noise = prior.at(noise, channel, found.x)
    return noise


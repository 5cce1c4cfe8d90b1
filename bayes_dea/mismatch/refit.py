"""Refit of a hypothesis by Gauss-Newton, its noise with it, and its evidence by Laplace."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from .journal import digest
from .noise_prior import NoisePrior
from .problem import Kept, Problem
from .whitening import Noise

Array = NDArray[np.float64]
_PRIOR_STEP = 1e-3
#: the noise may move this many sds of its prior: a wrong model must not excuse itself by it
_NOISE_SDS = 8.0
#: nats of misfit beyond that of noise from which on a coarse descent ends earlier, by as much as the misfit is larger
_FAR_OFF = 500.0


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


def prior_derivatives(problem: Problem, q: Array) -> tuple[float, Array, Array]:
    """Minus log prior, its gradient and its Hessian (made positive) by central differences.

    A flat prior between bounds curves like the normal of its variance. Where the recordings say nothing of such a
    parameter its width is then that of the box, not endless, and the evidence of the others keeps its meaning.
    """
    d = q.size
    scale = np.full(d, _PRIOR_STEP)
    scale[: problem.model.dimension] = _PRIOR_STEP * np.maximum(problem.model.priors.scales(), 1e-12)
    m = problem.model.dimension
    scale[m : m + problem.zero_mean.size] = _PRIOR_STEP * problem.zero_sd
    scale[m + problem.zero_mean.size :] = _PRIOR_STEP * problem.gain_sd
    points = [q]
    for i in range(d):
        for s in (1.0, -1.0):
            p = q.copy()
            p[i] += s * scale[i]
            points.append(p)
    pairs = [(i, j) for i in range(m) for j in range(i)]
    for i, j in pairs:
        for s in (1.0, -1.0):
            p = q.copy()
            p[i] += s * scale[i]
            p[j] += s * scale[j]
            points.append(p)
    f = -problem.log_prior(np.array(points))
    base = f[0]
    if not np.isfinite(base):  # outside the prior
        return float(base), np.zeros(d), np.zeros((d, d))
    up, down = f[1 : 2 * d + 1 : 2], f[2 : 2 * d + 2 : 2]
    # beyond a bound straight on, and no curvature of the edge; bounds are kept by the step itself
    up, down = np.where(np.isfinite(up), up, 2 * base - down), np.where(np.isfinite(down), down, 2 * base - up)
    up, down = np.where(np.isfinite(up), up, base), np.where(np.isfinite(down), down, base)
    gradient = (up - down) / (2 * scale)
    H = np.diag((up + down - 2 * base) / scale**2)
    both = f[1 + 2 * d :]
    for n, (i, j) in enumerate(pairs):
        total = both[2 * n] + both[2 * n + 1] - 2 * base
        if not np.isfinite(total):
            continue
        cross = 0.5 * (total / (scale[i] * scale[j]) - H[i, i] * scale[i] / scale[j] - H[j, j] * scale[j] / scale[i])
        H[i, j] = H[j, i] = cross
    values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    low, high = bounds(problem)
    return float(base), gradient, (vectors * np.maximum(values, 0.0)) @ vectors.T + np.diag(12.0 / (high - low) ** 2)


def bounds(problem: Problem) -> tuple[Array, Array]:
    """Lower and upper bounds (d,) of the coordinates; infinite where the prior has none."""
    low, high = np.full(problem.dimension, -np.inf), np.full(problem.dimension, np.inf)
    for i, p in enumerate(problem.model.priors.free):
        if p.prior.family in ("uniform", "loguniform"):
            a, b = (math.log(p.prior.a), math.log(p.prior.b)) if p.prior.is_log else (p.prior.a, p.prior.b)
            low[i], high[i] = a, b
    return low, high


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
) -> Fit | None:
    """Levenberg-Marquardt from q0; the noise is fitted in between. None where the model has no answer at q0.

    coarse: what is far from an explanation need not be known to a part of a nat; for searches, not for proofs.
    """
    low, high = bounds(problem)
    margin = np.where(np.isfinite(high - low), 1e-6 * (high - low), 0.0)
    low, high = low + margin, high - margin
    journal = problem.journal
    key = ""
    if journal.kept:
        about = None if kept is None else kept.key
        key = digest("refit", problem.key, q0, noise.key, max_steps, tolerance, fit_noise, about, coarse)
        if key in journal:
            return _recalled(problem, journal[key], prior, margin, low, high)
    start = np.clip(q0, low, high)
    found = _searched(problem, start, noise, prior, max_steps, tolerance, fit_noise, kept, low, high, coarse)
    if found is None:
        journal.put(key, None)
        return None
    q, noise, taken, state = found
    journal.put(key, [q.tolist(), dict(noise.sigma), {c: list(r) for c, r in noise.rho.items()}, taken])
    return _fit(problem, q, noise, prior, taken, state, margin, low, high)


def _recalled(
    problem: Problem, kept: list[Any] | None, prior: NoisePrior, margin: Array, low: Array, high: Array
) -> Fit | None:
    """The fit whose end a journal has kept."""
    if kept is None:
        return None
    q = np.array(kept[0], dtype=float)
    noise = Noise(kept[1], {c: tuple(r) for c, r in kept[2].items()})
    return _fit(problem, q, noise, prior, kept[3], problem.gram(q, noise), margin, low, high)


#: Gram, log det, predictions, slopes: see `Problem.gram`
State = tuple[Array, float, list[Array], list[Array]]


def _searched(
    problem: Problem,
    q: Array,
    noise: Noise,
    prior: NoisePrior,
    max_steps: int,
    tolerance: float,
    fit_noise: bool,
    kept: Kept | None,
    low: Array,
    high: Array,
    coarse: bool,
) -> tuple[Array, Noise, int, State] | None:
    """Descents, and the noise in between: coordinates, noise, steps taken, and what was worked out there."""
    taken = 0
    if kept is not None:
        # on the way the base's sensitivities hardly change; at the end all are worked out
        approached = descend(problem, q, noise, low, high, max_steps, 0.05, kept, coarse=coarse)
        if approached is None:
            return None
        q, taken = approached.q, approached.steps
    ended = descend(problem, q, noise, low, high, max_steps, tolerance, None, coarse=coarse)
    if ended is None:
        return None
    q, taken = ended.q, taken + ended.steps
    gram, logdet, clean, slopes = ended.gram, ended.logdet, ended.clean, ended.slopes
    if fit_noise:
        base, gradient, curvature = ended.prior
        noise = fit_noise_terms(problem, q, clean, noise, prior)
        gram, logdet = problem.sums(q, noise, clean, slopes)
        H = gram[1:, 1:] + curvature
        step = _bounded_step(H, gradient - gram[0, 1:], np.zeros_like(H), q, low, high)
        if np.isfinite(problem.log_prior(q + step)[0]):
            value, there = _there(problem, q + step, noise)
            if value < base + 0.5 * gram[0, 0]:
                q = q + step
                gram, logdet, clean, slopes = problem.gram(q, noise, clean=there)
    return q, noise, taken, (gram, logdet, clean, slopes)


def _fit(
    problem: Problem,
    q: Array,
    noise: Noise,
    prior: NoisePrior,
    taken: int,
    state: State,
    margin: Array,
    low: Array,
    high: Array,
) -> Fit:
    """The fit at q, with Laplace's evidence."""
    gram, logdet, clean, slopes = state
    base, _, curvature = prior_derivatives(problem, q)
    objective = base + 0.5 * gram[0, 0] + 0.5 * logdet + prior.minus_log(noise)
    H = gram[1:, 1:] + curvature
    H = 0.5 * (H + H.T)
    sign, logdet_h = np.linalg.slogdet(H)
    evidence = -objective + 0.5 * q.size * math.log(2 * math.pi) - 0.5 * logdet_h if sign > 0 else -math.inf
    names = problem.names
    touching = tuple(
        names[i] for i in range(q.size) if margin[i] > 0 and min(q[i] - low[i], high[i] - q[i]) <= margin[i] + 1e-12
    )
    return Fit(problem, q, noise, objective, H, float(evidence), touching, taken, clean, slopes)


@dataclass(frozen=True)
class End:
    """Where a descent ended; value: minus log posterior without log det terms."""

    q: Array
    value: float
    steps: int
    gram: Array
    logdet: float
    clean: list[Array]
    slopes: list[Array]
    prior: tuple[float, Array, Array]


def descend(
    problem: Problem,
    q: Array,
    noise: Noise,
    low: Array,
    high: Array,
    max_steps: int,
    tolerance: float,
    kept: Kept | None,
    hopeless_above: float = math.inf,
    coarse: bool = False,
) -> End | None:
    """Levenberg-Marquardt at fixed noise. None where the model has no answer at q.

    hopeless_above: given up where the value less ten times what the next step promises lies above this.
    coarse: see `refit`.
    """
    journal = problem.journal
    if not journal.kept:
        return _descended(problem, q, noise, low, high, max_steps, tolerance, kept, hopeless_above, coarse)
    about = None if kept is None else kept.key
    key = digest("descend", problem.key, q, noise.key, low, high, max_steps, tolerance, about, hopeless_above, coarse)
    if key in journal:
        known = journal[key]
        if known is None:
            return None
        q = np.array(known[0], dtype=float)
        gram, logdet, clean, slopes = problem.gram(q, noise, kept=kept)
        prior = prior_derivatives(problem, q)
        return End(q, prior[0] + 0.5 * float(gram[0, 0]), known[1], gram, logdet, clean, slopes, prior)
    end = _descended(problem, q, noise, low, high, max_steps, tolerance, kept, hopeless_above, coarse)
    journal.put(key, None if end is None else [end.q.tolist(), end.steps])
    return end


def _descended(
    problem: Problem,
    q: Array,
    noise: Noise,
    low: Array,
    high: Array,
    max_steps: int,
    tolerance: float,
    kept: Kept | None,
    hopeless_above: float,
    coarse: bool,
) -> End | None:
    """`descend`, worked out."""
    gram, logdet, clean, slopes = problem.gram(q, noise, kept=kept)
    prior = prior_derivatives(problem, q)
    if not np.isfinite(gram).all() or not np.isfinite(prior[0]):
        return None
    damping, taken = 1e-6, 0
    decoupled = problem.decoupled
    noise_alone = 0.5 * sum(p.blocks.n for p in problem.pieces)
    finest = tolerance
    for _ in range(max_steps):
        value = prior[0] + 0.5 * gram[0, 0]
        if coarse:
            tolerance = finest * max(1.0, (value - noise_alone) / _FAR_OFF)
        g = prior[1] - gram[0, 1:]
        H = gram[1:, 1:] + prior[2]
        metric = _metric(H, prior[2], decoupled)
        new: tuple[Array, float, list[Array]] | None = None
        for _attempt in range(8):
            step = _bounded_step(H, g, damping * metric, q, low, high)
            promised = -float(g @ step + 0.5 * step @ H @ step)
            if promised < tolerance or value - 10.0 * promised > hopeless_above:
                break
            there, predicted = _there(problem, q + step, noise)
            if there < value:
                new = q + step, there, predicted
                break
            damping = max(10.0 * damping, 1e-4)
        if new is None:
            break
        q, damping, taken = new[0], 0.1 * damping, taken + 1
        gram, logdet, clean, slopes = problem.gram(q, noise, kept=kept, clean=new[2])
        prior = prior_derivatives(problem, q)
        if value - new[1] < 3 * tolerance:
            break
    return End(q, prior[0] + 0.5 * float(gram[0, 0]), taken, gram, logdet, clean, slopes, prior)


def value_at(problem: Problem, q: Array, noise: Noise) -> float:
    """Minus log posterior at fixed noise without log det terms; infinite where the model has no answer."""
    return _there(problem, q, noise)[0]


def _there(problem: Problem, q: Array, noise: Noise) -> tuple[float, list[Array]]:
    """`value_at`, and the predictions; none where the model has no answer."""
    p = -float(problem.log_prior(q)[0])
    if not np.isfinite(p):
        return math.inf, []
    # the Jacobian is worked out only where a step is taken
    gram, _, clean, _ = problem.gram(q, noise, with_jacobian=False)
    return (p + 0.5 * float(gram[0, 0]), clean) if np.isfinite(gram).all() else (math.inf, [])


def _metric(H: Array, prior: Array, decoupled: Array) -> Array:
    """(d, d) what steps are damped by: the geometric mean of the curvatures of posterior and prior.

    Directions that the readings hardly determine are where a model bends most, and are damped first. Taken in
    coordinates in which gain and compliance do not trade: along their ridge a fit has to go far, and damping by the
    curvature across it would stop it.
    """
    across = np.linalg.inv(decoupled)
    H, prior = across.T @ H @ across, across.T @ prior @ across
    size = np.sqrt(np.maximum(np.diag(H), 1e-12) * np.maximum(np.diag(prior), 1e-3))
    return np.asarray(decoupled.T @ (size[:, None] * decoupled))


def _bounded_step(H: Array, g: Array, damping: Array, q: Array, low: Array, high: Array) -> Array:
    """Gauss-Newton step with damping (d, d); coordinates that would leave their bounds stop at them."""
    d = q.size
    A = H + damping
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    step = np.zeros(d)
    free = np.ones(d, dtype=bool)
    for _ in range(d + 1):
        step[free] = 0.0
        rhs = -(g[free] + A[np.ix_(free, ~free)] @ step[~free])
        s = scale[free]
        step[free] = s * np.linalg.lstsq((A[np.ix_(free, free)] * s).T * s, s * rhs, rcond=1e-14)[0]
        new = q + step
        out = free & ((new < low) | (new > high))
        if not out.any():
            break
        step[out] = np.clip(new, low, high)[out] - q[out]
        free &= ~out
    return step


def fit_noise_terms(problem: Problem, q: Array, clean: list[Array], start: Noise, prior: NoisePrior) -> Noise:
    """sigma and rho of every channel at their posterior maximum, given the predictions."""
    noise = start
    for channel in start.sigma:
        if not any(p.channel == channel for p in problem.pieces):
            continue

        def objective(x: Array, channel: str = channel, noise: Noise = noise) -> float:
            if np.any(np.abs(x) > _NOISE_SDS):
                return math.inf
            trial = prior.at(noise, channel, x)
            gram, logdet = problem.sums(q, trial, clean, [])
            return prior.minus_log(trial, channel) + 0.5 * float(gram[0, 0]) + 0.5 * logdet

        x0 = np.clip(prior.coordinates(noise, channel), -_NOISE_SDS + 1, _NOISE_SDS - 1)
        found = minimize(
            objective,
            x0,
            method="Nelder-Mead",
            options={"xatol": 0.05, "fatol": 0.02, "maxfev": 60, "initial_simplex": _simplex(x0)},
        )
        noise = prior.at(noise, channel, found.x)
    return noise


def _simplex(x0: Array) -> Array:
    return np.concatenate([x0[None], x0 + np.eye(x0.size)])

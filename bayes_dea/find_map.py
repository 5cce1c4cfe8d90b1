"""The maximum of the posterior: a particle swarm over what is nonlinear, then a Newton polish of everything.

With voltage recordings the swarm moves over the logarithms of the time constants, in quantiles of their prior; the
compliances are projected out: for each particle an inner Gauss-Newton iteration on their logarithms against the Gram
sums, with a normal approximation of their prior. For a nonlinear law the same search on its linearisation gives the
start. Without voltage recordings the swarm moves over the whole prior box.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .fit.polish import NewtonPolish, NewtonSettings, polish_newton
from .fit.swarm import SwarmSettings, multi_swarm
from .likelihood.linear_group import LinearGroup
from .likelihood.posterior import Posterior
from .models.model import Model

_INNER_STEPS = 12


@dataclass(frozen=True)
class MapSettings:
    """swarms: independent runs that must agree; agreement: in nats; swarm: how each moves."""

    swarms: int = 8
    agreement: float = 0.1
    swarm: SwarmSettings = SwarmSettings(particles=24, max_iterations=60, stall_iterations=10, tolerance=0.02)


@dataclass(frozen=True)
class MapResult:
    """Best point (d,), its log posterior, the Hessian there (d, d); how many of the swarms end there."""

    x: NDArray[np.float64]
    log_posterior: float
    hessian: NDArray[np.float64]
    swarms: int
    agree: int
    evaluations: int
    converged: bool


class ProjectedSearch:
    """Swarm objective over log time constants with the linear coefficients projected out."""

    def __init__(self, model: Model, groups: list[LinearGroup], sigma: float, rho: NDArray, rng: np.random.Generator,
                 draws: int = 4000):
        self.model = model
        self.basis_group = groups[0]
        self.M = np.sum([g.projected(sigma, rho) for g in groups], axis=0)
        z = model.prior_draws(draws, rng)
        self.nonlinear = model.nonlinear_index()
        self.linear = np.array([i for i in range(model.dimension) if i not in set(self.nonlinear.tolist())])
        self.center, self.spread = z.mean(axis=0), np.maximum(z.std(axis=0), 1e-6)
        self.quantiles = np.sort(z[:, self.nonlinear], axis=0)
        self.grid = (np.arange(draws) + 0.5) / draws
        self.evaluations = 0

    @property
    def dimension(self) -> int:
        """Number of time constants."""
        return int(self.nonlinear.size)

    def times(self, cube: NDArray) -> NDArray:
        """Unit cube (B, m) to log time constants (B, m), longest first."""
        cube = np.clip(cube, 0, 1)
        out = np.stack([np.interp(cube[:, j], self.grid, self.quantiles[:, j]) for j in range(self.dimension)], axis=1)
        out = -np.sort(-out, axis=1)
        # equal time constants make one column twice: keep them a part in a thousand apart
        return out - 1e-3 * np.arange(self.dimension)

    def solve(self, cube: NDArray) -> tuple[NDArray, NDArray]:
        """Coordinates (B, d) and projected log posterior (B,) of particles (B, m)."""
        B = len(cube)
        z = np.tile(self.center, (B, 1))
        z[:, self.nonlinear] = self.times(cube)
        self.evaluations += B
        T = np.exp(z[:, self.nonlinear])
        m = T.shape[1]
        unit = self.basis_group.vectors_of(np.zeros(B * m), np.ones((B * m, 1)), T.reshape(-1, 1)).reshape(B, m, -1)
        q = unit.shape[2]
        feedthrough = np.zeros((B, 1, q))
        feedthrough[:, 0, -1] = 1.0
        responses = np.concatenate([feedthrough, unit], axis=1)
        W = np.einsum("bkp,bkq->bpq", self.model.design(z), responses)
        Mx, My, yy = self.M[:q, :q], self.M[:q, -1], float(self.M[-1, -1])
        H = np.einsum("bpq,qr,bsr->bps", W, Mx, W, optimize=True)
        g = W @ My
        mean, sd = self.center[self.linear], self.spread[self.linear]
        a = z[:, self.linear].copy()
        value = self._objective(a, H, g, yy, mean, sd)
        damping = np.full(B, 1e-3)
        for _ in range(_INNER_STEPS):
            e = np.exp(a)
            gradient = e * (g - np.einsum("bps,bs->bp", H, e)) - (a - mean) / sd**2
            curvature = e[:, :, None] * H * e[:, None, :] + np.eye(len(sd)) / sd**2
            diagonal = np.einsum("bpp->bp", curvature)
            curvature = curvature + damping[:, None, None] * np.eye(len(sd)) * diagonal[:, None, :]
            step = np.clip(np.linalg.solve(curvature, gradient[:, :, None])[:, :, 0], -3, 3)
            trial = a + step
            new = self._objective(trial, H, g, yy, mean, sd)
            better = new > value
            a = np.where(better[:, None], trial, a)
            value = np.where(better, new, value)
            damping = np.where(better, damping * 0.2, damping * 10)
        z[:, self.linear] = a
        s = (z[:, self.nonlinear] - self.center[self.nonlinear]) / self.spread[self.nonlinear]
        return z, value - 0.5 * np.sum(s * s, axis=1)

    @staticmethod
    def _objective(a: NDArray, H: NDArray, g: NDArray, yy: float, mean: NDArray, sd: NDArray) -> NDArray:
        e = np.exp(np.clip(a, -300, 300))
        quadratic = np.einsum("bp,bps,bs->b", e, H, e, optimize=True)
        return -0.5 * (yy - 2 * np.einsum("bp,bp->b", g, e) + quadratic) - 0.5 * np.sum(((a - mean) / sd)**2, axis=1)


def find_map(posterior: Posterior, search_model: Model, linear_groups: list[LinearGroup], rng: np.random.Generator,
             settings: MapSettings | None = None,
             refresh: Callable[[Posterior, NDArray], Posterior] | None = None) -> tuple[MapResult, Posterior]:
    """Maximum of the posterior and the posterior itself, with its block reference at that maximum.

    search_model: the linear model whose time constants the swarm searches (the model itself, or its linearisation).
    linear_groups: Gram groups of the voltage recordings; empty when there are none. refresh: gives the posterior with
    its within-block reference moved to a point (None when nothing is in blocks).
    """
    s = settings or MapSettings()
    if linear_groups and search_model.separable:
        starts, evaluations = _projected_starts(posterior, search_model, linear_groups, rng, s)
    else:
        starts, evaluations = _box_starts(posterior, rng, s)
    if refresh is not None:
        posterior = refresh(posterior, starts[0])
    newton = NewtonSettings(tolerance=1e-5, max_iterations=80)
    found: list[NewtonPolish] = []
    ends: list[NDArray] = []
    for start in starts:
        near = [i for i, other in enumerate(ends) if np.max(np.abs(other - start) / posterior_scale(posterior)) < 1e-3]
        if near:
            ends.append(start)
            found.append(found[near[0]])
            continue
        if not np.isfinite(posterior.log_prob(start[None])[0]):
            ends.append(np.full_like(start, np.inf))
            found.append(NewtonPolish(start, -np.inf, np.zeros((start.size,) * 2), np.zeros(start.size, bool), np.inf,
                                      False, 0, 1))
            continue
        ends.append(start)
        found.append(polish_newton(posterior.log_prob, start, settings=newton))
    best = max(found, key=lambda f: f.value)
    if refresh is not None:
        # the reference moves to the maximum, and the maximum with it
        for _ in range(2):
            posterior = refresh(posterior, best.x)
            best = polish_newton(posterior.log_prob, best.x, settings=newton)
        agree = sum(bool(np.linalg.norm((f.x - best.x) / posterior_scale(posterior)) < 0.05 or f.value >= best.value - s.agreement)
                    for f in found)
    else:
        agree = sum(f.value >= best.value - s.agreement for f in found)
    evaluations += sum(f.evaluations for f in {id(f): f for f in found}.values())
    return MapResult(best.x, best.value, best.hessian, s.swarms, int(agree), evaluations, best.converged), posterior


def posterior_scale(posterior: Posterior) -> NDArray:
    """A length for each coordinate: one for logarithms, the prior sd for zeros of position."""
    scale = np.ones(posterior.dimension)
    d = posterior.model.dimension
    for i, p in enumerate(posterior.model.priors.free):
        if not p.prior.is_log:
            scale[i] = p.prior.coordinate_sd()
    for i, zero in enumerate(posterior.zeros):
        scale[d + i] = zero.sd
    return scale


def _projected_starts(posterior: Posterior, search_model: Model, groups: list[LinearGroup], rng: np.random.Generator,
                      s: MapSettings) -> tuple[list[NDArray], int]:
    channel = next(c for c in posterior.channels if c.channel == groups[0].channel)
    search = ProjectedSearch(search_model, [g for g in groups if g.fitted], channel.sigma_guess,
                             np.array(channel.rho_guess), rng)
    result = multi_swarm(lambda cube: -search.solve(cube)[1], np.zeros(search.dimension), np.ones(search.dimension),
                         s.swarm, rng, swarms=s.swarms, tolerance=s.agreement)
    z, _ = search.solve(np.array(result.points))
    tail = posterior.noise_guess()
    order = np.argsort(result.values)
    starts = []
    for i in order:
        full = z[i] if search_model is posterior.model else _from_linear(posterior.model, search_model, z[i])
        starts.append(np.concatenate([full, tail]))
    return starts, search.evaluations


def _from_linear(model: Model, linear: Model, z: NDArray) -> NDArray:
    """Start of a nonlinear law from its linearisation: network coordinates carried over, shape at the prior's centre."""
    center = model.prior_draws(2000, np.random.default_rng(0)).mean(axis=0)
    for i, name in enumerate(model.coordinate_names):
        if name in linear.coordinate_names:
            center[i] = z[linear.coordinate_names.index(name)]
    if model.spec.network == "none":
        from .models.model import PRIMARY

        primary, factor = PRIMARY[model.spec.law or "hooke"]
        center[model.priors.names.index(primary)] = z[0] - np.log(factor)
    return center


def _box_starts(posterior: Posterior, rng: np.random.Generator, s: MapSettings) -> tuple[list[NDArray], int]:
    model = posterior.model
    d, n_zero = model.dimension, len(posterior.zeros)
    tail = posterior.noise_guess()
    count = 0

    def points(cube: NDArray) -> NDArray:
        z = model.from_prior_coordinates(model.priors.transform(np.clip(cube[:, :d], 1e-4, 1 - 1e-4)))
        q = np.concatenate([z, np.tile(tail, (len(cube), 1))], axis=1)
        for i, zero in enumerate(posterior.zeros):
            from scipy.special import ndtri

            q[:, d + i] = zero.mean + zero.sd * ndtri(np.clip(cube[:, d + i], 1e-4, 1 - 1e-4))
        return q

    def objective(cube: NDArray) -> NDArray:
        nonlocal count
        count += len(cube)
        return -posterior.log_prob(points(cube))

    dimension = d + n_zero
    swarm = SwarmSettings(particles=max(30, 4 * dimension), max_iterations=150, stall_iterations=15, tolerance=0.5)
    swarms = min(s.swarms, 4)
    result = multi_swarm(objective, np.zeros(dimension), np.ones(dimension), swarm, rng, swarms=swarms,
                         tolerance=s.agreement)
    order = np.argsort(result.values)
    return list(points(np.array(result.points)[order])), count


def laplace_covariance(result: MapResult, posterior: Posterior, rng: np.random.Generator) -> NDArray:
    """Covariance (d, d) at the maximum, no direction wider than the prior."""
    prior = np.cov(posterior.prior_draws(2000, rng).T) + 1e-12 * np.eye(posterior.dimension)
    hessian = np.where(np.isfinite(result.hessian), result.hessian, 0.0)
    scale = np.sqrt(np.diag(prior))
    eig, vec = np.linalg.eigh(-hessian * np.outer(scale, scale))
    eig = np.maximum(eig, 0.5)
    return (vec / eig) @ vec.T * np.outer(scale, scale)

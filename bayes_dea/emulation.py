"""Sampling a model that costs a simulation a draw: emulator around the maximum, pilot runs, exact reweighting.

The emulator (`likelihood.emulated_group`) is fitted to simulations at draws of a normal approximation; short runs of
the sampler on it say where the posterior is, further simulations there how far the emulator is off, and it is fitted
again until that is little. Everything is done before the long run, so that a long run resumes on the very same density.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .find_map import MapResult
from .fit.mixture import Mixture
from .fit.pilot import Pilot, PilotSettings, run_pilot, straightened
from .fit.shear import Shear
from .likelihood.block_group import BlockGroup
from .likelihood.emulated_group import Design, base_of, emulate_group, projected_gram
from .likelihood.linear_group import LinearGroup
from .likelihood.plant_group import PlantGroup
from .likelihood.polynomial import mode_pairs, monomials, powers_of
from .likelihood.posterior import Posterior
from .likelihood.remembering import remembering

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EmulationSettings:
    """rounds: pilots at most; error_nats: sd of the error that is good enough; tests: simulations that measure it.

    most_terms: monomials of a third-order polynomial at most; above, it stays at the second.
    """

    rounds: int = 6
    error_nats: float = 0.15
    tests: int = 40
    pilot: PilotSettings = PilotSettings()
    most_terms: int = 300


@dataclass(frozen=True)
class Emulation:
    """exact: the posterior with a memory; emulated: what is sampled.

    shear: straightens its coordinates. start (e, w, d) and proposal are in straightened coordinates.
    """

    exact: Posterior = field(repr=False)
    emulated: Posterior = field(repr=False)
    shear: Shear = field(repr=False)
    start: Array = field(repr=False)
    proposal: Mixture | None = field(repr=False)
    error_nats_sd: float
    simulations: int
    order: int
    rounds: int

    def log_prob(self, y: Array) -> Array:
        """(B,) emulated log posterior of straightened coordinates (B, d)."""
        return straightened(self.emulated.log_prob, self.shear, 1.0, y)


def emulate(
    posterior: Posterior,
    found: MapResult,
    linear: Sequence[LinearGroup],
    rng: np.random.Generator,
    settings: EmulationSettings | None = None,
    ensembles: int = 2,
    report: Callable[[float, float, str], None] | None = None,
) -> Emulation:
    """Emulator of a posterior whose groups are plants. linear: lag bases of its voltage recordings."""
    s = settings or EmulationSettings()
    say = report or (lambda *_: None)
    exact = remembering(posterior)
    design_rng, pilot_rng = rng.spawn(2)
    powers, pairs = powers_of(exact.names), mode_pairs(exact.names)
    draws = _normal_draws(exact, found, design_rng)
    wide = draws.mean(axis=0) + 1.4 * (draws - draws.mean(axis=0))
    points, values = np.empty((0, exact.dimension)), np.empty(0)
    order, error = 2, float("inf")
    emulated = exact
    pilot: Pilot | None = None
    largest = exact.model.dimension + (1 if exact.zeros else 0)
    for round_ in range(s.rounds):
        say(round_, s.rounds, f"{len(points)} simulations")
        tests = draws[design_rng.permutation(len(draws))[: s.tests]]
        got = exact.log_prob(tests)
        if round_:
            good = np.isfinite(got)
            error = float(np.std(got[good] - emulated.log_prob(tests[good]))) if good.sum() > 1 else float("inf")
        points, values = np.concatenate([points, tests]), np.concatenate([values, got])
        enough = round_ > 0 and error < s.error_nats
        if round_ and not enough and order == 2 and monomials(largest, 3) <= s.most_terms:
            order = 3
        for _ in range(4):
            short = int(1.7 * monomials(largest, order)) + 20 - int(_near(exact, values).sum())
            if short <= 0 or enough:
                break
            new = wide[design_rng.permutation(len(wide))[:short]]
            points, values = np.concatenate([points, new]), np.concatenate([values, exact.log_prob(new)])
        emulated = _fitted(exact, linear, points[_near(exact, values)], draws, order)
        if enough:
            break
        pilot = run_pilot(emulated.log_prob, draws, powers, pilot_rng, s.pilot, ensembles, pairs)
        draws, wide = pilot.draws, pilot.wide
    assert pilot is not None
    start = pilot.start(emulated.log_prob)
    return Emulation(exact, emulated, pilot.shear, start, pilot.proposal, error, len(points), order, round_ + 1)


def _near(exact: Posterior, values: Array) -> NDArray[np.bool_]:
    """Which simulated points (n,) are worth fitting to. Raises InputError where none has a finite density."""
    finite = np.isfinite(values)
    if not finite.any():
        raise InputError(
            f"{exact.model.name}: no simulation around the maximum has a finite density; fix a parameter that the "
            "recordings say nothing about, or take the effect out of the model"
        )
    return np.asarray(finite & (values > np.max(values[finite]) - 15.0 - 6.0 * exact.dimension))


def _fitted(
    exact: Posterior, linear: Sequence[LinearGroup], points: Array, draws: Array, order: int
) -> Posterior:
    groups: list[LinearGroup | BlockGroup] = []
    while order > 1 and monomials(exact.model.dimension, order) > 0.9 * len(points):
        order -= 1
    for g in exact.groups:
        if not isinstance(g, PlantGroup) or not g.fitted:
            groups.append(g)
            continue
        z = exact.model_part(points, g.specimen)
        zeros = exact.zeros_part(points)
        names = [p.name for p in g.fitted]
        inputs = g.inputs(exact.model, z)
        means = {n: g.simulate(g.record(n), inputs, zeros.get(n)) for n in names}
        base = base_of(exact.model, linear, g.specimen) if g.channel == "displacement" else None
        sigma, rho = exact.noise_part(draws, g.channel)
        groups.append(
            emulate_group(
                g, exact.model, base, Design(z, zeros, means), exact.model_part(draws, g.specimen),
                exact.zeros_part(draws), sigma, rho, order,
            )
        )
    return replace(exact, groups=tuple(groups))


def _normal_draws(exact: Posterior, found: MapResult, rng: np.random.Generator, n: int = 4000) -> Array:
    """Draws (n, d) of the normal approximation at the maximum, inside the prior."""
    covariance = gauss_newton_covariance(exact, found, rng)
    scale = np.sqrt(np.diag(covariance))
    factor = np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-10 * np.eye(len(scale))) * scale[:, None]
    kept, have, width = [], 0, 1.1
    for _ in range(60):
        x = found.x + width * rng.standard_normal((n, len(scale))) @ factor.T
        x = x[np.isfinite(exact.log_prior(x))]
        kept.append(x)
        have += len(x)
        if have >= n:
            break
        width *= 0.95
    return np.concatenate(kept)[:n]


def gauss_newton_covariance(exact: Posterior, found: MapResult, rng: np.random.Generator) -> Array:
    """Covariance (d, d) at the maximum from first differences of the block means and the prior's covariance.

    Second differences of the log density drown in what a simulation's last digits contribute; those of the response
    do not, and what they give is positive definite.
    """
    k = exact.zero_start + len(exact.zeros)
    prior = np.cov(exact.prior_draws(4000, rng).T)
    spread = np.sqrt(np.diag(prior))
    curvature = -np.diag(found.hessian)
    bent = np.isfinite(curvature) & (curvature > 0)
    step = np.where(bent, 1.0 / np.sqrt(np.where(bent, curvature, 1.0)), 0.01 * spread)
    step = np.clip(step, 1e-6 * spread, 0.2 * spread)
    precision = np.linalg.inv(prior + 1e-10 * np.diag(spread**2))
    moved = np.concatenate([found.x + sign * np.diag(step)[:k] for sign in (1.0, -1.0)] + [found.x[None]])
    for g in exact.groups:
        if not isinstance(g, PlantGroup) or not g.fitted:
            continue
        sigma, rho = exact.noise_part(found.x[None], g.channel)
        zeros = exact.zeros_part(moved)
        inputs = g.inputs(exact.model, exact.model_part(moved, g.specimen))
        total = np.zeros((k + 1, k + 1))
        for p in g.fitted:
            record = g.record(p.name)
            X = g.simulate(record, inputs, zeros.get(p.name))
            plus, minus, centre = X[:k], X[k : 2 * k], X[2 * k]
            plus, minus = (np.where(np.isfinite(x), x, centre) for x in (plus, minus))
            J = np.concatenate([(plus - minus) / (2 * step[:k, None]), centre[None]])
            total += projected_gram(record, J, float(sigma[0]), float(rho[0, record.rate]), g.quantisation_variance)[0]
        A, b = total[:k, :k], total[:k, k]
        if g.gain_sd > 0:
            A = A - np.outer(b, b) / (total[k, k] + 1.0 / g.gain_sd**2)
        precision[:k, :k] += A
    precision[k:, k:] += _noise_precision(exact, found.x, step[k:], k)
    scale = np.sqrt(np.diag(precision))
    eig, vec = np.linalg.eigh(precision / np.outer(scale, scale))
    return np.asarray((vec / np.maximum(eig, 1e-9)) @ vec.T / np.outer(scale, scale))


def _noise_precision(exact: Posterior, x: Array, step: Array, k: int) -> Array:
    """Minus the second differences (n, n) of the log likelihood over the noise's coordinates, which start at k."""
    n = len(step)
    unit = np.zeros((n, len(x)))
    unit[np.arange(n), k + np.arange(n)] = step
    points = [x]
    for i in range(n):
        points += [x + unit[i], x - unit[i]]
    pairs = [(i, j) for i in range(n) for j in range(i)]
    for i, j in pairs:
        points += [x + unit[i] + unit[j], x - unit[i] - unit[j]]
    v = exact.log_likelihood(np.array(points))
    H = np.zeros((n, n))
    for i in range(n):
        H[i, i] = v[1 + 2 * i] + v[2 + 2 * i] - 2 * v[0]
    for m, (i, j) in enumerate(pairs):
        both = v[1 + 2 * n + 2 * m] + v[2 + 2 * n + 2 * m] - 2 * v[0]
        H[i, j] = H[j, i] = 0.5 * (both - H[i, i] - H[j, j])
    H = -H / np.outer(step, step)
    eig, vec = np.linalg.eigh(H) if np.all(np.isfinite(H)) else (np.ones(n), np.eye(n))
    return np.asarray((vec * np.maximum(eig, 0.0)) @ vec.T)

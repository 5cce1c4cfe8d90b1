"""Sequential Monte Carlo from one posterior to the next (IBIS, Chopin 2002, doi:10.1093/biomet/89.3.539).

Between two posteriors the likelihood of the new block is raised from 0 to 1 in steps that keep the effective sample
size at half (Del Moral, Doucet & Jasra 2006, doi:10.1111/j.1467-9868.2006.00553.x). Each step but the last ends in
resampling and in moves that leave its density as it is: along differences between particles as they lay before the
moves, a walk as wide as they lie, and proposals from a mixture that is fitted to them. They go on until the
particles have forgotten where they came from (Dau & Chopin 2022, doi:10.1111/rssb.12475, in the spirit of).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..errors import BayesDEAError, InputError
from ..fit.mixture import Mixture, fit_mixture
from ..fit.reweigh import systematic

Array = NDArray[np.float64]
Density = Callable[[Array], Array]


@dataclass(frozen=True)
class SequentialSettings:
    """particles; ess_share: below it particles are resampled and moved; forget: largest correlation with where they
    were before, at the end of an update; on the way there a rougher one is enough."""

    particles: int = 2000
    ess_share: float = 0.5
    forget: float = 0.15
    forget_on_the_way: float = 0.5
    max_sweeps: int = 40
    least_sweeps: int = 3


@dataclass(frozen=True)
class Particles:
    """Weighted draws: x (N, d), log weights (N,), normalised; log prior and log likelihood (N,) of each."""

    x: Array
    log_weight: Array
    log_prior: Array
    log_likelihood: Array

    @property
    def weights(self) -> Array:
        """(N,), which add up to one."""
        return np.asarray(np.exp(self.log_weight))

    @property
    def effective(self) -> float:
        """Effective sample size of the weights."""
        return float(np.exp(-logsumexp(2 * self.log_weight)))


@dataclass(frozen=True)
class Advance:
    """New particles, log p(block | blocks before), steps of the likelihood's exponent, sweeps of moves."""

    particles: Particles
    log_evidence: float
    steps: int
    sweeps: int
    acceptance: float


def begin(draws: Array, log_prior: Density) -> Particles:
    """Equally weighted particles (N, d) before any data."""
    n = len(draws)
    return Particles(draws, np.full(n, -np.log(n)), log_prior(draws), np.zeros(n))


def advance(
    now: Particles,
    log_prior: Density,
    old: Density,
    new: Density,
    rng: np.random.Generator,
    settings: SequentialSettings,
) -> Advance:
    """Particles of prior x new from those of prior x old; old, new: log likelihoods, (n, d) -> (n,).

    Raises BayesDEAError where no particle can explain the new block at all.
    """
    n = len(now.x)
    x, log_w, prior, before = now.x, now.log_weight, now.log_prior, now.log_likelihood
    after = _finite(new(x))
    evidence, exponent = 0.0, 0.0
    steps = sweeps = 0
    rates: list[float] = []
    while True:
        gain = after - before
        if not np.any(np.isfinite(gain)):
            raise BayesDEAError("no draw of the posterior so far can explain the new samples at all; check geometry "
                                "and units in campaign.toml, and what --device says of columns and units")
        step = _step(log_w, gain, 1.0 - exponent, settings.ess_share * n)
        weighted = log_w + step * gain
        total = float(logsumexp(weighted))
        evidence += total
        log_w = weighted - total
        exponent += step
        steps += 1
        done = exponent >= 1.0 - 1e-12
        if done and np.exp(-logsumexp(2 * log_w)) >= settings.ess_share * n:
            break
        keep = systematic(np.exp(log_w), n, rng)
        x, prior, before, after = x[keep], prior[keep], before[keep], after[keep]
        log_w = np.full(n, -np.log(n))
        limit = settings.forget if done else settings.forget_on_the_way
        x, prior, before, after, made, rate = _move(x, prior, before, after, exponent, log_prior, old, new, rng,
                                                    settings, limit)
        sweeps += made
        rates.append(rate)
        if done:
            break
    return Advance(Particles(x, log_w, prior, after), evidence, steps, sweeps, float(np.mean(rates)) if rates else 0.0)


def spread_out(x: Array, log_prior: Density, log_likelihood: Density, rng: np.random.Generator,
               settings: SequentialSettings) -> Array:
    """Draws (n, d) that may repeat each other, moved until they have forgotten it; their density stays."""
    likelihood = _finite(log_likelihood(x))
    return _move(x, log_prior(x), likelihood, likelihood, 1.0, log_prior, log_likelihood, log_likelihood, rng, settings,
                 settings.forget)[0]


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, -np.inf)


def _step(log_w: Array, gain: Array, left: float, wanted: float) -> float:
    """Largest step of the exponent that keeps the effective sample size."""
    def effective(step: float) -> float:
        w = log_w + np.where(np.isfinite(gain), step * gain, -np.inf)
        return float(np.exp(2 * logsumexp(w) - logsumexp(2 * w)))

    if effective(left) >= wanted:
        return left
    low, high = 0.0, left
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= wanted else (low, middle)
        if high - low < 1e-3 * high:
            break
    # the start itself may lie below what is wanted: a small step, and resampling mends it
    return max(low, min(left, 1e-6))


def _move(x: Array, prior: Array, before: Array, after: Array, exponent: float, log_prior: Density, old: Density,
          new: Density, rng: np.random.Generator, s: SequentialSettings, limit: float
          ) -> tuple[Array, Array, Array, Array, int, float]:
    start = x.copy()
    spread = start.std(axis=0) + 1e-300
    mixture = _mixture(x, rng)
    density = prior + exponent * after + (1 - exponent) * before if exponent < 1 else prior + after
    accepted: list[float] = []
    sweep = 0
    for sweep in range(1, s.max_sweeps + 1):
        proposed, ratio = _propose(x, start, mixture, rng)
        p_prior = log_prior(proposed)
        good = np.isfinite(p_prior) & np.all(np.isfinite(proposed), axis=1)
        p_after = np.full(len(x), -np.inf)
        p_before = np.full(len(x), -np.inf)
        if good.any():
            p_after[good] = _finite(new(proposed[good]))
            p_before[good] = _finite(old(proposed[good])) if exponent < 1 else p_after[good]
        with np.errstate(invalid="ignore"):
            p_density = p_prior + exponent * p_after + (1 - exponent) * p_before if exponent < 1 else p_prior + p_after
            yes = np.log(rng.random(len(x))) < np.where(np.isfinite(p_density), p_density - density + ratio, -np.inf)
        x = np.where(yes[:, None], proposed, x)
        prior, after = np.where(yes, p_prior, prior), np.where(yes, p_after, after)
        before, density = np.where(yes, p_before, before), np.where(yes, p_density, density)
        accepted.append(float(yes.mean()))
        if sweep >= s.least_sweeps:
            together = np.mean((x - x.mean(axis=0)) * (start - start.mean(axis=0)), axis=0)
            if np.max(np.abs(together) / (spread * (x.std(axis=0) + 1e-300))) < limit:
                break
    return x, prior, before, after, sweep, float(np.mean(accepted))


def _mixture(x: Array, rng: np.random.Generator) -> Mixture | None:
    try:
        return fit_mixture(x, rng, (1, 2, 4))
    except (InputError, np.linalg.LinAlgError):
        return None  # too few different particles: differential evolution alone


def _propose(x: Array, start: Array, mixture: Mixture | None, rng: np.random.Generator) -> tuple[Array, Array]:
    """New points (n, d), and the logarithm of the ratio that makes up for a proposal that is not symmetric."""
    n, d = x.shape
    kind = rng.random()
    if mixture is None or kind < 0.3:
        return _differential(x, start, rng), np.zeros(n)
    if kind < 0.65:
        return mixture.walk(x, rng, 2.38 / np.sqrt(d) * float(rng.choice((1.0, 0.6, 0.25))))
    wide = Mixture(mixture.weights, mixture.means, 1.15 * mixture.roots)
    proposed = wide.draw(n, rng)
    return proposed, wide.log_density(x) - wide.log_density(proposed)


def _differential(x: Array, others: Array, rng: np.random.Generator) -> Array:
    """Steps along the difference of two others (ter Braak 2006, doi:10.1007/s11222-006-8769-1)."""
    n, d = x.shape
    a, b = rng.permutation(n), rng.permutation(n)
    scale = 2.38 / np.sqrt(2 * d) * np.where(rng.random((n, 1)) < 0.1, np.sqrt(2 * d) / 2.38, 1.0)
    scale = scale * rng.choice((1.0, 0.5), size=(n, 1))
    return x + scale * (others[a] - others[b]) + 1e-6 * others.std(axis=0) * rng.standard_normal((n, d))

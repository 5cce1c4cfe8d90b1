"""From draws of one density to draws of another, with the ratio of their integrals: annealed populations.

Sequential Monte Carlo (Del Moral, Doucet & Jasra 2006, doi:10.1111/j.1467-9868.2006.00553.x) along a^(1-t) b^t: the
steps of t keep a share of the effective size, particles are resampled and moved by differential evolution (ter Braak
2006, doi:10.1007/s11222-006-8769-1) at each. Several populations go their way without knowing of each other; the
scatter of what they find is the standard error. For posteriors with many places or curved valleys, as networks with
more elements than the recordings show have them, where one proposal does not cover everything.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from .straighten import Straight

Array = NDArray[np.float64]
#: nats within which two populations agree, and how much wider than four they know their error
_AGREE, _TWO_POPULATIONS = 3.0, 1.5
LogProb = Callable[[Array], Array]


@dataclass(frozen=True)
class AnnealSettings:
    """populations, particles: of each; keep: share of the effective size that a step of t leaves; moves: at each step.

    most_stages: of a population; one that at the pace of its last `patience` stages would not arrive in as many gives
    up, and so do all where the first one does. good_se: standard error (nats) of the log ratio that counts as settled.
    enough_below: where the first two both find less than this, and agree to some nats, there are no more: what is far
    behind need not be known to a tenth.
    """

    populations: int = 4
    particles: int = 600
    keep: float = 0.6
    moves: int = 16
    last_moves: int = 48
    most_stages: int = 120
    patience: int = 20
    good_se: float = 0.2
    enough_below: float = -np.inf


#: for densities of which every value is a simulation
QUICK = AnnealSettings(populations=3, particles=400, moves=8, last_moves=16)


@dataclass(frozen=True)
class Annealed:
    """Log of integral(b)/integral(a), its standard error over populations, draws (n, d) of b."""

    log_ratio: float
    se: float
    draws: Array = field(repr=False)
    settled: bool
    evaluations: int


def anneal(
    start: Callable[[int, np.random.Generator], Array],
    log_a: LogProb,
    log_b: LogProb,
    rng: np.random.Generator,
    settings: AnnealSettings | None = None,
) -> Annealed:
    """Carry draws of a (`start(n, rng)` gives (n, d)) to b. Densities are vectorised, not normalised, -inf for none."""
    s = settings or AnnealSettings()
    ratios, draws, evaluations = [], [], 0
    for child in rng.spawn(s.populations):
        ratio, x, count = _population(start, log_a, log_b, child, s)
        evaluations += count
        if np.isfinite(ratio):
            ratios.append(ratio)
            draws.append((ratio, x))
        elif not ratios:
            break
        if len(ratios) == 2 and max(ratios) < s.enough_below and abs(ratios[0] - ratios[1]) < _AGREE:
            break
    if not ratios:
        x = start(s.particles, rng)
        return Annealed(float("nan"), float("nan"), x, False, evaluations)
    r = np.array(ratios)
    value = float(logsumexp(r) - np.log(len(r)))
    weight = np.exp(r - r.max())
    se = float(np.std(weight, ddof=1) / weight.mean() / np.sqrt(len(r))) if len(r) > 1 else float("nan")
    if len(r) == 2:
        se *= _TWO_POPULATIONS  # 84 % quantiles of Student's t: one degree of freedom over three
    # every population stands for the integral that it found
    n = s.particles * len(draws)
    counts = np.maximum(np.round(n * weight / weight.sum()).astype(int), 0)
    parts = [x[rng.integers(len(x), size=c)] if c > len(x) else x[:c] for (_, x), c in zip(draws, counts, strict=True)]
    settled = len(r) == s.populations and len(r) > 1 and se < s.good_se
    return Annealed(value, se, rng.permutation(np.concatenate(parts)), bool(settled), evaluations)


def _population(
    start: Callable[[int, np.random.Generator], Array], log_a: LogProb, log_b: LogProb, rng: np.random.Generator,
    s: AnnealSettings,
) -> tuple[float, Array, int]:
    n = s.particles
    x = start(n, rng)
    a, b = _quiet(log_a, x), _quiet(log_b, x)
    t, total, count = 0.0, 0.0, n
    scale, straight = 1.0, Straight.of(x)
    path = [0.0]
    for _ in range(s.most_stages):
        step = _step(b - a, t, s.keep)
        if not np.isfinite(b).any():
            return float("nan"), x, count
        weight = step * np.where(np.isfinite(b), b - np.where(np.isfinite(a), a, 0.0), -np.inf)
        total += float(logsumexp(weight) - np.log(n))
        t = min(1.0, t + step)
        p = np.exp(weight - logsumexp(weight))
        index = np.minimum(np.searchsorted(np.cumsum(p), (rng.random() + np.arange(n)) / n), n - 1)
        x, a, b = x[index], a[index], b[index]
        done = t >= 1.0 - 1e-12
        path.append(t)
        if not done and _hopeless(path, s):
            return float("nan"), x, count
        for k in range(s.last_moves if done else s.moves):
            # straight lines between particles leave a curved valley: made straight, they follow it
            if k % 8 == 0:
                straight = Straight.of(x)
            y = straight.forward(x)
            x, a, b, accepted = _move(x, y, straight, a, b, t, log_a, log_b, rng, scale)
            count += n
            scale = float(np.clip(scale * np.exp(accepted - 0.25), 0.05, 2.0))
        if done:
            return total, rng.permutation(x), count
    return float("nan"), x, count


def _hopeless(path: list[float], s: AnnealSettings) -> bool:
    """Whether t would not be one after all stages, however the steps grow: by the same factor as in the last ones."""
    if len(path) <= s.patience + 1:
        return False
    growth = np.log(path[-1] / path[-1 - s.patience]) / s.patience
    return bool(growth * (s.most_stages + 1 - len(path)) < -np.log(path[-1]))


def stirred(log_b: LogProb, x: Array, rng: np.random.Generator, particles: int = 400, moves: int = 30) -> Array:
    """Draws (particles, d) of a density from draws x (n, d) that may not reach its tips, by moves that leave it as is.

    Particles without a density are left out.
    """
    x = x[rng.integers(len(x), size=particles)]
    b = _quiet(log_b, x)
    x, b = x[np.isfinite(b)], b[np.isfinite(b)]
    if len(x) < 10 * x.shape[1]:
        return x
    scale, straight = 1.0, Straight.of(x)
    for k in range(moves):
        if k % 8 == 0:
            straight = Straight.of(x)
        x, _, b, accepted = _move(x, straight.forward(x), straight, b, b, 1.0, log_b, log_b, rng, scale)
        scale = float(np.clip(scale * np.exp(accepted - 0.25), 0.05, 2.0))
    return x


def _step(difference: Array, t: float, keep: float) -> float:
    """The largest step of t that leaves a share of the effective size."""
    d = np.where(np.isfinite(difference), difference, -np.inf)
    left = 1.0 - t

    def effective(step: float) -> float:
        w = step * d
        return float(np.exp(2 * logsumexp(w) - logsumexp(2 * w))) / len(d)

    if not np.isfinite(d).any() or effective(left) >= keep:
        return left
    low, high = 0.0, left
    # particles where b has no density are lost at the first step, however small
    goal = keep * float(np.mean(np.isfinite(d)))
    for _ in range(40):
        middle = 0.5 * (low + high)
        if effective(middle) >= goal:
            low = middle
        else:
            high = middle
    return max(low, 1e-12 * left)


def _move(
    x: Array, y: Array, straight: Straight, a: Array, b: Array, t: float, log_a: LogProb, log_b: LogProb,
    rng: np.random.Generator, scale: float,
) -> tuple[Array, Array, Array, float]:
    """Every particle along the difference of two others; one time in ten the whole of it, from place to place."""
    n, d = x.shape
    first = (np.arange(n) + rng.integers(1, n, n)) % n
    second = (np.arange(n) + rng.integers(1, n, n)) % n
    whole = np.asarray(rng.random(n) < 0.1)
    gamma = np.where(whole, 1.0, scale * 2.38 / np.sqrt(2 * d) * np.exp(0.3 * rng.standard_normal(n)))
    # some moves change a few coordinates alone: in many dimensions a step of all is mostly refused
    mask = (rng.random((n, d)) < rng.choice([0.3, 1.0], n)[:, None]) | whole[:, None]
    bent = rng.random() < 0.5
    z = y if bent else x
    trial = z + gamma[:, None] * (z[first] - z[second]) * mask
    trial += 1e-5 * z.std(axis=0) * rng.standard_normal((n, d))
    trial = straight.inverse(trial) if bent else trial
    new_b = _quiet(log_b, trial)
    new_a = new_b if t >= 1.0 else _quiet(log_a, trial)
    now = _mixed(a, b, t)
    gain = _mixed(new_a, new_b, t) - now
    ok = np.log(rng.random(n)) < gain
    accepted = float(ok[~whole].mean()) if (~whole).any() else 0.25
    return np.where(ok[:, None], trial, x), np.where(ok, new_a, a), np.where(ok, new_b, b), accepted


def _mixed(a: Array, b: Array, t: float) -> Array:
    with np.errstate(invalid="ignore"):
        out = (1 - t) * a + t * b if t < 1.0 else b
    return np.where(np.isfinite(out), out, -np.inf)


def _quiet(f: LogProb, x: Array) -> Array:
    with np.errstate(all="ignore"):
        value = np.asarray(f(x), float)
    return np.where(np.isfinite(value), value, -np.inf)

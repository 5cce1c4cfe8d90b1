"""Simulation-based calibration: rank statistics and their simultaneous ECDF bands.

If a pipeline is right, the rank of the true parameter among posterior draws is uniform (Talts et al.
2018, arXiv 1804.06788). The ECDF of the ranks then stays within a simultaneous band with a known
probability (Sailynoja, Buerkner & Vehtari 2022, doi 10.1007/s11222-022-10090-6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import InputError

Array = NDArray[np.float64]


def sbc_ranks(draws: ArrayLike, truth: ArrayLike, rng: np.random.Generator,
              keep: int | None = None) -> NDArray[np.int64]:
    """Rank of each true value among its posterior draws: 0..L, uniform if all is right.

    Parameters
    ----------
    draws : shape (n_sims, n_draws) or (n_sims, n_draws, n_parameters).
    truth : shape (n_sims,) or (n_sims, n_parameters).
    rng : breaks ties at random (parameters that take few values).
    keep : thin to that many evenly spaced draws. Draws of a chain are dependent, which piles ranks up at
        both ends: keep no more than the smallest effective sample size.

    Raises
    ------
    InputError : shapes do not match, a value is not finite, or more draws are to be kept than there are.
    """
    x, true = np.asarray(draws, dtype=float), np.asarray(truth, dtype=float)
    if x.ndim not in (2, 3) or true.shape != x.shape[:1] + x.shape[2:]:
        raise InputError(f"ranks: draws of shape {x.shape} and true values of shape {true.shape} do not "
                         "match; give (simulations, draws[, parameters]) and (simulations[, parameters])")
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(true))):
        raise InputError("ranks: draws or true values are not finite; leave simulations that failed out and "
                         "report how many there were")
    if keep is not None:
        if not 1 <= keep <= x.shape[1]:
            raise InputError(f"ranks: {keep} draws are to be kept of {x.shape[1]}")
        x = x[:, np.linspace(0, x.shape[1] - 1, keep).round().astype(int)]
    below = np.sum(x < true[:, None], axis=1)
    ties = np.sum(x == true[:, None], axis=1)
    return below + rng.integers(0, ties + 1)


@dataclass(frozen=True)
class EcdfBand:
    """Simultaneous band of the ECDF of n_sims ranks in 0..n_draws; shapes (k,).

    At rank[i], z[i] = (rank[i] + 1)/(n_draws + 1) is the expected share of ranks <= rank[i]; the share seen
    stays within lower[i]..upper[i] at all i at once with probability `achieved` >= prob (counts are whole
    numbers, so it cannot be met exactly).
    """

    rank: NDArray[np.int64]
    z: Array
    lower: Array
    upper: Array
    prob: float
    achieved: float
    gamma: float  # pointwise tail probability, both sides


def ecdf_band(n_sims: int, n_draws: int, prob: float = 0.95, n_points: int = 100) -> EcdfBand:
    """Band from pointwise binomial intervals, widened until they hold simultaneously.

    The probability that the count path stays inside is computed exactly, step by step: given the count at
    one point the next increment is binomial (the optimisation method of the paper). No random numbers.

    Parameters
    ----------
    n_sims, n_draws : number of simulations; draws a rank was counted among (ranks are 0..n_draws).
    prob : simultaneous probability.
    n_points : largest number of ranks at which the ECDF is looked at.

    Raises
    ------
    InputError : numbers out of range.
    """
    if n_sims < 1 or n_draws < 1 or n_points < 1 or not 0 < prob < 1:
        raise InputError(f"ECDF band: n_sims = {n_sims}, n_draws = {n_draws}, n_points = {n_points}, "
                         f"prob = {prob}; counts must be >= 1 and the probability inside (0, 1)")
    return _ecdf_band(int(n_sims), int(n_draws), float(prob), int(n_points))


@lru_cache(maxsize=64)
def _ecdf_band(n_sims: int, n_draws: int, prob: float, n_points: int) -> EcdfBand:
    from scipy.stats import binom

    k = min(n_points, n_draws)
    ranks = np.unique(np.linspace(0, n_draws - 1, k).round().astype(np.int64))
    z = (ranks + 1) / (n_draws + 1)

    def limits(gamma: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        low, high = binom.ppf(gamma / 2, n_sims, z), binom.ppf(1 - gamma / 2, n_sims, z)
        return np.asarray(low, dtype=np.int64), np.asarray(high, dtype=np.int64)

    # bisection in log gamma; Bonferroni is the lower end, one point alone the upper
    low, high = math.log((1 - prob) / (2 * ranks.size)), math.log(1 - prob)
    achieved = _probability_inside(n_sims, z, *limits(math.exp(low)))
    if _probability_inside(n_sims, z, *limits(math.exp(high))) >= prob:
        low = high
    else:
        for _ in range(18):
            middle = 0.5 * (low + high)
            inside = _probability_inside(n_sims, z, *limits(math.exp(middle)))
            if inside >= prob:
                low, achieved = middle, inside
            else:
                high = middle
    a, b = limits(math.exp(low))
    if low == high:
        achieved = _probability_inside(n_sims, z, a, b)
    out = (ranks, z, a / n_sims, b / n_sims)
    for array in out:
        array.setflags(write=False)
    return EcdfBand(*out, prob=prob, achieved=achieved, gamma=math.exp(low))


def _probability_inside(n: int, z: Array, lower: NDArray[np.int64], upper: NDArray[np.int64]) -> float:
    """Probability that the counts of n uniform values at or below z_i lie in lower_i..upper_i for all i."""
    from scipy.special import gammaln

    log_factorial = gammaln(np.arange(n + 2) + 1.0)
    counts = np.array([0])
    chance = np.array([1.0])
    before = 0.0
    for zi, a, b in zip(z, lower, upper, strict=True):
        p = (zi - before) / (1 - before)
        new = np.arange(a, b + 1)
        step = new[None, :] - counts[:, None]
        left = (n - counts)[:, None]
        allowed = (step >= 0) & (step <= left)
        s = np.where(allowed, step, 0)
        log_pmf = (log_factorial[left] - log_factorial[s] - log_factorial[left - s]
                   + s * math.log(p) + (left - s) * math.log1p(-p))
        chance = chance @ np.where(allowed, np.exp(log_pmf), 0.0)
        counts, before = new, zi
    return float(chance.sum())


def ecdf(ranks: ArrayLike, band: EcdfBand) -> Array:
    """Share of ranks at or below each rank of the band, shape (k,)."""
    r = np.sort(np.asarray(ranks).ravel())
    return np.searchsorted(r, band.rank, side="right") / r.size


def ecdf_inside(ranks: ArrayLike, n_draws: int, prob: float = 0.95) -> tuple[bool, float]:
    """Whether the ECDF of ranks of one parameter stays inside its simultaneous band, and how far it goes.

    The second value is the largest distance from the expected share in units of the band's half-width on that
    side: above 1 is outside. For several parameters at once lower 1 - prob accordingly (Bonferroni).

    Raises
    ------
    InputError : no ranks, or ranks outside 0..n_draws.
    """
    r = np.asarray(ranks)
    if r.size == 0 or r.min() < 0 or r.max() > n_draws:
        raise InputError(f"ranks must lie in 0..{n_draws} and there must be some; "
                         "was n_draws the number of draws that were kept?")
    band = ecdf_band(r.size, n_draws, prob)
    seen = ecdf(r, band)
    distance = seen - band.z
    half = np.where(distance >= 0, band.upper - band.z, band.z - band.lower)
    # counts are whole: half a count of slack keeps a path that lies on the band inside it
    worst = float(np.max(np.abs(distance) / np.maximum(half, 0.5 / r.size)))
    inside = bool(np.all((seen >= band.lower - 1e-12) & (seen <= band.upper + 1e-12)))
    return inside, worst

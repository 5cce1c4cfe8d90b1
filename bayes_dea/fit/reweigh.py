"""Draws of an approximate density made draws of the exact one: smoothed importance weights, systematic resampling.

Vehtari, Simpson, Gelman, Yao & Gabry, Pareto smoothed importance sampling (arXiv:1507.02646): above k = 0.7 the weights
cannot be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .diagnostics import arviz

Array = NDArray[np.float64]
#: largest Pareto k of weights that are worth using; times the mean that the largest weight may be whatever k: the
#: shape of the tail of weights that are all about one says nothing
LARGEST_K, _EVEN = 0.7, 2.0
#: share of the draws that has to have a weight at all
_MOST = 0.5


@dataclass(frozen=True)
class Weights:
    """log_ratio (n,): exact minus approximate log density; weights (n,) sum to one; sd: of the log ratio, in nats."""

    log_ratio: Array = field(repr=False)
    weights: Array = field(repr=False)
    pareto_k: float
    sd: float

    @property
    def usable(self) -> bool:
        """Whether resampling with the weights gives draws of the exact density."""
        if self.pareto_k < LARGEST_K:
            return True
        good = np.isfinite(self.log_ratio)
        if good.mean() <= _MOST or not np.isfinite(self.sd):
            return False
        return bool(np.max(self.log_ratio[good]) - self.log_mean < np.log(_EVEN))

    @property
    def effective(self) -> float:
        """1/sum of squared weights: how many draws are left."""
        return float(1.0 / np.sum(self.weights**2))

    @property
    def log_mean(self) -> float:
        """Log of the mean ratio: what the approximate log evidence is short of."""
        top = float(np.max(self.log_ratio))
        return top + float(np.log(np.mean(np.exp(self.log_ratio - top))))


def smoothed_weights(log_ratio: Array) -> Weights:
    """Weights of log density ratios (n,); a ratio that is not finite has no weight."""
    good = np.isfinite(log_ratio)
    ratio = np.where(good, log_ratio, -np.inf)
    lost = float(np.mean(~good))
    if good.sum() < 10:
        return Weights(ratio, np.full(len(ratio), 1.0 / len(ratio)), float("inf"), float("inf"))
    smooth, k = arviz().psislw(ratio[good] - ratio[good].max())
    w = np.zeros(len(ratio))
    w[good] = np.exp(np.asarray(smooth))
    # draws where the exact density is zero are no fault of the tail, but many of them are one of the approximation
    worst = float(np.max(k)) if lost < 1.0 - _MOST else float("inf")
    return Weights(ratio, w / w.sum(), worst, float(np.std(ratio[good])))


def systematic(weights: Array, n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices (n,) in rising order, each drawn about n times its weight: never off by one or more."""
    edges = np.cumsum(weights)
    at = (rng.random() + np.arange(n)) / n * edges[-1]
    return np.minimum(np.searchsorted(edges, at, side="right"), len(weights) - 1)

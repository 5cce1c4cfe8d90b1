"""Importance resampling with Pareto-smoothed weights (Vehtari et al. 2024, arXiv:1507.02646)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_dea.errors import InputError
from bayes_dea.fit.diagnostics import arviz
from bayes_dea.fit.reweigh import LARGEST_K, systematic

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ImportanceResult:
    """log_weights: (n,) smoothed, normalised; k_hat: Pareto shape, to be trusted below 0.7 only; ess:
    1 / sum w^2; log_mean_weight: log of the mean raw weight (the log evidence when the proposal is
    normalised); draws: (m, d) resampled with equal weights; index: (m,) rows they came from."""

    log_weights: Array = field(repr=False)
    k_hat: float
    ess: float
    log_mean_weight: float
    draws: Array = field(repr=False)
    index: NDArray[np.int64] = field(repr=False)

    @property
    def reliable(self) -> bool:
        """k-hat below 0.7."""
        return self.k_hat < LARGEST_K


def importance_resample(
    log_target: Array, log_proposal: Array, draws: Array, n: int, rng: np.random.Generator
) -> ImportanceResult:
    """Reweight draws of a proposal to a target and resample n of them.

    log_target, log_proposal: (m,) at the draws, normalised or not; draws: (m, d). Weights where the target is
    -inf or nan are zero. Systematic resampling, in random order. Raises InputError when the shapes differ or
    fewer than 25 draws have a weight.
    """
    draws = np.asarray(draws, float)
    target, proposal = np.asarray(log_target, float), np.asarray(log_proposal, float)
    if target.shape != proposal.shape or target.shape != draws.shape[:1]:
        raise InputError(
            f"importance: {target.shape} target and {proposal.shape} proposal values "
            f"for {len(draws)} draws"
        )
    if not np.all(np.isfinite(proposal)):
        raise InputError("importance: proposal density is not finite at its own draws; wrong density?")
    with np.errstate(invalid="ignore"):
        raw = np.where(np.isfinite(target), target - proposal, -np.inf)
    alive = np.flatnonzero(np.isfinite(raw))
    if len(alive) < 25:
        raise InputError(f"importance: {len(alive)} of {len(raw)} draws lie in the target's support; need 25")
    smooth, k = arviz().psislw(raw[alive])
    log_weights = np.full(len(raw), -np.inf)
    log_weights[alive] = smooth - logsumexp(smooth)
    weights = np.exp(log_weights)
    index = rng.permutation(systematic(weights, n, rng))
    return ImportanceResult(
        log_weights, float(k), float(1.0 / np.sum(weights**2)), float(logsumexp(raw) - np.log(len(raw))),
        draws[index], index,
    )  # fmt: skip

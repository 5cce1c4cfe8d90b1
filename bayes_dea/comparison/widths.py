"""What an evidence becomes when every prior of the model is made half or twice as wide.

By reweighting the draws: Z'/Z is the posterior mean of new prior over old prior (no further run). Noise priors are
the same for all models and stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..fit.reweigh import smoothed_weights
from ..likelihood.posterior import Posterior
from ..priors import Parameter, Prior

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Width:
    """Change of the log evidence (nats) when prior widths are multiplied by `factor`; trusted: Pareto k below 0.7."""

    factor: float
    change: float
    trusted: bool


def scaled_prior(prior: Prior, factor: float) -> Prior:
    """The same prior, `factor` times as wide about the same centre, in its coordinate; a constant stays."""
    if prior.family in ("lognormal", "normal"):
        return replace(prior, b=prior.b * factor)
    if prior.family == "uniform":
        centre, half = 0.5 * (prior.a + prior.b), 0.5 * factor * (prior.b - prior.a)
        return replace(prior, a=centre - half, b=centre + half)
    if prior.family == "loguniform":
        centre, half = 0.5 * math.log(prior.a * prior.b), 0.5 * factor * math.log(prior.b / prior.a)
        return replace(prior, a=math.exp(centre - half), b=math.exp(centre + half))
    return prior


def prior_width(posterior: Posterior, draws: Array, factor: float) -> Width:
    """Effect of other prior widths on the log evidence, from posterior draws (n, d)."""
    scaled: tuple[Parameter, ...] = tuple(
        replace(p, prior=scaled_prior(p.prior, factor)) for p in posterior.model.parameters
    )
    try:
        other = replace(posterior, model=replace(posterior.model, parameters=scaled))
        ratio = other.log_prior(draws) - posterior.log_prior(draws)
    except InputError:  # widths at which an order of parameters cannot be kept
        return Width(factor, float("nan"), False)
    w = smoothed_weights(ratio)
    # every draw outside the narrower prior is a zero, not a failure: it is part of the mean
    return Width(factor, w.log_mean, bool(w.pareto_k < 0.7 or w.sd < 1.0))

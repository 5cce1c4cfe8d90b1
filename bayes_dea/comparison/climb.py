"""To the maximum of a posterior whose every value is a simulation: Gauss-Newton steps from first differences.

The Hessian of a Newton step by second differences takes a simulation for every pair of coordinates and drowns in their
last digits; that of the response's first differences takes two for each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..emulation import gauss_newton_covariance
from ..find_map import MapResult
from ..likelihood.posterior import Posterior

Array = NDArray[np.float64]
_STEPS = 25
#: nats that a step is expected to gain, below which it was the last
_REACHED = 0.05
_LENGTHS = np.array([1.0, 0.6, 0.3, 0.1, 0.03, 0.01, 0.003])
#: of the step of a difference, in standard deviations
_SHARE = 0.3


def climb(
    x: Array, at: Callable[[Array], Posterior], rng: np.random.Generator, reached: float = _REACHED
) -> tuple[Array, Posterior]:
    """Maximum (d,) from x, and the posterior with its block reference there. x must have a finite density.

    at: the posterior with its reference moved to a point. reached: nats that a step is expected to gain, below which
    it was the last.
    """
    posterior = at(x)
    for _ in range(_STEPS):
        covariance = first_difference_covariance(posterior, x, rng)
        gradient = _gradient(posterior, x, np.sqrt(np.diag(covariance)))
        step = covariance @ gradient
        points = np.concatenate([x[None], x + _LENGTHS[:, None] * step])
        value = _finite(posterior.log_prob(points))
        best = int(np.argmax(value))
        x = points[best]
        # the reference moves to the maximum, and the maximum with it
        posterior = at(x)
        if best == 0 or 0.5 * float(gradient @ step) < reached:
            break
    return x, posterior


def first_difference_covariance(posterior: Posterior, x: Array, rng: np.random.Generator) -> Array:
    """Covariance (d, d) of the normal approximation at x."""
    unknown = np.full((x.size, x.size), np.nan)
    return gauss_newton_covariance(posterior, MapResult(x, float("nan"), unknown, 1, 1, 0, True), rng)


def _gradient(posterior: Posterior, x: Array, sd: Array) -> Array:
    """First differences (d,), one-sided at the end of the prior's support."""
    h = _SHARE * sd
    value = _finite(posterior.log_prob(np.concatenate([x[None], x + np.diag(h), x - np.diag(h)])))
    here, up, down = value[0], value[1 : 1 + x.size], value[1 + x.size :]
    both = np.isfinite(up) & np.isfinite(down)
    with np.errstate(invalid="ignore"):
        one = np.where(np.isfinite(up), up - here, np.where(np.isfinite(down), here - down, 0.0)) / h
        return np.asarray(np.where(both, (up - down) / (2 * h), one))


def _finite(v: Array) -> Array:
    return np.where(np.isfinite(v), v, -np.inf)

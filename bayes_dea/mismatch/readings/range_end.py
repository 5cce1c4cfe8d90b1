"""Readings that end with a sensor's range, their noise with them: what is expected of them, and how they scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]


def moments_above(mean: Array, sd: float) -> tuple[Array, Array]:
    """First and second moment (n,) of the part above zero of normal variables of means (n,)."""
    z = mean / sd
    share, density = ndtr(z), np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    return mean * share + sd * density, (mean * mean + sd * sd) * share + mean * sd * density


def expected_at_most(mean: Array, sd: float, limit: float) -> Array:
    """Mean (n,) of min(reading, limit) of normal readings of means (n,): noise takes some below, and none above."""
    return mean - moments_above(mean - limit, sd)[0]


def scatter_at_most(mean: Array, sd: float, limit: float) -> float:
    """RMS scatter of min(reading, limit) about its mean, over normal readings of means (n,)."""
    first, second = moments_above(mean - limit, sd)
    # the noise goes with the part cut off by E[e g(e)] = sd^2 E[g'(e)] (Stein)
    variance = sd**2 * (1.0 - 2.0 * ndtr((mean - limit) / sd)) + second - first**2
    return float(np.sqrt(np.mean(np.maximum(variance, 0.0))))

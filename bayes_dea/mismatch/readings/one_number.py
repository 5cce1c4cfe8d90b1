"""Where along one number beside a fit the evidence is highest: a search by few fits, each from the nearest known."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.refit import Fit, refit
from ..left_out import Repaired

#: nats that a parabola through three places may be off by
_SLACK = 10.0


@dataclass(frozen=True)
class Peak:
    """Where the evidence is highest, the sd of a Gaussian of its curvature there, and its log."""

    at: float
    sd: float
    height: float


@dataclass(frozen=True)
class Highest(Peak):
    """The peak, and the best fit that was made, at a number near by."""

    near: float
    fit: Fit


@dataclass(frozen=True)
class Sized:
    """A number beside a fit with its sd, the log evidence with it integrated out, and the fit with it."""

    mean: float
    sd: float
    log_evidence: float
    repaired: Repaired


def highest(
    fit: Fit, prior: NoisePrior, changed: Callable[[Problem, float], Problem], first: float, largest: float,
    beyond: float,
) -> Highest | None:
    """The peak along a number that is zero in a fit and positive else; None where it is zero, or surely not so high.

    changed: a problem, that of the fit, with the number. first: where is looked first, doubled up to the largest as
    long as that helps. beyond: log evidence that makes it worth a close look.
    """
    fits: dict[float, Fit | None] = {0.0: fit}

    def nearest(x: float) -> Fit:
        return min(((abs(v - x), f) for v, f in fits.items() if f is not None), key=lambda pair: pair[0])[1]

    def at(x: float) -> float:
        if x not in fits:
            near = nearest(x)
            fits[x] = refit(changed(fit.problem, x), near.q, near.noise, prior)
        found = fits[x]
        return -math.inf if found is None else found.log_evidence

    if not at(first) > at(0.0):
        return None
    step = first
    while step < largest and at(min(2.0 * step, largest)) > at(step):
        step = min(2.0 * step, largest)
    top = max(fits, key=at)
    digits = 4 - math.floor(math.log10(first))  # of places: what is nearer than that is the same
    for _ in range(2):
        order = sorted(fits)
        k = min(max(order.index(top), 1), len(order) - 2)
        peak = parabola(order[k - 1 : k + 2], list(map(at, order[k - 1 : k + 2])))
        if peak is None:
            return None
        middle = min(max(peak.at, 0.0), largest)
        if peak.height < beyond - _SLACK:
            return None
        for x in (middle, middle - 2.0 * peak.sd, middle + 2.0 * peak.sd):
            at(round(max(x, 0.0), digits))
        top = max(fits, key=at)
    near = sorted(sorted(fits, key=lambda v: abs(v - top))[:3])
    peak, best = parabola(near, list(map(at, near))), fits[top]
    return None if peak is None or best is None else Highest(peak.at, peak.sd, peak.height, top, best)


def parabola(at: Sequence[float], height: Sequence[float]) -> Peak | None:
    """The peak of a parabola through three places; None where it opens upwards, or nothing is known of one of them."""
    if not np.isfinite(height).all():
        return None
    # places of order one, so that the fit of micrometres is no worse than that of volts
    scale = max(abs(x) for x in at)
    a, b, c = np.polyfit(np.asarray(at) / scale, np.asarray(height), 2)
    if a >= 0.0:
        return None
    return Peak(float(-0.5 * b / a) * scale, float(math.sqrt(-0.5 / a)) * scale, float(c - 0.25 * b * b / a))

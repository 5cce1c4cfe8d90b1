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

#: nats that a parabola through three places may be off by, and the difference of two climbs between places
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


class Climb:
    """Fits along a number that is zero in a fit and positive else, each made once, from the nearest that is known.

    changed: a problem, that of the fit, with the number. first: where is looked first; largest: where last.
    """

    def __init__(
        self, fit: Fit, prior: NoisePrior, changed: Callable[[Problem, float], Problem], first: float, largest: float
    ) -> None:
        self._fit, self._prior, self._changed = fit, prior, changed
        self._first, self._largest = first, largest
        self._fits: dict[float, Fit | None] = {0.0: fit}

    def go_up(self) -> None:
        """From where is looked first on, doubled as long as that helps."""
        step = self._first
        if not self.at(step, coarse=True) > self.at(0.0):
            return
        while step < self._largest and self.at(min(2.0 * step, self._largest), coarse=True) > self.at(step):
            step = min(2.0 * step, self._largest)

    def keeps_up_with(self, other: Climb) -> bool:
        """About the top of a climb along a number nearly like it, above zero; whether it is no further below that than
        two such climbs differ between places. What is further below is no rival, and looked at no closer."""
        self._fits[other.top] = self._made(other.top, other.best, coarse=True)
        if self.at(other.top) < other.at(other.top) - _SLACK:
            return False
        for x in other.about_the_top():
            self.at(x)
        return True

    @property
    def top(self) -> float:
        """Where the best fit is."""
        return max(self._fits, key=self.at)

    @property
    def best(self) -> Fit:
        """That fit."""
        return self._fits[self.top] or self._fit

    def at(self, x: float, coarse: bool = False) -> float:
        """Log evidence there; coarse: far from an explanation not to a part of a nat."""
        if x not in self._fits:
            near = min(((abs(v - x), f) for v, f in self._fits.items() if f is not None), key=lambda pair: pair[0])[1]
            self._fits[x] = self._made(x, near, coarse)
        found = self._fits[x]
        return -math.inf if found is None else found.log_evidence

    def about_the_top(self) -> list[float]:
        """Three places, the top in their middle if it is not the last."""
        order = sorted(self._fits)
        k = min(max(order.index(self.top), 1), len(order) - 2)
        return order[k - 1 : k + 2]

    def _made(self, x: float, near: Fit, coarse: bool = False) -> Fit | None:
        return refit(self._changed(self._fit.problem, x), near.q, near.noise, self._prior, coarse=coarse)

    def peak(self, beyond: float) -> Highest | None:
        """The peak; None where the number is zero, or the peak surely not so high that it lies beyond this."""
        if self.top == 0.0:
            return None
        digits = 4 - math.floor(math.log10(self._first))  # of places: what is nearer than that is the same
        for _ in range(2):
            three = self.about_the_top()
            peak = parabola(three, list(map(self.at, three)))
            if peak is None or peak.height < beyond - _SLACK:
                return None
            middle = min(max(peak.at, 0.0), self._largest)
            for x in (middle, middle - 2.0 * peak.sd, middle + 2.0 * peak.sd):
                self.at(round(max(x, 0.0), digits))
        top = self.top
        near = sorted(sorted(self._fits, key=lambda v: abs(v - top))[:3])
        peak = parabola(near, list(map(self.at, near)))
        return None if peak is None else Highest(peak.at, peak.sd, peak.height, top, self.best)


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

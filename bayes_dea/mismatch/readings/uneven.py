"""Recordings of one sensor that scatter unlike each other where nothing moves.

A ripple of the supply, something that swings, a loose clamp: what is faster than the windows of the search, and no line
of the mains, looks like noise, and noise that grows with it excuses everything. But a sensor's noise is the same in
every recording at one rate; where it is not, something else is in it. A level that differs by some ten per cent is
still noise, as long as its colour is the same: what swings is more correlated from reading to reading than what a
sensor scatters by. What is averaged for a slower record scatters less, and is correlated otherwise: other rates say
nothing here (`assemble` warns of them).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from ...gauss_newton.reduced import Piece
from ...likelihood.prepare import Prepared, rate_classes

#: readings at rest from which on a recording is compared, and the ratio and standard errors that count
_LEAST, _RATIO, _ERRORS = 4096, 1.4, 8.0
#: ratio that counts whatever the colour, standard errors of the correlation by which it differs
_MUCH, _COLOUR = 2.0, 5.0


@dataclass(frozen=True)
class Uneven:
    """Two recordings and what each scatters by at rest (m); p_value of so different ones by chance."""

    noisy: str
    calm: str
    noisy_m: float
    calm_m: float
    p_value: float

    def note(self) -> str:
        """One line on it."""
        return (
            f"{self.noisy}: scatters by {1e6 * self.noisy_m:.3g} um where its input stands still, {self.calm} by "
            f"{1e6 * self.calm_m:.3g} um; noise of one sensor does not, so something swings or jumps there that is on "
            "no list; look at its spectrum at rest"
        )


def uneven_scatter(pieces: Sequence[Piece], resolution: float) -> Uneven | None:
    """The most and the least noisy recording of a displacement, where they differ by more than noise may.

    resolution: of the sensor (m): what is less than that is not claimed.
    """
    seen = [
        p.prepared for p in pieces if p.channel == "displacement" and p.prepared.quiet_n >= _LEAST
    ]
    rates = rate_classes(tuple(seen))
    alike = [[p for p in seen if rates.of(p) == k] for k in range(len(rates.steps_s))]
    pairs = sum(0.5 * len(some) * (len(some) - 1) for some in alike)
    found = [u for some in alike if (u := _most_unlike(some, resolution, pairs)) is not None]
    return min(found, key=lambda u: u.p_value, default=None)


def _most_unlike(seen: Sequence[Prepared], resolution: float, pairs: float) -> Uneven | None:
    """The same of recordings at one sampling rate; pairs: that were looked at in all."""
    if len(seen) < 2:
        return None
    order = sorted(seen, key=lambda p: p.quiet_sd)
    calm, noisy = order[0], order[-1]
    low, high = calm.quiet_sd, noisy.quiet_sd  # without lines of the mains
    # of correlated readings fewer are independent; what is slow may hide in the short windows of the calm one
    rho = float(np.clip(max(calm.quiet_rho, float(np.median([p.quiet_rho for p in seen]))), 0.0, 0.9999))
    error = math.sqrt(sum(0.5 / p.quiet_n for p in (calm, noisy)) * (1.0 + rho**2) / (1.0 - rho**2))
    if low <= 0.0 or high < _RATIO * low or math.sqrt(high**2 - low**2) < resolution:
        return None
    z = math.log(high / low) / error
    if z < _ERRORS or (high < _MUCH * low and not _other_colour(noisy, calm)):
        return None
    return Uneven(noisy.name, calm.name, high, low, max(min(2.0 * pairs * float(norm.sf(z)), 1.0), 1e-300))


def _other_colour(a: Prepared, b: Prepared) -> bool:
    """Whether the correlation of neighbouring readings differs (Bartlett's variance (1 - rho^2) / n of AR(1))."""
    variance = sum((1.0 - min(abs(p.quiet_rho), 0.9999) ** 2) / p.quiet_n for p in (a, b))
    return abs(a.quiet_rho - b.quiet_rho) > _COLOUR * math.sqrt(variance)

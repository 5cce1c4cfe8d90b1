"""What quiet stretches say of the noise, as a prior for sigma and rho on block means.

A block mean on a plateau has lost what its samples said of the noise; that is put back here. Without it the noise of
a wrong model would grow until it excuses the mismatch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..assemble import Assembled
from ..likelihood.prepare import Prepared, rested
from ..noise.quiet import MOST_RHO, standard_errors
from .whitening import Noise

#: relative accuracy of sigma, absolute one of atanh rho, that quiet stretches are trusted to
SIGMA_LOG_SD = 0.01
RHO_SD = 0.015
#: the same where nothing was at rest
UNSEEN_LOG_SD, UNSEEN_RHO_SD = 0.3, 0.4


@dataclass(frozen=True)
class NoisePrior:
    """Normal priors of log sigma and atanh rho; sampled in units of their sds."""

    log_sigma: dict[str, tuple[float, float]]  # mean, sd
    atanh_rho: dict[str, tuple[tuple[float, float], ...]]

    def start(self) -> Noise:
        """The centre."""
        return Noise(
            {c: math.exp(m) for c, (m, _) in self.log_sigma.items()},
            {c: tuple(math.tanh(m) for m, _ in r) for c, r in self.atanh_rho.items()},
        )

    def coordinates(self, noise: Noise, channel: str) -> NDArray[np.float64]:
        """Distance from the centre in sds."""
        mean, sd = self.log_sigma[channel]
        out = [(math.log(noise.sigma[channel]) - mean) / sd]
        out += [(math.atanh(r) - m) / s for r, (m, s) in zip(noise.rho[channel], self.atanh_rho[channel], strict=True)]
        return np.array(out)

    def at(self, noise: Noise, channel: str, x: NDArray) -> Noise:
        """The noise with one channel's moved."""
        mean, sd = self.log_sigma[channel]
        rho = tuple(math.tanh(m + s * v) for v, (m, s) in zip(x[1:], self.atanh_rho[channel], strict=True))
        return Noise({**noise.sigma, channel: math.exp(mean + sd * x[0])}, {**noise.rho, channel: rho})

    def minus_log(self, noise: Noise, channel: str | None = None) -> float:
        """Minus log prior of the noise, up to a constant that all hypotheses share."""
        return sum(0.5 * float(np.sum(self.coordinates(noise, c) ** 2)) for c in self.log_sigma if channel in (None, c))


def noise_prior(assembled: Assembled) -> NoisePrior:
    """From the quiet stretches of all recordings, pooled by channel and sampling rate."""
    log_sigma, atanh_rho = {}, {}
    for c in assembled.posterior.channels:
        every = [p for p in assembled.prepared if p.channel == c.channel]
        fitted = [p for p in every if p.recording.role == "identify"] or every
        members = rested(every)
        if not any(p.quiet_n for p in members):
            # nothing was at rest: what was taken for white noise need not be
            log_sigma[c.channel] = (math.log(c.sigma_guess), UNSEEN_LOG_SD)
            atanh_rho[c.channel] = tuple((math.atanh(r), UNSEEN_RHO_SD) for r in c.rho_guess)
            continue
        # a clipped sensor may stand still to the last digit: that says nothing of the others
        levels = [math.log(p.quiet_sd) for p in members if p.quiet_sd > 1e-3 * c.sigma_guess]
        # how well a level is known those say that it is of; how alike levels are, all
        known = max(_spread(levels, SIGMA_LOG_SD), _chance(rested(fitted, every))[0])
        log_sigma[c.channel] = (math.log(c.sigma_guess), min(known, UNSEEN_LOG_SD))
        rhos = []
        for j, guess in enumerate(c.rho_guess):
            ours, all_of_them = ([p for p in some if c.rates.of(p) == j] for some in (fitted, every))
            own = [p for p in rested(all_of_them) if p.quiet_n and np.isfinite(p.quiet_rho)]
            # at a rate at which nothing was at rest it is not known either
            spread = UNSEEN_RHO_SD
            if own:
                values = [math.atanh(float(np.clip(p.quiet_rho, -0.999, MOST_RHO))) for p in own]
                spread = min(max(_spread(values, RHO_SD), _chance(rested(ours, all_of_them))[1]), UNSEEN_RHO_SD)
            rhos.append((math.atanh(float(np.clip(guess, -0.995, MOST_RHO))), spread))
        atanh_rho[c.channel] = tuple(rhos)
    return NoisePrior(log_sigma, atanh_rho)


def _chance(own: Sequence[Prepared]) -> tuple[float, float]:
    """Standard errors of log sigma and of atanh rho that so many readings at rest leave."""
    known = [p for p in own if np.isfinite(p.quiet_rho)]
    return standard_errors([p.quiet_n for p in known], [p.quiet_rho for p in known])


def _spread(values: list[float], least: float) -> float:
    """Robust standard error of their centre, not below `least`."""
    if len(values) < 3:
        return 5.0 * least
    x = np.array(values)
    mad = 1.4826 * float(np.median(np.abs(x - np.median(x))))
    return max(least, 1.5 * mad / math.sqrt(len(x)))

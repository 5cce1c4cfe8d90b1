"""The posterior of a campaign: model coordinates, zeros of position, noise; priors and likelihoods joined.

Coordinates, in this order: those of the model; the zero of the position of every mechanical recording to identify;
for each channel log sigma and, for each sampling rate of it, atanh rho. Offsets, mains lines and gains are
integrated out exactly by the groups.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..models.model import Model
from ..noise.stated import NoiseTerms
from .block_group import BlockGroup
from .linear_group import LinearGroup
from .prepare import RateClasses

Group = LinearGroup | BlockGroup


@dataclass(frozen=True)
class ChannelNoise:
    """Prior of one channel's noise: log-normal sigma, rho uniform on (-1, 1) for each sampling rate."""

    channel: str
    unit: str
    sigma_median: float
    sigma_log_sd: float
    rates: RateClasses
    sigma_guess: float  # from quiet stretches, where searches start
    rho_guess: tuple[float, ...]


@dataclass(frozen=True)
class ZeroPrior:
    """Prior of the position of contact of one mechanical recording: normal, in m."""

    recording: str
    name: str
    mean: float
    sd: float


@dataclass(frozen=True)
class Posterior:
    """Log density of everything that is sampled. See the module for the order of coordinates."""

    model: Model
    groups: tuple[Group, ...]
    channels: tuple[ChannelNoise, ...]
    zeros: tuple[ZeroPrior, ...]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all coordinates (d,)."""
        noise = [name for c in self.channels
                 for name in (f"log sigma_{c.channel}", *(f"atanh rho_{c.channel}{suffix}" for suffix in rate_suffixes(c.rates)))]
        return (*self.model.coordinate_names, *(z.name for z in self.zeros), *noise)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    @cached_property
    def _zero_start(self) -> int:
        return self.model.dimension

    @cached_property
    def _noise_start(self) -> dict[str, int]:
        start, out = self.model.dimension + len(self.zeros), {}
        for c in self.channels:
            out[c.channel] = start
            start += 1 + len(c.rates.steps_s)
        return out

    def model_part(self, q: NDArray) -> NDArray:
        """Coordinates of the model (B, d_model)."""
        return q[:, :self.model.dimension]

    def zeros_part(self, q: NDArray) -> dict[str, NDArray]:
        """Position of contact (B,) in m by recording."""
        return {z.recording: q[:, self._zero_start + i] for i, z in enumerate(self.zeros)}

    def noise_part(self, q: NDArray, channel: str) -> tuple[NDArray, NDArray]:
        """sigma (B,) and rho (B, rates) of a channel."""
        start = self._noise_start[channel]
        rates = len(next(c for c in self.channels if c.channel == channel).rates.steps_s)
        return np.exp(np.clip(q[:, start], -80, 80)), np.tanh(q[:, start + 1:start + 1 + rates])

    # ------------------------------------------------------------ densities
    def log_prior(self, q: NDArray) -> NDArray:
        """(B,) log prior density per unit of the coordinates."""
        q = np.atleast_2d(q)
        out = self.model.log_prior(self.model_part(q))
        for i, z in enumerate(self.zeros):
            s = (q[:, self._zero_start + i] - z.mean) / z.sd
            out += -0.5 * s * s - math.log(z.sd * math.sqrt(2 * math.pi))
        for c in self.channels:
            start = self._noise_start[c.channel]
            s = (q[:, start] - math.log(c.sigma_median)) / c.sigma_log_sd
            out += -0.5 * s * s - math.log(c.sigma_log_sd * math.sqrt(2 * math.pi))
            for j in range(len(c.rates.steps_s)):
                a = np.abs(q[:, start + 1 + j])
                # log of (1 - rho^2)/2, the Jacobian of a uniform rho, without cancellation for large |atanh rho|
                out += math.log(2.0) - 2 * a - 2 * np.log1p(np.exp(-2 * a))
        return out

    def group_terms(self, q: NDArray, group: Group) -> NDArray:
        """(B, 4): log likelihood of a group, mean and variance of its gain, information about it."""
        sigma, rho = self.noise_part(q, group.channel)
        if isinstance(group, LinearGroup):
            return group.evaluate(group.gram_fitted, group.vectors(self.model, self.model_part(q)), sigma, rho)
        return group.evaluate(self.model, self.model_part(q), self.zeros_part(q), sigma, rho)

    def log_likelihood(self, q: NDArray) -> NDArray:
        """(B,) log likelihood of the recordings to identify."""
        q = np.atleast_2d(q)
        total = np.zeros(len(q))
        for group in self.groups:
            if group.fitted:
                total += self.group_terms(q, group)[:, 0]
        return total

    def log_prob(self, q: NDArray) -> NDArray:
        """(B,) log posterior, not normalised; -inf where the prior is zero or a model has no answer."""
        q = np.atleast_2d(q)
        out = self.log_prior(q)
        good = np.isfinite(out)
        if good.any():
            value = self.log_likelihood(q if good.all() else q[good])
            out[good] += np.where(np.isfinite(value), value, -np.inf)
        out[~good] = -np.inf
        return out

    # ------------------------------------------------------------ prior
    def prior_draws(self, n: int, rng: np.random.Generator) -> NDArray:
        """Draws of all coordinates from the prior (n, d)."""
        parts = [self.model.prior_draws(n, rng)]
        for z in self.zeros:
            parts.append((z.mean + z.sd * rng.standard_normal(n))[:, None])
        for c in self.channels:
            parts.append((math.log(c.sigma_median) + c.sigma_log_sd * rng.standard_normal(n))[:, None])
            for _ in c.rates.steps_s:
                parts.append(np.arctanh(np.clip(rng.uniform(-1, 1, n), -1 + 1e-12, 1 - 1e-12))[:, None])
        return np.concatenate(parts, axis=1)

    def noise_guess(self) -> NDArray:
        """Coordinates of the noise from quiet stretches, and the prior centre of the zeros: where searches start."""
        out = [z.mean for z in self.zeros]
        for c in self.channels:
            out.append(math.log(c.sigma_guess))
            out += [math.atanh(np.clip(r, -0.99, 0.999)) for r in c.rho_guess]
        return np.array(out)

    # ------------------------------------------------------------ reporting
    def noise_quantities(self, q: NDArray) -> dict[str, NDArray]:
        """Reported noise quantities of draws (B,): sigma and rho of each channel."""
        out: dict[str, NDArray] = {}
        for c in self.channels:
            sigma, rho = self.noise_part(q, c.channel)
            out[f"sigma_{c.channel}_{c.unit}"] = sigma
            for j, suffix in enumerate(rate_suffixes(c.rates)):
                out[f"rho_{c.channel}{suffix}"] = rho[:, j]
        return out


def rate_suffixes(rates: RateClasses) -> list[str]:
    """Nothing where a channel has one sampling rate, else the rate in Hz."""
    if len(rates.steps_s) == 1:
        return [""]
    return [f"_{1 / s:g}Hz" for s in rates.steps_s]


def offset_terms(terms: Mapping[str, NoiseTerms]) -> dict[str, float]:
    """Prior sd of each recording's offset, for the report."""
    return {name: t.offset_sd for name, t in terms.items()}

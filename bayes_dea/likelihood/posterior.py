"""The posterior of a campaign: model coordinates, zeros of position, noise; priors and likelihoods joined.

Coordinates, in this order: those of the model; where specimens have parameters of their own, these for each further
specimen; the zero of the position of every mechanical recording to identify;
for each channel log sigma and, for each sampling rate of it, atanh rho. Offsets, mains lines and gains are
integrated out exactly by the groups.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..models.model import Model
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
    specimens: tuple[str, ...] = ("A",)
    own: tuple[int, ...] = ()  # positions of the model's parameters that every specimen has for itself

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all coordinates (d,)."""
        noise = [
            name
            for c in self.channels
            for name in (
                f"log sigma_{c.channel}",
                *(f"atanh rho_{c.channel}{suffix}" for suffix in rate_suffixes(c.rates)),
            )
        ]
        further = [f"{self.model.coordinate_names[i]} {s}" for s in self.specimens[1:] for i in self.own]
        return (*self.model.coordinate_names, *further, *(z.name for z in self.zeros), *noise)

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    @cached_property
    def zero_start(self) -> int:
        """Position of the first zero among the coordinates."""
        return self.model.dimension + len(self.own) * (len(self.specimens) - 1)

    @cached_property
    def _noise_start(self) -> dict[str, int]:
        start, out = self.zero_start + len(self.zeros), {}
        for c in self.channels:
            out[c.channel] = start
            start += 1 + len(c.rates.steps_s)
        return out

    def model_part(self, q: NDArray, specimen: str | None = None) -> NDArray:
        """Coordinates of the model (B, d_model) for a specimen; by default the first one."""
        d = self.model.dimension
        if not self.own or specimen is None or specimen == self.specimens[0]:
            return q[:, :d]
        x = q[:, :d].copy()
        start = d + (self.specimens.index(specimen) - 1) * len(self.own)
        x[:, list(self.own)] = q[:, start : start + len(self.own)]
        return x

    def zeros_part(self, q: NDArray) -> dict[str, NDArray]:
        """Position of contact (B,) in m by recording."""
        return {z.recording: q[:, self.zero_start + i] for i, z in enumerate(self.zeros)}

    def noise_part(self, q: NDArray, channel: str) -> tuple[NDArray, NDArray]:
        """sigma (B,) and rho (B, rates) of a channel."""
        start = self._noise_start[channel]
        rates = len(next(c for c in self.channels if c.channel == channel).rates.steps_s)
        return np.exp(np.clip(q[:, start], -80, 80)), np.tanh(q[:, start + 1 : start + 1 + rates])

    # ------------------------------------------------------------ densities
    def log_prior(self, q: NDArray) -> NDArray:
        """(B,) log prior density per unit of the coordinates."""
        q = np.atleast_2d(q)
        out = self.model.log_prior(self.model_part(q))
        for specimen in self.specimens[1:] if self.own else ():
            out += self.model.priors.logpdf_own(self.model_part(q, specimen), self.own)
        for i, z in enumerate(self.zeros):
            s = (q[:, self.zero_start + i] - z.mean) / z.sd
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
            return group.evaluate(
                group.gram_fitted, group.vectors(self.model, self.model_part(q, group.specimen)), sigma, rho
            )
        return group.evaluate(self.model, self.model_part(q, group.specimen), self.zeros_part(q), sigma, rho)

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

    def without(self, name: str) -> Posterior:
        """The same posterior with one recording moved from the fitted ones of its group to the others."""
        groups: list[Group] = []
        for g in self.groups:
            if isinstance(g, LinearGroup) and any(p.name == name for p in g.fitted):
                gone = tuple(p for p in g.fitted if p.name == name)
                groups.append(replace(g, fitted=tuple(p for p in g.fitted if p.name != name), others=g.others + gone))
            else:
                groups.append(g)
        return replace(self, groups=tuple(groups))

    # ------------------------------------------------------------ prior
    def prior_draws(self, n: int, rng: np.random.Generator) -> NDArray:
        """Draws of all coordinates from the prior (n, d)."""
        parts = [self.model.prior_draws(n, rng)]
        for _ in self.specimens[1:] if self.own else ():
            again = self.model.prior_draws(n, rng)
            mixed = parts[0].copy()
            mixed[:, list(self.own)] = again[:, list(self.own)]
            # an order that spans shared and own parameters must hold for the mixture as well
            broken = ~np.isfinite(self.model.log_prior(mixed))
            mixed[broken] = parts[0][broken]
            parts.append(mixed[:, list(self.own)])
        for z in self.zeros:
            parts.append((z.mean + z.sd * rng.standard_normal(n))[:, None])
        for c in self.channels:
            parts.append((math.log(c.sigma_median) + c.sigma_log_sd * rng.standard_normal(n))[:, None])
            for _ in c.rates.steps_s:
                parts.append(np.arctanh(np.clip(rng.uniform(-1, 1, n), -1 + 1e-12, 1 - 1e-12))[:, None])
        return np.concatenate(parts, axis=1)

    def noise_guess(self) -> NDArray:
        """Zeros at their prior's centre and noise from quiet stretches: where searches start."""
        out = [z.mean for z in self.zeros]
        for c in self.channels:
            out.append(math.log(c.sigma_guess))
            out += [math.atanh(np.clip(r, -0.99, 0.9999)) for r in c.rho_guess]
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

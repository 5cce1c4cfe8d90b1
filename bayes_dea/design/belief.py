"""What is believed of a model before the next experiment: draws of its posterior with gains and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Campaign, Sensor
from ..likelihood.posterior import Posterior
from ..models.model import Model
from ..noise.stated import force_noise_from_position, noise_terms
from ..predict_recordings import conditional_gain
from ..prediction.calibrated import Calibrated

Array = NDArray[np.float64]
CHANNELS = ("displacement", "force")
#: signals whose share the accuracy is, where nothing of the channel has been recorded: 0.2 mm, 20 N
_TYPICAL = {"displacement": 2e-4, "force": 20.0}


@dataclass(frozen=True)
class Noise:
    """A channel: sd of a reading, its correlation at the rate of the bench, prior sd of a recording's offset.

    position_sd: of a reading of the position that drives a force (m), 0 where none does. position_off_m: sd of its
    systematic error, 0 where forces have been recorded: the gain of these has it in it.
    """

    sigma: float
    rho: float
    offset_sd: float
    position_sd: float = 0.0
    position_off_m: float = 0.0

    def sd_of(self, readings: Array) -> Array:
        """Sd (n,) of the mean of so many readings in a row; infinite for none."""
        r = min(max(self.rho, -0.99), 0.9999)
        with np.errstate(divide="ignore"):
            grown = np.where(readings > 1, (1 + r) / (1 - r), 1.0)
            return np.asarray(self.sigma * np.sqrt(grown / readings), float)


@dataclass(frozen=True)
class Belief:
    """A model with draws z (N, d) of its coordinates, gains (N,) by channel, noise by channel."""

    name: str
    model: Model
    z: Array = field(repr=False)
    gains: Mapping[str, Array] = field(repr=False)
    noise: Mapping[str, Noise]

    def spread(self, count: int) -> NDArray[np.int64]:
        """Rows of at most `count` draws, evenly spread."""
        n = len(self.z)
        return np.unique(np.linspace(0, n - 1, min(count, n)).round().astype(np.int64))

    def at(self, rows: NDArray[np.int64]) -> Belief:
        """Some of the draws."""
        return replace(self, z=self.z[rows], gains={k: v[rows] for k, v in self.gains.items()})

    @property
    def joint(self) -> Array:
        """Coordinates and gains (N, d + channels)."""
        return np.column_stack([self.z, *(self.gains[c] for c in CHANNELS if c in self.gains)])


def of_posterior(posterior: Posterior, q: Array, campaign: Campaign, rng: np.random.Generator,
                 name: str | None = None) -> Belief:
    """Belief of draws q (N, D) of a posterior; the first specimen's.

    The gain of a channel that nothing was recorded of that specimen with is as uncertain as the sensor's statement.
    """
    gains, noise = {}, {}
    conditional = conditional_gain(posterior, q)
    for channel in (c.channel for c in posterior.channels):
        stated = next(g.gain_sd for g in posterior.groups if g.channel == channel)
        mean, sd = conditional.get((channel, posterior.specimens[0]), (0.0, stated))
        gains[channel] = mean + sd * rng.standard_normal(len(q))
        sigma, rho = posterior.noise_part(q, channel)
        # the fastest rate is the one that new recordings are most like
        noise[channel] = _noise(campaign, channel, float(np.median(sigma)), float(np.median(rho[:, 0])))
    belief = Belief(name or posterior.model.name, posterior.model, posterior.model_part(q), gains, noise)
    return with_unseen(belief, campaign, rng)


def of_calibration(source: Calibrated, campaign: Campaign, rng: np.random.Generator) -> Belief:
    """Belief of a calibration that was done before."""
    specimen = source.structure.specimens[0]
    gains, noise = {}, {}
    for channel, unit in (("displacement", "m"), ("force", "N")):
        sigma = source.quantities.get(f"sigma_{channel}_{unit}")
        gain = source.quantities.get(f"gain_{channel}", source.quantities.get(f"gain_{channel}_{specimen}"))
        if sigma is None or gain is None:
            continue
        rho = [v for k, v in source.quantities.items() if k.startswith(f"rho_{channel}")]
        gains[channel] = gain
        noise[channel] = _noise(campaign, channel, float(np.median(sigma)), float(np.median(rho[0])) if rho else 0.0)
    z = source.structure.model_part(source.draws, specimen)
    return with_unseen(Belief(source.structure.model.name, source.structure.model, z, gains, noise), campaign, rng)


def with_unseen(belief: Belief, campaign: Campaign, rng: np.random.Generator) -> Belief:
    """Channels that nothing was recorded of come in as their sensors' statements say."""
    gains, noise = dict(belief.gains), dict(belief.noise)
    for channel in CHANNELS:
        sensor = campaign.sensors.get(channel)
        if channel in gains or sensor is None or sensor.fluctuation is None:
            continue
        terms = noise_terms(sensor, False, _TYPICAL[channel], channel=channel)
        gains[channel] = terms.gain_sd * rng.standard_normal(len(belief.z))
        noise[channel] = Noise(float(np.sqrt(terms.sample_variance(terms.sigma_median))), 0.0, terms.offset_sd,
                               *_position(campaign, channel))
    return replace(belief, gains=gains, noise=noise)


def _noise(campaign: Campaign, channel: str, sigma: float, rho: float) -> Noise:
    sensor = campaign.sensors.get(channel, Sensor())
    terms = noise_terms(sensor, False, _TYPICAL[channel], estimated_sd=sigma, channel=channel)
    return Noise(float(np.sqrt(terms.sample_variance(sigma))), rho, terms.offset_sd,
                 _position(campaign, channel)[0])


def _position(campaign: Campaign, channel: str) -> tuple[float, float]:
    """Scatter, and sd of the systematic error, of the position that drives a force (m)."""
    sensor = campaign.sensors.get("position")
    if channel != "force" or sensor is None:
        return 0.0, 0.0
    carried = force_noise_from_position(sensor, 1.0, 1.0)  # at 1 N/m, over 1 m
    return carried.sd_N, carried.gain_sd


__all__ = ["CHANNELS", "Belief", "Noise", "of_calibration", "of_posterior", "with_unseen"]

"""Noise terms from the stated accuracies of a sensor.

A data sheet gives three numbers that mean three things. The fluctuation is random, per sample. The
accuracy is a limit of the systematic error: an offset per recording and a gain per sensor. The
resolution is a quantisation step. Taking the accuracy for white noise is the commonest mistake.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.schema import Sensor
from bayes_dea.campaign.vocabulary import SENSOR_UNITS
from bayes_dea.errors import InputError

#: log-sd of the prior of sigma around a stated fluctuation (the sheet may mean peak-to-peak)
SIGMA_LOG_SD = 0.4
#: the same where the fluctuation is not stated and the data give the median
SIGMA_LOG_SD_FROM_DATA = 0.8
#: distance of the 0.1 and 99.9 % quantiles of a standard normal variable
_TAILS = 6.1805
#: offset sd as a share of the largest signal where no accuracy is stated
OFFSET_SHARE_UNSTATED = 1.0 / 3.0


@dataclass(frozen=True)
class NoiseTerms:
    """Noise of one channel of one recording, in the SI unit of the channel (gain: dimensionless).

    The observation is y_t = (1 + g) x_t + b + n_t with g ~ N(0, gain_sd^2), b ~ N(0, offset_sd^2) and
    n_t of marginal sd sigma, log sigma ~ N(log sigma_median, sigma_log_sd^2). White quantisation noise
    of variance `quantisation_variance` comes on top; where `interval_needed` is set it is not noise-like
    and the interval likelihood (`densities.interval`) takes its place.
    """

    sigma_median: float
    sigma_log_sd: float
    offset_sd: float
    gain_sd: float
    resolution: float = 0.0
    quantisation_variance: float = 0.0
    interval_needed: bool = False
    warnings: tuple[str, ...] = ()

    def log_prior_sigma(self, sigma: ArrayLike) -> NDArray[np.float64]:
        """Log density of sigma (per unit of sigma); -inf where sigma <= 0. Any shape."""
        s = np.asarray(sigma, dtype=float)
        out = np.full(s.shape, -np.inf)
        good = s > 0
        log_s = np.log(s[good])
        z = (log_s - math.log(self.sigma_median)) / self.sigma_log_sd
        out[good] = -0.5 * z * z - log_s - math.log(self.sigma_log_sd * math.sqrt(2 * math.pi))
        return out

    def draw_sigma(self, rng: np.random.Generator, size: int | tuple[int, ...] = 1) -> NDArray[np.float64]:
        """Draws of sigma from its prior."""
        return self.sigma_median * np.exp(self.sigma_log_sd * rng.standard_normal(size))

    def sample_variance(self, sigma: float) -> float:
        """Variance of one sample: sigma^2, plus q^2/12 where quantisation is noise-like."""
        return sigma * sigma + self.quantisation_variance

    def plus_position(self, position: PositionInForce) -> NoiseTerms:
        """Force terms with the error of the measured position added in quadrature."""
        return replace(
            self,
            sigma_median=math.hypot(self.sigma_median, position.sd_N),
            offset_sd=math.hypot(self.offset_sd, position.offset_sd_N),
            gain_sd=math.hypot(self.gain_sd, position.gain_sd),
            # scatter of the position dithers the force as seen by the model, never the reading itself
            warnings=self.warnings + position.warnings,
        )


@dataclass(frozen=True)
class PositionInForce:
    """What the error of a measured position does to the force that a model predicts from it."""

    sd_N: float  # random, per sample
    offset_sd_N: float  # systematic, per recording
    gain_sd: float  # systematic, relative
    warnings: tuple[str, ...] = ()


def signal_size(span: float, noise_sd: float) -> float:
    """Size of a signal whose readings lie within `span` from their 0.1 to their 99.9 % quantile.

    What the tails of Gaussian noise add to the span is taken off: scaled by a size that noise has blown up, the gain
    would be held for better known than the sensor's accuracy allows. At least half the span, where noise hides the
    signal.
    """
    return max(span - _TAILS * noise_sd, span / 2)


def noise_terms(sensor: Sensor, zeroed: bool, largest_signal: float, *, estimated_sd: float | None = None,
                channel: str = "displacement") -> NoiseTerms:
    """Noise terms of one channel of one recording.

    Limits +-A without more are rectangular: standard uncertainty A/sqrt(3) (GUM, JCGM 100:2008, 4.3.7).

    Parameters
    ----------
    sensor : stated accuracies in the unit of the channel.
    zeroed : the sensor was zeroed just before; the offset then is the fluctuation of that zero (one
        reading's at worst), the gain stays.
    largest_signal : largest |signal| of the recordings in the unit of the channel; scales the gain.
    estimated_sd : sd found in quiet stretches of the data; used where no fluctuation is stated.
    channel : name for messages, as in `[sensor.displacement]`.

    Where the accuracy is missing the offset gets an sd of a third of the largest signal (nearly free)
    and the gain the `gain_sd` of the sensor, by default none: a free gain would take all information on
    stiffness away. The statement is asked for in a warning. Where the fluctuation is missing the data
    give the median, with a log-sd of 0.8.

    Raises
    ------
    InputError : a stated number is not finite or not positive, the largest signal is negative, or the
        fluctuation is neither stated nor estimated.
    """
    where = f"[sensor.{channel}]"
    for key in ("fluctuation", "accuracy", "resolution"):
        _check(getattr(sensor, key), f"{where} {key}")
    if not (math.isfinite(largest_signal) and largest_signal >= 0):
        raise InputError(f"{where}: largest signal {largest_signal} is not a finite number >= 0; "
                         "check the recorded column for infinite values")
    warnings: list[str] = []
    step = sensor.resolution or 0.0

    if sensor.fluctuation is not None:
        sigma, log_sd = sensor.fluctuation, SIGMA_LOG_SD
    else:
        estimate = max(estimated_sd or 0.0, step / math.sqrt(12.0))
        if not (math.isfinite(estimate) and estimate > 0):
            raise InputError(f"{where}: no fluctuation is stated and none could be estimated from the data; "
                             "state it (random scatter, one standard deviation)")
        sigma, log_sd = estimate, SIGMA_LOG_SD_FROM_DATA
        warnings.append(f"{where} states no fluctuation; {sigma:.3g} was estimated from quiet stretches of "
                        "the data. State it in campaign.toml to narrow its prior.")

    if sensor.accuracy is not None:
        systematic = sensor.accuracy / math.sqrt(3.0)
        gain = systematic / largest_signal if largest_signal > 0 else 0.0
        offset = sigma if zeroed else systematic
    else:
        gain = sensor.gain_sd or 0.0
        free = max(OFFSET_SHARE_UNSTATED * largest_signal, sigma)
        offset = sigma if zeroed else free
        scale = (f"its scale within {gain:.0%} (sd). State it in campaign.toml: what follows is less certain for that."
                 if gain > 0.0 else
                 "the gain is taken as exact. The bands leave out the error of the sensor's scale: state it.")
        unit = SENSOR_UNITS.get(channel, "")
        # the same for recordings that were zeroed, so that it is said once
        warnings.append(f"{where} states no accuracy; the offset of a recording that was not zeroed is left nearly "
                        f"free (sd {free:.3g} {unit}) and {scale}")

    interval = step > 0 and sigma <= step / 2
    if interval:
        warnings.append(f"{where}: the fluctuation {sigma:.3g} is not above half a resolution step "
                        f"({step / 2:.3g}); rounding is no noise there. Readings are treated as intervals; in a "
                        "diagnosis, rounding is an error of each block of readings.")
    return NoiseTerms(sigma_median=sigma, sigma_log_sd=log_sd, offset_sd=offset, gain_sd=gain,
                      resolution=step, quantisation_variance=0.0 if interval else step * step / 12.0,
                      interval_needed=interval, warnings=tuple(warnings))


def force_noise_from_position(position_sensor: Sensor, stiffness_N_per_m: float,
                              largest_travel_m: float) -> PositionInForce:
    """Error of the measured position carried into the force, to first order.

    A position error d shifts the force by K d: 5 um are 0.065 N at 13 kN/m. The scatter (with
    quantisation q^2/12) becomes a random sd, the accuracy an offset K A/sqrt(3) and a relative gain
    A/sqrt(3)/travel (GUM 4.3.7, law of propagation 5.1.2).

    Parameters
    ----------
    position_sensor : stated accuracies in m; what is not stated counts as zero, with a warning.
    stiffness_N_per_m : slope of force over position, |dF/dx|.
    largest_travel_m : largest travel of the recording.

    Raises
    ------
    InputError : a stated number or the stiffness is not finite or has the wrong sign, or travel <= 0.
    """
    where = "[sensor.position]"
    for key in ("fluctuation", "accuracy", "resolution"):
        _check(getattr(position_sensor, key), f"{where} {key}")
    for value, name in ((stiffness_N_per_m, "stiffness_N_per_m"), (largest_travel_m, "largest travel")):
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"{where}: {name} is {value}, it must be a finite number > 0; "
                             "check the position_m and force_N columns")
    missing = [k for k in ("fluctuation", "accuracy") if getattr(position_sensor, k) is None]
    text = (f"{where} states no {' and no '.join(missing)}; the position counts as exact in that respect "
            "although its error enters the force. State it in campaign.toml.",) if missing else ()
    rounding = (position_sensor.resolution or 0.0) / math.sqrt(12.0)
    scatter = math.hypot(position_sensor.fluctuation or 0.0, rounding)
    systematic = (position_sensor.accuracy or 0.0) / math.sqrt(3.0)
    return PositionInForce(sd_N=stiffness_N_per_m * scatter, offset_sd_N=stiffness_N_per_m * systematic,
                           gain_sd=systematic / largest_travel_m, warnings=text)


def _check(value: float | None, name: str) -> None:
    if value is not None and not (math.isfinite(value) and value > 0):
        raise InputError(f"{name} is {value}; it must be a finite number > 0 "
                         "(leave the line out if it is unknown)")

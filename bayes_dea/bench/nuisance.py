"""What the sensors of the bench do to the truth: y = (1 + gain) x + offset + noise (+ faults), quantised.

A data sheet states three numbers: fluctuation (random, one standard deviation a sample), accuracy (limits of
the systematic error: an offset a recording, a gain a sensor and specimen, both rectangular; JCGM 100:2008,
4.3.7) and resolution (quantisation step). Everything random comes from the generator that is passed in.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import InputError

Array = NDArray[np.float64]

#: readings whose mean becomes the new zero when a sensor is zeroed
ZERO_READINGS = 10
#: largest gain error: where the signals are small, accuracy / signal would be a number that no gain can have
LARGEST_GAIN = 0.1
#: longest time in s by which readings stand beside their command
LATEST_S = 0.1
#: no fault is as large, in its SI unit or as a factor
_SENSELESS = 1e6
#: share of a recording that gaps may take, laid end to end
_MOST_MISSING = 0.9


@dataclass(frozen=True)
class SensorSheet:
    """Stated accuracies of one sensor, in the SI unit of its channel."""

    fluctuation: float
    accuracy: float
    resolution: float

    def __post_init__(self) -> None:
        for name in ("fluctuation", "accuracy", "resolution"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"sensor of the bench: {name} is {value}; give zero or a positive number")


@dataclass(frozen=True)
class ChannelFaults:
    """What a channel really does, beyond its sheet; the defaults are a channel that keeps to it.

    `noise_scale`: true noise over the stated fluctuation. `noise_correlation`: of neighbouring samples,
    AR(1), at the recording's own rate. Drop-outs: single readings off by `dropout_min` to `dropout_max`
    either way (log-uniform). Gaps: `gaps` stretches of `gap_length_s` without a reading (NaN).
    """

    noise_scale: float = 1.0
    noise_correlation: float = 0.0
    dropout_probability: float = 0.0
    dropout_min: float = 10e-6
    dropout_max: float = 500e-6
    mains_amplitude: float = 0.0
    mains_frequency_Hz: float = 50.0
    gaps: int = 0
    gap_length_s: float = 0.5

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not abs(value) < _SENSELESS:  # nan too
                raise InputError(f"faults of the bench: {name} is {value}; give a number that a bench can have")
        if not 0.0 <= self.noise_correlation < 1.0:
            raise InputError(f"faults of the bench: noise_correlation is {self.noise_correlation}; "
                             "give a number from 0 to below 1")
        if not 0.0 <= self.dropout_probability < 1.0:
            raise InputError(f"faults of the bench: dropout_probability is {self.dropout_probability}; "
                             "give a number from 0 to below 1")
        if not 0.0 < self.dropout_min <= self.dropout_max:
            raise InputError("faults of the bench: dropout_min must be positive and not above dropout_max")
        if min(self.noise_scale, self.mains_amplitude, self.gaps, self.gap_length_s) < 0.0:
            raise InputError("faults of the bench: noise_scale, mains_amplitude, gaps and gap_length_s "
                             "must not be negative")


@dataclass(frozen=True)
class Faults:
    """Faults of every channel and of the recorder's clock.

    `clock_unevenness`: part of a step by which stamps scatter. `displacement_late_s`: by how long the displacement
    stands behind the command in its row; negative where it was read before that.
    """

    displacement: ChannelFaults = field(default_factory=ChannelFaults)
    force: ChannelFaults = field(default_factory=ChannelFaults)
    position: ChannelFaults = field(default_factory=ChannelFaults)
    clock_unevenness: float = 0.0
    displacement_late_s: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.displacement_late_s) < LATEST_S:
            raise InputError(f"faults of the bench: displacement_late_s is {self.displacement_late_s}; give a number "
                             f"between -{LATEST_S} and {LATEST_S}")


@dataclass(frozen=True)
class ChannelTruth:
    """What was true of one channel in one recording."""

    gain: float
    offset: float
    noise_sd: float
    noise_correlation: float
    dropouts: int
    gap_samples: int
    mains_phase_rad: float | None


def draw_gain(sheet: SensorSheet, largest: float, rng: np.random.Generator) -> float:
    """Relative gain error, rectangular within +- accuracy / `largest` signal (at most +-0.1)."""
    limit = min(sheet.accuracy / largest, LARGEST_GAIN) if largest > 0.0 else LARGEST_GAIN
    return float(rng.uniform(-limit, limit))


def correlated_noise(n: int, sd: float, correlation: float, rng: np.random.Generator) -> Array:
    """Stationary AR(1) noise (n,) of standard deviation `sd`; white where `correlation` is 0."""
    noise = sd * rng.standard_normal(n)
    if correlation == 0.0 or n == 0:
        return noise
    from scipy.signal import lfilter

    noise[1:] *= np.sqrt(1.0 - correlation**2)  # the first sample already has the stationary variance
    return np.asarray(lfilter([1.0], [1.0, -correlation], noise), dtype=float)


def quantise(values: Array, resolution: float) -> Array:
    """`values` on the grid of `resolution`, as decimals that a short text gives back exactly."""
    if resolution == 0.0:
        return values
    digits = max(0, 3 - int(np.floor(np.log10(resolution))))
    return np.round(np.round(values / resolution) * resolution, digits) + 0.0  # + 0.0: no minus before zero


def record(true: Array, time_s: Array, sheet: SensorSheet, faults: ChannelFaults, gain: float, zeroed: bool,
           rng: np.random.Generator, highest: float = np.inf) -> tuple[Array, ChannelTruth]:
    """Readings (n,) of a sensor of the true signal (n,), and what was added to it.

    `highest`: end of the sensor's range; a reading, noise included, never lies above it.

    `zeroed`: the sensor was set to zero on the resting actuator just before, so that of its offset only the
    mean of the readings used for it remains (with the sign turned); otherwise the offset is rectangular
    within the accuracy.
    """
    n = true.size
    missing_s, lasts_s = faults.gaps * faults.gap_length_s, float(time_s[-1] - time_s[0])
    if missing_s > _MOST_MISSING * lasts_s > 0.0:
        raise InputError(f"faults of the bench: {faults.gaps} gaps of {faults.gap_length_s:g} s leave next to nothing "
                         f"of a recording of {lasts_s:.3g} s; give fewer")
    sd = faults.noise_scale * sheet.fluctuation
    noise = correlated_noise(n + ZERO_READINGS, sd, faults.noise_correlation, rng)
    anywhere = float(rng.uniform(-sheet.accuracy, sheet.accuracy))
    offset = -float(noise[:ZERO_READINGS].mean()) if zeroed else anywhere
    y = (1.0 + gain) * true + offset + noise[ZERO_READINGS:]
    phase = None
    if faults.mains_amplitude > 0.0:
        phase = float(rng.uniform(0.0, 2.0 * np.pi))
        y += faults.mains_amplitude * np.sin(2.0 * np.pi * faults.mains_frequency_Hz * time_s + phase)
    dropouts = 0
    if faults.dropout_probability > 0.0:
        hit = np.flatnonzero(rng.random(n) < faults.dropout_probability)
        dropouts = int(hit.size)
        size = np.exp(rng.uniform(np.log(faults.dropout_min), np.log(faults.dropout_max), dropouts))
        y[hit] += size * rng.choice((-1.0, 1.0), dropouts)
    if highest < np.inf:
        y = np.minimum(y, highest)
    y = quantise(y, sheet.resolution)
    for _ in range(faults.gaps):
        start = rng.uniform(time_s[0], max(time_s[0], time_s[-1] - faults.gap_length_s))
        y[(time_s >= start) & (time_s < start + faults.gap_length_s)] = np.nan
    missing = int(np.isnan(y).sum())
    return y, ChannelTruth(gain, offset, sd, faults.noise_correlation, dropouts, missing, phase)

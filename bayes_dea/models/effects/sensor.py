"""Left out between the displacement and its record."""

from __future__ import annotations

import math
from collections.abc import Mapping, MutableMapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...campaign.pace import pace_of
from ...priors import Prior
from .effect import Effect, off, quantity

if TYPE_CHECKING:
    from ...campaign.schema import Campaign

_CATALOGUE = "catalogue of missing physics"
#: shortest delay that recordings may show, in samples: on the first row behind an edge that much of a step is missing
_LEAST_DELAY = 0.005
#: and what recordings sampled slowly have to allow, in samples: late by one or two is the commonest of all
_MOST_DELAY = 3.0
#: sd of a uniform density over half its width
UNIFORM_SD = 1.0 / math.sqrt(3.0)


def _displacements(campaign: Campaign) -> list[np.ndarray]:
    return [r.columns["displacement_m"] for r in campaign.recordings if r.is_voltage]


def displacement_range(campaign: Campaign) -> tuple[float, float]:
    """Lowest and highest displacement (m) recorded, single outliers aside; (0, 0) where there is none."""
    found = [np.nanquantile(y, (0.001, 0.999)) for y in _displacements(campaign)]
    if not found:
        return 0.0, 0.0
    return float(min(f[0] for f in found)), float(max(f[1] for f in found))


def stated_accuracy(campaign: Campaign) -> float | None:
    """Stated limits of the displacement sensor's error (m), or None."""
    sensor = campaign.sensors.get("displacement")
    return sensor.accuracy if sensor is not None and sensor.accuracy else None


class AcquisitionDelay(Effect):
    """The record is late by a fixed time; a negative one, by a prior of its own, is early."""

    name = "acquisition_delay"
    stage = "sensor"
    moves_corners = True
    label = "delay of the acquisition"
    equation = "y(t) = x(t - T_d), linear between samples"
    source = f"{_CATALOGUE}, E23"
    null = off("T_d_s")
    black_box = True

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """From parts of a sample to some: what is less than one is timing, but has to be known for that."""
        plain = next(p.prior for p in self.parameters if p.name == "T_d_s")
        steps = [pace_of(r.time_s).step_s for r in campaign.recordings if r.is_voltage and len(r.time_s) > 1]
        if not steps:
            return {}
        low, high = min(plain.a, _LEAST_DELAY * min(steps)), max(plain.b, _MOST_DELAY * max(steps))
        return {"T_d_s": Prior("loguniform", low, high)}

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the time."""
        if values["T_d_s"] < 0.0:
            early = quantity(-values["T_d_s"], "s")
            return f"the recorded displacement is early by {early}: its clock is ahead of the command's"
        return f"the recorded displacement is late by {quantity(values['T_d_s'], 's')} (delay of the acquisition)"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["T_d_s"] = values["T_d_s"]


class SensorLag(Effect):
    """The sensor averages: a low-pass behind the displacement."""

    name = "sensor_lag"
    stage = "sensor"
    label = "lag of the sensor"
    equation = "tau_s y' = x - y"
    source = f"{_CATALOGUE}, E24"
    null = off("tau_s_s")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the time constant."""
        return (f"the displacement sensor lags: a first-order low-pass with a time constant of "
                f"{quantity(values['tau_s_s'], 's')}")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["tau_s_s"] = values["tau_s_s"]


class SensorNonlinearity(Effect):
    """The sensor's characteristic is curved."""

    name = "sensor_nonlinearity"
    stage = "sensor"
    label = "nonlinearity of the sensor"
    equation = "y + q_2 y^2"
    source = f"{_CATALOGUE}, E25"
    null = off("q_2_per_m")
    black_box = True

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """The sd of what lies within the stated accuracy at the largest displacement; worse is not ruled out."""
        accuracy, reach = stated_accuracy(campaign), max(map(abs, displacement_range(campaign)))
        if accuracy is None or reach == 0.0:
            return {}
        return {"q_2_per_m": Prior("normal", 0.0, UNIFORM_SD * accuracy / reach**2)}

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the error at 200 um."""
        return (f"the displacement sensor is not linear: {values['q_2_per_m'] * 4e-8 * 1e6:+.3g} um at 200 um "
                f"(q_2 = {values['q_2_per_m']:.3g} 1/m)")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["q_2_per_m"] = values["q_2_per_m"]


class SensorDrift(Effect):
    """The sensor's zero moves with time."""

    name = "sensor_drift"
    stage = "sensor"
    label = "drift of the sensor"
    equation = "y + drift (t - t of the first row)"
    source = f"{_CATALOGUE}, E25"
    null = off("drift_m_per_s")
    black_box = True

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """The sd of what lies within the stated accuracy over the longest recording; worse is not ruled out."""
        accuracy = stated_accuracy(campaign)
        spans = [float(r.time_s[-1] - r.time_s[0]) for r in campaign.recordings if r.is_voltage]
        if accuracy is None or not spans:
            return {}
        return {"drift_m_per_s": Prior("normal", 0.0, UNIFORM_SD * accuracy / max(spans))}

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the rate."""
        return f"the zero of the displacement sensor drifts by {values['drift_m_per_s'] * 6e7:+.3g} um a minute"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["drift_m_per_s"] = values["drift_m_per_s"]


class MainsPickup(Effect):
    """A line at the frequency of the mains."""

    name = "mains_pickup"
    stage = "sensor"
    moves_corners = True
    label = "mains pickup"
    equation = "y + A sin(2 pi f (t - t of the first row) + phase)"
    source = f"{_CATALOGUE}, E26"
    null = off("mains_m")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with amplitude and frequency."""
        return (f"mains is in the record of the displacement: an amplitude of {quantity(values['mains_m'], 'm')} at "
                f"{values['mains_Hz']:.4g} Hz")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        for name in ("mains_m", "mains_phase_rad", "mains_Hz"):
            plant[name] = values[name]


class SensorClipping(Effect):
    """The sensor's range ends below the largest displacement."""

    name = "sensor_clipping"
    stage = "sensor"
    moves_corners = True
    label = "clipping of the sensor"
    equation = "min(y, y_max)"
    source = f"{_CATALOGUE}, E26"
    null = None
    black_box = True

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """The upper half of the recorded range, and above it what an offset may hide of it."""
        low, high = displacement_range(campaign)
        offset = stated_accuracy(campaign) or 0.0
        return {"y_max_m": Prior("uniform", 0.5 * (low + high), high + offset)} if high > low else {}

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the limit."""
        return f"the displacement sensor clips at {quantity(values['y_max_m'], 'm')}"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["y_max_m"] = values["y_max_m"]


EFFECTS = (AcquisitionDelay(), SensorLag(), SensorNonlinearity(), SensorDrift(), MainsPickup(), SensorClipping())

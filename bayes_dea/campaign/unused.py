"""What a campaign says and no model is driven by: a voltage measured beside the command, and a payload."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.schema import Actuator, Recording, Sensor
from bayes_dea.campaign.scratch import pieces

#: a scatter this many times the stated one is more than a fluctuation that was stated a little small
_BEYOND = 1.5
_GRAVITY = 9.81  # m/s^2
#: recordings that a line names
_NAMED = 3


@dataclass(frozen=True)
class Supplied:
    """A measured voltage against its command: measured = offset + gain x command, and what is left.

    gain is 1 where the command never changes. largest_V: of the command. rms_V: after gain and offset.
    """

    gain: float
    offset_V: float
    rms_V: float
    largest_V: float


def unused_warnings(recordings: Sequence[Recording], sensors: Mapping[str, Sensor]) -> list[str]:
    """Lines on what was read and is not used, and what follows from it; none where there is nothing."""
    return _voltages(recordings, sensors.get("voltage")) + _payloads(recordings)


def drives_itself(recording: Recording) -> bool:
    """Whether the column that was measured is mapped to the drive, too."""
    command, measured = recording.columns["voltage_V"], recording.columns["measured_voltage_V"]
    return np.array_equal(command, measured, equal_nan=True)


def supplied(recording: Recording) -> Supplied | None:
    """What the supply of a recording with voltage_V and measured_voltage_V did; None without readings of both."""
    command, measured = recording.columns["voltage_V"], recording.columns["measured_voltage_V"]
    found = [_compared(command, measured)]
    if recording.hold == "start":
        # a command that acts from its row on is read at that row or at the next one: which, nobody says
        found.append(_compared(command[:-1], measured[1:]))
    return min((s for s in found if s is not None), key=lambda s: s.rms_V, default=None)


def _compared(command: NDArray[np.float64], measured: NDArray[np.float64]) -> Supplied | None:
    n, sums, largest = 0, np.zeros(4), 0.0
    for part in pieces(command.size):
        u, v = _both(command[part], measured[part])
        n += u.size
        sums += [u.sum(), v.sum(), u @ u, u @ v]
        largest = max(largest, float(np.max(np.abs(u), initial=0.0)))
    if n < 2:
        return None
    mean_u, mean_v = sums[0] / n, sums[1] / n
    uu, uv = sums[2] / n - mean_u**2, sums[3] / n - mean_u * mean_v
    changes = uu > 1e-12 * max(largest, 1e-300) ** 2
    gain = float(uv / uu) if changes else 1.0
    offset = float(mean_v - gain * mean_u)
    left = 0.0
    for part in pieces(command.size):
        u, v = _both(command[part], measured[part])
        left += float(np.sum((v - offset - gain * u) ** 2))
    return Supplied(gain, offset, math.sqrt(left / n), largest)


def _both(u: NDArray[np.float64], v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    good = np.isfinite(u) & np.isfinite(v)
    return u[good], v[good]


def _voltages(recordings: Sequence[Recording], sensor: Sensor | None) -> list[str]:
    own = [r for r in recordings if r.is_voltage and "measured_voltage_V" in r.columns and not drives_itself(r)]
    found = [(r.name, s) for r in own if (s := supplied(r)) is not None]
    if not found:
        return []
    text = (f"measured_voltage_V ({_names([name for name, _ in found])}) was read, but drives no model, and diagnose "
            "alone looks at it: the command voltage_V drives the model, so that whatever the supply makes of it is "
            "taken for the actuator. ")
    by_gain = max(found, key=lambda f: abs(f[1].gain - 1.0) * f[1].largest_V)
    by_rms = max(found, key=lambda f: f[1].rms_V)
    differs = (f"gain {by_gain[1].gain:.4g} ({by_gain[0]}), and after gain and offset {by_rms[1].rms_V:.3g} V RMS "
               f"({by_rms[0]})")
    remedy = ('To drive the model with what was measured, set columns.voltage_V = "measured_voltage_V" in [format] and '
              'hold = "linear".')
    scatter, limit = stated_voltage(sensor)
    if scatter is None or limit is None:
        return [f"{text}[sensor.voltage] states nothing to judge it by; it differs from the command by {differs}. "
                f"{remedy}"]
    if abs(by_gain[1].gain - 1.0) * by_gain[1].largest_V > limit or by_rms[1].rms_V > _BEYOND * scatter:
        return [f"{text}It differs from the command by more than [sensor.voltage] states: {differs}. The supply does "
                f"something. {remedy}"]
    return [f"{text}It agrees with the command within what [sensor.voltage] states, so little is lost."]


def stated_voltage(sensor: Sensor | None) -> tuple[float | None, float | None]:
    """Scatter (one standard deviation) and systematic error in V that a voltage may have; the one for the other where
    one alone is stated."""
    if sensor is None:
        return None, None
    scatter, limit = sensor.fluctuation, sensor.accuracy
    if sensor.resolution is not None and (scatter is not None or limit is None):
        scatter = math.hypot(scatter or 0.0, sensor.resolution / math.sqrt(12.0))
    return (limit if scatter is None else scatter), (scatter if limit is None else limit)


def _payloads(recordings: Sequence[Recording]) -> list[str]:
    own = [r for r in recordings if r.is_voltage and r.actuator.payload_kg > 0.0]
    out = []
    for mass in dict.fromkeys(r.actuator.payload_kg for r in own):
        loaded = [r for r in own if r.actuator.payload_kg == mass]
        out += payload_lines(loaded[0].actuator, f" ({_names([r.name for r in loaded])})")
    return out


def payload_lines(actuator: Actuator, of: str = "") -> list[str]:
    """A line on the payload of an actuator; none without one. of: what is said behind its number."""
    if actuator.payload_kg == 0.0:
        return []
    weight, area = actuator.payload_kg * _GRAVITY, actuator.total_area_m2
    stress = "" if area is None else f", {weight / area / 1e3:.3g} kPa on its section"
    return [
        f"payload_kg = {actuator.payload_kg:g}{of} is not used by any model. Its weight ({weight:.3g} N{stress}) loads "
        "the stack beforehand: moduli are those of the loaded stack, and where the material is not linear others than "
        "those of mechanical recordings. Its inertia is left out too; near resonance add inertia to the model."
    ]


def _names(names: Sequence[str]) -> str:
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")

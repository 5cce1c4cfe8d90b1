"""Where a command leaves what the calibration has seen, or what the actuator allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..campaign.extent import extent
from ..campaign.schema import Actuator
from ..errors import InputError
from .signal import Signal

#: beyond the largest seen by this share: rounding is no extrapolation
_MARGIN = 0.02


def seen_by(recordings: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """How far the recordings that were fitted went together: `largest_...`, `duration_s`, `frequency_Hz`, ..."""
    out: dict[str, float] = {}
    for r in recordings:
        for key, value in (r.get("seen") or {}).items():
            if value is not None:
                pick = min if key.startswith(("smallest", "step")) else max
                out[key] = pick(out[key], value) if key in out else value
    for key in [k for k in out if k.startswith("smallest_")]:
        # older calibrations hold the largest value with its sign, not the largest size
        largest = key.replace("smallest", "largest", 1)
        out[largest] = max(out.get(largest, 0.0), -out[key])
    return out


def check_units(signal: Signal, actuator: Actuator, seen: Mapping[str, float]) -> None:
    """InputError for a column that cannot be in the unit of its name: kV for V, mm for m."""
    largest = float(np.max(np.abs(signal.values)))
    height = actuator.stack_height_m
    if signal.column == "voltage_V":
        usual = actuator.max_voltage_V or seen.get("largest_voltage_V", 0.0)
        if 0 < largest < 5 and usual >= 500:
            raise InputError(
                f"{signal.label}: voltage_V reaches only {largest:g} V, while the actuator takes {usual:g} V: it seems "
                "to be in kV. Multiply the column by 1000"
            )
        if usual > 0 and largest > 20 * usual:
            raise InputError(
                f"{signal.label}: voltage_V reaches {largest:g} V, while the actuator takes {usual:g} V: it seems to "
                "be in mV. Divide the column by 1000"
            )
    elif signal.column == "displacement_m" and float(np.max(signal.values)) <= 0.0 < largest:
        raise InputError(
            f"{signal.label}: displacement_m is nowhere above 0, and it is positive when the stack gets shorter. "
            "Multiply the column by -1"
        )
    elif height is not None and largest > height:
        raise InputError(
            f"{signal.label}: {signal.column} reaches {largest:g} m, more than the height of the stack ({height:g} m): "
            "it seems to be in mm or um. Write it in m"
        )


def warnings_of(signal: Signal, actuator: Actuator, seen: Mapping[str, float], where: str) -> list[str]:
    """Warnings about a command: beyond the actuator's limits, and beyond what the calibration has seen."""
    own = extent(signal.time_s, signal.values, signal.column)
    largest = float(np.max(np.abs(signal.values)))
    out = []
    if signal.column == "voltage_V":
        limit, frequency = actuator.max_voltage_V, actuator.max_frequency_Hz
        if limit is not None and largest > limit * (1 + 1e-9):
            at = int(np.argmax(np.abs(signal.values)))
            over = float(np.mean(np.abs(signal.values) > limit))
            out.append(
                f"{signal.label}: voltage_V reaches {largest:g} V at {signal.time_s[at]:g} s, beyond max_voltage_V = "
                f"{limit:g} ({100 * over:.2g} % of the rows): do not play it."
            )
        if frequency is not None and own["frequency_Hz"] > frequency * (1 + _MARGIN):
            out.append(
                f"{signal.label}: voltage_V repeats at {own['frequency_Hz']:.3g} Hz, beyond max_frequency_Hz = "
                f"{frequency:g}: do not play it."
            )
        if own["smallest_voltage_V"] < 0:
            out.append(f"{signal.label}: voltage_V is negative in places; the actuator answers to its square.")
    unit = "V" if signal.column == "voltage_V" else "m"
    top = seen.get(f"largest_{signal.column}")
    if top is None:
        out.append(
            f"{where} was fitted to no recording that is driven by {signal.column}: the whole prediction is an "
            "extrapolation from the other kind of recording."
        )
        return out
    beyond = {
        "level": largest > top * (1 + _MARGIN)
        and f"it reaches {largest:g} {unit}, the recordings that were fitted {top:g} {unit}",
        "time": own["duration_s"] > seen["duration_s"] * (1 + _MARGIN)
        and f"it lasts {own['duration_s']:.4g} s, the longest recording that was fitted {seen['duration_s']:.4g} s "
        "(slow creep is known no further)",
        "rate": own["frequency_Hz"] > seen["frequency_Hz"] * (1 + 5 * _MARGIN)
        and f"it repeats at up to {own['frequency_Hz']:.3g} Hz, the recordings that were fitted at up to "
        f"{seen['frequency_Hz']:.3g} Hz",
    }
    for said in beyond.values():
        if said:
            out.append(f"{signal.label}: the prediction is an extrapolation: {said}.")
    return out

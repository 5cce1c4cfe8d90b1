"""What an actuator and its bench allow, and which kinds of recordings they can make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..campaign.schema import MECHANICAL_KINDS, OTHER_KINDS, VOLTAGE_KINDS, Actuator, Campaign, Recording
from ..errors import InputError

#: strain between plates where no recording went further (the reference paper's compression)
_STRAIN = 0.2
#: readings of a wave a period, at least
_READINGS_A_PERIOD = 5.0
_VOLTAGE_RATE_HZ, _PLATE_RATE_HZ = 1000.0, 100.0


@dataclass(frozen=True)
class Limits:
    """Largest voltage (V), largest frequency (Hz), largest stroke of the plates (m; None without plates), readings a
    second of each channel (Hz). offered: kinds of recordings; refused: kind -> why it is not."""

    actuator: Actuator
    voltage_V: float
    frequency_Hz: float
    stroke_m: float | None
    voltage_rate_Hz: float = _VOLTAGE_RATE_HZ
    plate_rate_Hz: float = _PLATE_RATE_HZ
    offered: tuple[str, ...] = VOLTAGE_KINDS
    refused: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    def rate_Hz(self, column: str) -> float:
        """Readings a second of a recording that this column drives."""
        return self.voltage_rate_Hz if column == "voltage_V" else self.plate_rate_Hz


def limits_of_actuator(actuator: Actuator, mechanical: bool) -> Limits:
    """Limits where nothing is known but the actuator."""
    stroke = _STRAIN * actuator.stack_height_m if mechanical and actuator.stack_height_m and actuator.total_area_m2 \
        else None
    return Limits(actuator, actuator.max_voltage_V or 1200.0, min(actuator.max_frequency_Hz or 100.0, 100.0), stroke,
                  offered=(*VOLTAGE_KINDS, *(MECHANICAL_KINDS if stroke else ())))


def limits_of(
    campaign: Campaign, models: dict[str, bool], max_voltage_V: float | None = None,
    max_frequency_Hz: float | None = None,
) -> Limits:
    """What the bench of a campaign can do and `calibrate` can use.

    models: name -> whether it is a black box, which knows no force. max_voltage_V, max_frequency_Hz: limits of the
    user's own, below those of the actuator. Raises InputError where no limit of the voltage is known, or a limit is
    above the actuator's.
    """
    first = next((r for r in campaign.recordings if r.role == "identify"), campaign.recordings[0])
    actuator = first.actuator
    electric = [r for r in campaign.recordings if r.is_voltage]
    plates = [r for r in campaign.recordings if r.is_mechanical]
    notes: list[str] = []
    top = actuator.max_voltage_V
    if top is None:
        if not electric and max_voltage_V is None:
            raise InputError(f"{campaign.name}: no limit of the voltage is known; write max_voltage_V under [actuator] "
                             "in campaign.toml, or give --max-voltage")
        top = max((_largest(r, "voltage_V") for r in electric), default=max_voltage_V or 0.0)
        if max_voltage_V is None:
            notes.append(f"max_voltage_V is not stated under [actuator]: nothing above the {top:.4g} V that the "
                         "recordings reached is proposed")
    fastest = min(actuator.max_frequency_Hz or 100.0, 100.0)
    top = _own(max_voltage_V, top, "--max-voltage", "V", actuator.max_voltage_V is not None)
    fastest = _own(max_frequency_Hz, fastest, "--max-frequency", "Hz", True)
    rate = _rate(electric, _VOLTAGE_RATE_HZ)
    refused = _refused(campaign, models)
    offered = tuple(k for k in (*VOLTAGE_KINDS, *MECHANICAL_KINDS) if k not in dict(refused))
    stroke = None
    if "compression" in offered:
        height = actuator.stack_height_m or 0.0
        stroke = max([_STRAIN * height, *(np.ptp(_finite(r, "position_m")) for r in plates)])
        stroke = float(min(stroke, 0.5 * height))
    return Limits(actuator, top, min(fastest, rate / _READINGS_A_PERIOD), stroke, rate,
                  _rate(plates, _PLATE_RATE_HZ), offered, refused, tuple(notes))


def _own(given: float | None, limit: float, option: str, unit: str, known: bool) -> float:
    if given is None:
        return limit
    if not np.isfinite(given) or given <= 0:
        raise InputError(f"{option} {given:g}: give a positive number of {unit}")
    if known and given > limit * (1 + 1e-9):
        raise InputError(f"{option} {given:g}: the actuator takes {limit:g} {unit}; give less, or correct [actuator] "
                         "in campaign.toml")
    return given


def _refused(campaign: Campaign, models: dict[str, bool]) -> tuple[tuple[str, str], ...]:
    """Kinds that are not offered, and why."""
    out = [(kind, "calibrate reads it, but no structure makes use of it yet") for kind in OTHER_KINDS]
    boxes = [name for name, box in models.items() if box]
    for kind in MECHANICAL_KINDS:
        lacking = [k for k in ("stack_height_m", "total_area_m2")
                   if getattr(campaign.recordings[0].actuator, k) is None]
        if boxes:
            out.append((kind, f"{', '.join(boxes)} is a black box and knows no force"))
        elif "force" not in campaign.sensors or "position" not in campaign.sensors:
            out.append((kind, "campaign.toml states no [sensor.force] and [sensor.position]"))
        elif lacking:
            out.append((kind, f"[actuator] lacks {', '.join(lacking)}"))
    return tuple(out)


def _finite(r: Recording, column: str) -> np.ndarray:
    values = r.columns[column]
    return values[np.isfinite(values)]


def _largest(r: Recording, column: str) -> float:
    return float(np.max(np.abs(_finite(r, column)), initial=0.0))


def _rate(recordings: list[Recording], default: float) -> float:
    steps = [float(np.median(np.diff(r.time_s[:10001]))) for r in recordings if r.n > 2]
    return 1.0 / float(np.median(steps)) if steps else default

"""What an actuator and its bench allow, and which kinds of recordings they can make."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..campaign.schema import MECHANICAL_KINDS, OTHER_KINDS, VOLTAGE_KINDS, Actuator, Campaign, Recording
from ..errors import InputError
from ..models.electrostatics import VOLTAGE_GEOMETRY

#: what the answer of a position between plates depends on
_PLATE_GEOMETRY = ("stack_height_m", "total_area_m2")
#: strain between plates where no recording went further (the reference paper's compression)
_STRAIN = 0.2
#: readings of a wave a period, at least
_READINGS_A_PERIOD = 5.0
_VOLTAGE_RATE_HZ, _PLATE_RATE_HZ = 1000.0, 100.0


@dataclass(frozen=True)
class Limits:
    """Largest voltage (V; 0 where none is known), largest frequency (Hz), largest stroke of the plates (m; None without
    plates), readings a second of each channel (Hz). offered: kinds of recordings; refused: kind -> why it is not."""

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


def limits_of_actuator(actuator: Actuator, mechanical: bool, recordings: Iterable[Recording] = ()) -> Limits:
    """Limits where nothing is known but the actuator; kinds whose answer its geometry gives.

    recordings: of this bench, which say how often it reads.
    """
    recordings = list(recordings)
    stroke = _STRAIN * (actuator.stack_height_m or 0.0) if mechanical and not _lacking(actuator, _PLATE_GEOMETRY) \
        else None
    electric = () if _lacking(actuator, VOLTAGE_GEOMETRY) else VOLTAGE_KINDS
    rates = (_rate([r for r in recordings if r.is_voltage], _VOLTAGE_RATE_HZ),
             _rate([r for r in recordings if r.is_mechanical], _PLATE_RATE_HZ))
    fastest = min(actuator.max_frequency_Hz or 100.0, 100.0, rates[0] / _READINGS_A_PERIOD)
    return Limits(actuator, actuator.max_voltage_V or 1200.0, fastest, stroke, *rates,
                  offered=(*electric, *(MECHANICAL_KINDS if stroke else ())))


def limits_of(
    campaign: Campaign, models: dict[str, bool], max_voltage_V: float | None = None,
    max_frequency_Hz: float | None = None,
) -> Limits:
    """What the bench of a campaign can do and `calibrate` can use.

    models: name -> whether it is a black box, which knows no force. max_voltage_V, max_frequency_Hz: limits of the
    user's own, below those of the actuator. Raises InputError where a limit is above the actuator's, or no kind of
    recording can be offered.
    """
    first = next((r for r in campaign.recordings if r.role == "identify"), campaign.recordings[0])
    actuator = first.actuator
    electric = [r for r in campaign.recordings if r.is_voltage]
    plates = [r for r in campaign.recordings if r.is_mechanical]
    notes: list[str] = []
    top = actuator.max_voltage_V
    if top is None:
        top = max((_largest(r, "voltage_V") for r in electric), default=max_voltage_V or 0.0)
        if electric and max_voltage_V is None:
            notes.append(f"max_voltage_V is not stated under [actuator]: nothing above the {top:.4g} V that the "
                         "recordings reached is proposed")
    fastest = min(actuator.max_frequency_Hz or 100.0, 100.0)
    top = _own(max_voltage_V, top, "--max-voltage", "V", actuator.max_voltage_V is not None)
    fastest = _own(max_frequency_Hz, fastest, "--max-frequency", "Hz", True)
    rate = _rate(electric, _VOLTAGE_RATE_HZ)
    refused = (*((kind, "calibrate reads it, but no structure makes use of it yet") for kind in OTHER_KINDS),
               *_refused_voltage(actuator, top), *_refused_plates(campaign, actuator, models))
    offered = offered_of(campaign.name, refused)
    stroke = None
    if "compression" in offered:
        height = actuator.stack_height_m or 0.0
        stroke = max([_STRAIN * height, *(np.ptp(_finite(r, "position_m")) for r in plates)])
        stroke = float(min(stroke, 0.5 * height))
    return Limits(actuator, top, min(fastest, rate / _READINGS_A_PERIOD), stroke, rate,
                  _rate(plates, _PLATE_RATE_HZ), offered, refused, tuple(notes))


def offered_of(where: str, refused: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Kinds that are not refused. Raises InputError, with the reasons, where none is left."""
    why = dict(refused)
    offered = tuple(k for k in (*VOLTAGE_KINDS, *MECHANICAL_KINDS) if k not in why)
    if not offered:
        raise InputError(f"{where}: no experiment can be proposed. With a voltage: {why['voltage']}; between plates: "
                         f"{why['compression']}")
    return offered


def refuse_unreal(given: float | None, option: str, unit: str) -> None:
    """Raise InputError for a limit that nothing can have."""
    if given is not None and (not np.isfinite(given) or given <= 0):
        raise InputError(f"{option} {given:g}: give a positive number of {unit}")


def _own(given: float | None, limit: float, option: str, unit: str, known: bool) -> float:
    if given is None:
        return limit
    refuse_unreal(given, option, unit)
    if known and given > limit * (1 + 1e-9):
        raise InputError(f"{option} {given:g}: the actuator takes {limit:g} {unit}; give less, or correct [actuator] "
                         "in campaign.toml")
    return given


def _lacking(actuator: Actuator, names: tuple[str, ...]) -> str:
    return ", ".join(n for n in names if getattr(actuator, n) is None)


def _refused_voltage(actuator: Actuator, top_V: float) -> list[tuple[str, str]]:
    """Kinds with a voltage, and why they are not offered."""
    if lacking := _lacking(actuator, VOLTAGE_GEOMETRY):
        why = f"[actuator] lacks {lacking}"
    elif top_V <= 0:
        why = "no limit of the voltage is known; write max_voltage_V under [actuator] in campaign.toml, or give " \
              "--max-voltage"
    else:
        return []
    return [(kind, why) for kind in VOLTAGE_KINDS]


def _refused_plates(campaign: Campaign, actuator: Actuator, models: dict[str, bool]) -> list[tuple[str, str]]:
    """Kinds between plates, and why they are not offered."""
    boxes = [name for name, box in models.items() if box]
    if boxes:
        why = f"{', '.join(boxes)} is a black box and knows no force"
    elif "force" not in campaign.sensors or "position" not in campaign.sensors:
        why = "campaign.toml states no [sensor.force] and [sensor.position]"
    elif lacking := _lacking(actuator, _PLATE_GEOMETRY):
        why = f"[actuator] lacks {lacking}"
    else:
        return []
    return [(kind, why) for kind in MECHANICAL_KINDS]


def _finite(r: Recording, column: str) -> np.ndarray:
    values = r.columns[column]
    return values[np.isfinite(values)]


def _largest(r: Recording, column: str) -> float:
    return float(np.max(np.abs(_finite(r, column)), initial=0.0))


def _rate(recordings: list[Recording], default: float) -> float:
    steps = [float(np.median(np.diff(r.time_s[:10001]))) for r in recordings if r.n > 2]
    return 1.0 / float(np.median(steps)) if steps else default

"""Whether the recordings of a campaign can be of one type of actuator: stiffnesses that are too far apart.

Force and travel of a mechanical recording make a secant modulus, voltage and stroke another (Maxwell stress). Rates,
softening, a stiffening law and a layer that moves freely at first set them apart by factors of up to some tens, a
column in another unit (kN for N, mm for m) by a thousand. What the recordings do not say is given its range: the softer
recording counts with the travel since its contact and the stiffer one with all of its travel, so that a long way
through air is no softness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.plausibility import TYPICAL_MODULUS, maxwell_stroke, usual_span
from bayes_dea.campaign.schema import Recording, Sensor

#: between what a stack can do (some tens) and a unit (a thousand)
_FACTOR = 200.0
#: share of the height that a recording must have travelled, below it the force may have moved for other reasons
_LEAST_STRAIN = 1e-3
#: a reading moves where its span is this many times its scatter
_MOVES = 20.0
#: share of the largest force that means contact
_CONTACT = 0.05
#: what a unit of the force, or of the way, that was not stated makes of a stiffness
_TOO_SOFT = ('in kN, say so: columns.force_N = { name = "force_N", unit = "kN" } in its [format]; or is position_m in '
             "mm?")
_TOO_STIFF = ('in mN, say so: columns.force_N = { name = "force_N", unit = "mN" } in its [format]; or was position_m '
              "divided by 1000 once too often?")


@dataclass(frozen=True)
class _Modulus:
    """What a recording says of the modulus in Pa: at least `low`, at most `high`."""

    recording: Recording
    low: float
    high: float


def check_stiffness(recordings: Sequence[Recording], sensors: Mapping[str, Sensor]) -> list[str]:
    """A text that names file, column and remedy where two recordings contradict each other by a unit, or none."""
    found = [m for r in recordings if r.is_mechanical and (m := _mechanical(r, sensors)) is not None]
    if not found:
        return []
    # a supply that does not follow makes a stroke smaller, and a drift counts least beside the largest
    largest = max((r for r in recordings if r.is_voltage), key=lambda r: usual_span(r.columns["displacement_m"]),
                  default=None)
    if largest is not None and (m := _electrical(largest, sensors)) is not None:
        found.append(m)
    soft, stiff = min(found, key=lambda m: m.high), max(found, key=lambda m: m.low)
    if stiff.low <= _FACTOR * soft.high:
        return _far_from_an_elastomer(soft, stiff)
    # the one that is farther from an elastomer is the one to look at; strokes are looked at by `plausibility`
    odd, other = (soft, stiff) if TYPICAL_MODULUS / soft.high > stiff.low / TYPICAL_MODULUS else (stiff, soft)
    if odd.recording.is_voltage:
        odd, other = other, odd
    columns = "displacement_m and voltage_V" if other.recording.is_voltage else "force_N and position_m"
    return [f"{odd.recording.name}: force_N and position_m make a stiffness of about {_middle(odd):.2g} Pa, but "
            f"{columns} of {other.recording.name} one of about {_middle(other):.2g} Pa, and no actuator has both. If "
            f"force_N of {odd.recording.name} is {_TOO_SOFT if odd is soft else _TOO_STIFF}"]


def _far_from_an_elastomer(soft: _Modulus, stiff: _Modulus) -> list[str]:
    """The same where all recordings agree, in a unit that no dielectric elastomer has."""
    if stiff.low > _FACTOR * TYPICAL_MODULUS:
        odd, remedy = stiff, _TOO_STIFF
    elif soft.high < TYPICAL_MODULUS / _FACTOR:
        odd, remedy = soft, _TOO_SOFT
    else:
        return []
    if odd.recording.is_voltage:
        return []
    return [f"{odd.recording.name}: force_N and position_m make a stiffness of about {_middle(odd):.2g} Pa, where a "
            f"dielectric elastomer has about {TYPICAL_MODULUS:.0g} Pa. If force_N is {remedy} Or is a length or an "
            "area of [actuator] in another unit?"]


def _middle(m: _Modulus) -> float:
    return float(np.sqrt(m.low * m.high))


def _mechanical(r: Recording, sensors: Mapping[str, Sensor]) -> _Modulus | None:
    height, area = r.actuator.stack_height_m, r.actuator.total_area_m2
    position, force = r.columns["position_m"], r.columns["force_N"]
    if height is None or area is None:
        return None
    travel, load = usual_span(position), usual_span(force)
    noise = sensors.get("position", Sensor())
    if travel < max(_LEAST_STRAIN * height, _MOVES * max(noise.fluctuation or 0.0, noise.resolution or 0.0)):
        return None
    if not load > _MOVES * _step_scatter(force):
        return None
    return _Modulus(r, load / area * height / travel, load / area * height / _since_contact(position, force, travel))


def _since_contact(position: NDArray[np.float64], force: NDArray[np.float64], travel: float) -> float:
    """Travel between the last row before the largest force that is all but free of it, and that row."""
    known = np.flatnonzero(np.isfinite(position) & np.isfinite(force))
    x, f = position[known], force[known]
    f = f - np.median(f[: max(1, f.size // 100)])
    top = int(np.argmax(np.abs(f)))
    free = np.flatnonzero(np.abs(f[:top]) < _CONTACT * np.abs(f[top]))
    moved = abs(float(x[top] - x[free[-1]])) if free.size else 0.0
    return moved if moved > _LEAST_STRAIN * travel else travel


def _step_scatter(values: NDArray[np.float64]) -> float:
    """Scatter of a column (n,) from its steps, most of which are those of the noise."""
    steps = np.diff(values[: 1_000_000])
    steps = steps[np.isfinite(steps)]
    return float(1.4826 * np.median(np.abs(steps - np.median(steps)))) / np.sqrt(2.0) if steps.size else np.inf


def _electrical(r: Recording, sensors: Mapping[str, Sensor]) -> _Modulus | None:
    v = r.columns["voltage_V"]
    expected = maxwell_stroke(r.actuator, max(float(np.nanmax(v)), -float(np.nanmin(v))) ** 2)
    stroke = usual_span(r.columns["displacement_m"])
    noise = sensors.get("displacement", Sensor())
    if not expected or not stroke > _MOVES * max(noise.fluctuation or 0.0, noise.resolution or 0.0):
        return None
    if not stroke > _MOVES * _step_scatter(r.columns["displacement_m"]):
        return None
    modulus = TYPICAL_MODULUS * expected / stroke
    return _Modulus(r, modulus, modulus)

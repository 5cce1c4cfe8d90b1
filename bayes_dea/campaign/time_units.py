"""Whether times are in another unit than s: one recording's among the others, or all by what their names say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from bayes_dea.campaign.plausibility import dominant_frequency
from bayes_dea.campaign.schema import Recording

#: times the unit of the others, and what it is called
_FACTORS = ((1e3, "ms"), (1e6, "us"), (1.0 / 60.0, "min"), (1.0 / 3600.0, "h"))
#: two steps are one and the same within this share, and one is a factor of another within the next
_SAME, _NEAR = 0.02, 0.002
_FEWEST_OTHERS = 2
_STEPS = 2_000
#: a frequency in a file's name, with the letter that stands before Hz
_NAMED = re.compile(r"(?<![\d.,])(\d+(?:[.,p]\d+)?)[ _-]?([mk]?)Hz(?![a-z])", re.IGNORECASE)
_LETTERS = {"": 1.0, "m": 1e-3, "k": 1e3}
#: a frequency in a name is that of the command within this share, rounded as names are
_AS_NAMED = 0.06


def check_time_units(recordings: Sequence[Recording]) -> list[str]:
    """A warning for each voltage recording whose time step is a factor between units away from that of all others.

    A recording at 1 Hz among others at 1 kHz may be meant, so nothing is refused.
    """
    with_time = [r for r in recordings if r.is_voltage and r.time_s.size > 1]
    steps = np.array([_step(r) for r in with_time])
    out = []
    for i, r in enumerate(with_time):
        others = np.delete(steps, i)
        if others.size < _FEWEST_OTHERS or not np.all(others > 0.0) or np.ptp(others) > _SAME * others[0]:
            continue
        for factor, unit in _FACTORS:
            if abs(steps[i] / (factor * np.median(others)) - 1.0) < _NEAR:
                out.append(
                    f"{r.name}: its time step is {steps[i]:g} s, that of the other voltage recordings {others[0]:g} s. "
                    f'If its times are in {unit}, map them: columns.time_s = {{ name = "time_s", unit = "{unit}" }} in '
                    "its [format]; if it was recorded so, it is right as it is."
                )
    return out


def _step(r: Recording) -> float:
    """Median step of the first rows in s."""
    return float(np.median(np.diff(np.asarray(r.time_s[: _STEPS + 1], float))))


def check_named_frequencies(recordings: Sequence[Recording]) -> list[str]:
    """A warning for each recording whose name gives a frequency that its command has in another unit of time.

    Several in one such line. A number of Hz in a name may be a sampling rate: one that the actuator is not driven at
    is none of the command's, and nothing is refused.
    """
    found: dict[str, list[tuple[str, float, float]]] = {}
    for r in recordings:
        named = _named_Hz(r)
        if not named or not r.is_voltage or r.time_s.size < 2:
            continue
        seen = dominant_frequency(r.columns["voltage_V"], r.time_s)
        if seen <= 0.0:
            continue
        for factor, unit in _FACTORS:
            if abs(seen * factor / named - 1.0) < _AS_NAMED:
                found.setdefault(unit, []).append((r.name, named, seen))
    out = []
    for unit, several in found.items():
        name, named, seen = several[0]
        more = f" (so in {len(several) - 1} more)" if len(several) > 1 else ""
        out.append(
            f"{name}: its name says {named:g} Hz, its command alternates at {seen:.3g} Hz{more}. If its times are in "
            f'{unit}, map them: columns.time_s = {{ name = "time_s", unit = "{unit}" }} in its [format]; if they are '
            "in s, it is right as it is."
        )
    return out


def _named_Hz(r: Recording) -> float | None:
    """The frequency in the name of a recording, in Hz; None without one, or where the actuator is not driven at it."""
    match = _NAMED.search(PurePath(r.name).stem)
    if match is None:
        return None
    value = float(re.sub("[,p]", ".", match[1].lower())) * _LETTERS[match[2].lower()]
    limit = r.actuator.max_frequency_Hz
    return value if value > 0.0 and (limit is None or value <= 1.2 * limit) else None

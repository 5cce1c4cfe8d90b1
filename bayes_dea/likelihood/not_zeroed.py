"""A sensor whose zero is not that of the actuator at rest: absolute readings, such as a laser's stand-off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..models.missing_drive import drive_values
from ..noise.stated import NoiseTerms
from .prepare import Prepared, begins_under_voltage

#: offset at rest, in sds of what the sensor is allowed, from which on it was not zeroed
_NOT_ALLOWED = 6.0
#: readings at rest that tell an offset
_LEAST, _MOST = 5, 10_000
#: share of the largest voltage that is none
_NOTHING = 0.01


def stands_at(p: Prepared) -> float:
    """What a displacement reads (m) before its first voltage acts; 0 where nobody knows.

    Of a recording that begins under voltage it is known where the readings stay away from zero by more than they span.
    """
    if not p.recording.rested:
        return 0.0  # what the recording before left behind
    drive = drive_values(p.recording)
    if begins_under_voltage(drive):
        seen = p.some(_MOST)
        low, high = np.quantile(seen, [0.001, 0.999])
        nearest = low if low > 0.0 else -high
        return float(seen[0]) if nearest > high - low else 0.0
    at_rest = np.abs(drive[:_MOST]) <= _NOTHING * max(float(np.max(drive)), -float(np.min(drive)))
    until = at_rest.size if at_rest.all() else int(np.argmin(at_rest))
    seen = p.y[:until][p.observed[:until]]
    return float(np.median(seen)) if seen.size >= _LEAST else 0.0


def with_free_offsets(
    prepared: Sequence[Prepared], terms: Mapping[str, NoiseTerms]
) -> tuple[dict[str, NoiseTerms], list[str]]:
    """Noise terms in which the offset of a sensor that was not zeroed is free, and a line on such recordings.

    By its stated accuracy such an offset is hundreds of standard deviations away; the fit would bend to avoid it.
    """
    out, told = dict(terms), []
    for p in prepared:
        level, allowed = stands_at(p), terms[p.name].offset_sd
        systematic = (p.sensor.accuracy or 0.0) / np.sqrt(3.0)
        if abs(level) > _NOT_ALLOWED * max(allowed, systematic):
            out[p.name] = replace(terms[p.name], offset_sd=abs(level))
            told.append(f"{p.name} {1e6 * level:.4g} um")
    if not told:
        return out, []
    return out, [
        f"displacement_m is not zero at rest, by far more than the sensor's stated accuracy: {', '.join(told)}. These "
        "readings are absolute; the offset of such a recording is left free. Where the first reading is the actuator "
        'at rest, say so: columns.displacement_m = { name = "...", offset = "first" } in [format]'
    ]

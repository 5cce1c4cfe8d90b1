"""Whether a sensor is connected at all: a reading that stays the same while what drives the actuator moves.

One such recording among several may be too small a drive for a coarse sensor, and is warned of (`plausibility` refuses
it where the actuator must have moved by more than the sensor resolves). Where no recording says otherwise, nothing was
measured, and whatever a fit makes of it is about the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_dea.campaign.schema import Recording
from bayes_dea.campaign.vocabulary import COLUMNS

#: what drives the readings of a column, by the kind's first columns
_DRIVES = ("voltage_V", "position_m", "force_N")


def check_dead_sensors(recordings: Sequence[Recording]) -> list[str]:
    """A text for every observed column (`displacement_m`, `force_N`) that is constant in all driven recordings."""
    problems = []
    for output in ("displacement_m", "force_N"):
        observed = [r for r in recordings if r.kind in COLUMNS and r.output == output]
        if any(_moves(r) for r in observed):
            continue
        driven = [r for r in observed if _driven(r)]
        if driven:
            names = ", ".join(r.name for r in driven)
            value = float(np.nanmin(driven[0].columns[output]))
            problems.append(f"{names}: {output} never changes (it stays at {value:g}) while {_drive(driven[0])} moves; "
                            f"is the sensor connected, and is it the right column? Record it again, or map the column "
                            "in its [format].")
    return problems


def _drive(r: Recording) -> str:
    return next(name for name in _DRIVES if name in r.columns and name != r.output)


def _driven(r: Recording) -> bool:
    """Whether the drive moves in rows that have a reading."""
    drive = r.columns[_drive(r)][np.isfinite(r.columns[r.output])]
    return bool(np.fmax.reduce(drive) > np.fmin.reduce(drive))


def _moves(r: Recording) -> bool:
    values = r.columns[r.output]
    return bool(np.fmax.reduce(values) > np.fmin.reduce(values))

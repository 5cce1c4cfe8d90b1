"""What a recording asks of the bench, and what belongs to its sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]
#: parameters of every effect by its name
Effects = dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class VoltageRecording:
    """A command (n,) V at times (n,) s that are step_s apart, and the room's temperature (n,) degC.

    index: place in the order of drawing, which the disturbances' own random numbers count by. offset_m and gain are
    the sensor's.
    """

    file: str
    kind: str
    role: str
    index: int
    time_s: Array
    voltage_V: Array
    temperature_C: Array
    step_s: float = 1e-3
    offset_m: float = 0.0
    gain: float = 1.0


@dataclass(frozen=True, eq=False)
class PressRecording:
    """Positions (n,) m of the plate at times (n,) s that are step_s apart; strain (n,) of a stack that follows."""

    file: str
    kind: str
    role: str
    time_s: Array
    position_m: Array
    strain: Array
    slack_m: float
    step_s: float = 0.01


Recording = VoltageRecording | PressRecording

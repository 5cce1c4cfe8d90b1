"""Electrical and electrostatic stages with nothing left out on purpose: command -> Maxwell stress.

Equation (1) of the reference paper, on the area of the electrodes and carried by the whole section:

    s = eps0 eps_r (V / z0)^2 A_e / A_c
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator, Recording
from ..campaign.scratch import BLOCK, all_finite, beside, computed, pieces
from ..errors import InputError
from .lags import Drive, make_drive
from .missing_drive import drive_values

VACUUM_PERMITTIVITY = 8.8541878128e-12  # F/m, CODATA 2018; 3.8542e-12 in the reference paper is a misprint
VOLTAGE_GEOMETRY = ("layers", "layer_thickness_m", "relative_permittivity", "electrode_area_m2", "total_area_m2")


def require(actuator: Actuator, names: tuple[str, ...], what: str) -> None:
    """InputError that names every missing geometry entry and says where to write it."""
    missing = [n for n in names if getattr(actuator, n) is None]
    if missing:
        raise InputError(f"{what} needs {', '.join(missing)}; write it under [actuator] in campaign.toml")


def stress_factor(actuator: Actuator) -> float:
    """Pa per V^2."""
    thickness, permittivity = _number(actuator, "layer_thickness_m"), _number(actuator, "relative_permittivity")
    share = _number(actuator, "electrode_area_m2") / _number(actuator, "total_area_m2")
    return VACUUM_PERMITTIVITY * permittivity / thickness**2 * share


def stroke_factor(actuator: Actuator) -> float:
    """Displacement in m per unit strain: layers x layer thickness."""
    return _number(actuator, "layers") * _number(actuator, "layer_thickness_m")


def _number(actuator: Actuator, name: str) -> float:
    if getattr(actuator, name) is None:  # name all that is missing at once
        require(actuator, VOLTAGE_GEOMETRY, "a voltage recording")
    return float(getattr(actuator, name))


def filled_input(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A column with NaN cells replaced by the last finite value before them (the first finite one at the start).

    For what is looked at beside the drive; what drives a model is filled by `missing_drive.driven`.
    """
    if all_finite(values):
        return values
    out = beside(values)
    last = np.nan
    for part in pieces(values.size, BLOCK):
        # the last finite one so far stands before the piece
        here = np.concatenate([[last], values[part]])
        index = np.where(np.isfinite(here), np.arange(here.size), 0)
        out[part] = here[np.maximum.accumulate(index)][1:]
        last = out[part.stop - 1]
    for part in pieces(values.size, BLOCK):
        found = np.isfinite(out[part])
        if found.any():
            first = part.start + int(np.argmax(found))
            out[:first] = out[first]
            break
    return out


def voltage_drive(recording: Recording) -> Drive:
    """Maxwell stress of a voltage recording (Pa) as a drive for the mechanical stage."""
    factor = stress_factor(recording.actuator)
    V = drive_values(recording)
    middle = None
    if recording.hold == "linear":
        middle = beside(V)
        for part in pieces(V.size, BLOCK):
            before = V[np.maximum(np.arange(part.start - 1, part.stop - 1), 0)]
            middle[part] = factor * (0.5 * (V[part] + before)) ** 2
    return make_drive(recording.time_s, computed(lambda v: factor * v**2, V), recording.hold, middle)

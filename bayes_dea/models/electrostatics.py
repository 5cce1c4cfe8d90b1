"""Electrical and electrostatic stages with nothing left out on purpose: command -> Maxwell stress.

Equation (1) of the reference paper, on the area of the electrodes and carried by the whole section:

    s = eps0 eps_r (V / z0)^2 A_e / A_c
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator, Recording
from ..errors import InputError
from .lags import Drive, make_drive

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
    """Input with NaN cells replaced by the last finite value before them (the first finite one at the start).

    A command is held until it changes; a cell that was not recorded says nothing else.
    """
    bad = ~np.isfinite(values)
    if not bad.any():
        return values
    index = np.where(bad, 0, np.arange(values.size))
    np.maximum.accumulate(index, out=index)
    out = values[index]
    first = np.argmax(~bad)
    out[:first] = values[first]
    return out


def voltage_drive(recording: Recording) -> Drive:
    """Maxwell stress of a voltage recording (Pa) as a drive for the mechanical stage."""
    factor = stress_factor(recording.actuator)
    V = filled_input(recording.columns["voltage_V"])
    middle = factor * (0.5 * (V + np.concatenate([V[:1], V[:-1]]))) ** 2 if recording.hold == "linear" else None
    return make_drive(recording.time_s, factor * V**2, recording.hold, middle)

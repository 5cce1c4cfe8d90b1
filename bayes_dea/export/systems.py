"""From a calibration to its state spaces: MAP, posterior mean and draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..errors import InputError
from ..models.electrostatics import stress_factor, stroke_factor
from ..models.model import Model
from ..models.plant import Plant, plant_of
from ..prediction.calibrated import Calibrated
from .state_space import StateSpace, from_modes
from .tangent import Lags, around, check_effects, in_square

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Systems:
    """State spaces of a calibration; `about` says what they are (input, output, hold, ...), `warnings` what not."""

    map: StateSpace
    mean: StateSpace
    draws: tuple[StateSpace, ...] = field(repr=False)
    about: dict[str, Any]
    warnings: tuple[str, ...] = ()


def systems(
    c: Calibrated, Ts: float, draws: int, hold: str, specimen: str, at_voltage_V: float | None
) -> Systems:
    """State spaces of MAP, posterior mean (of the physical parameters) and `draws` posterior draws.

    Input is V^2; with at_voltage_V the deviation of V from a voltage at which the actuator has settled. Raises
    InputError for a model that is not linear without an operating voltage, where there is no such point, and for
    effects that have no state space.
    """
    model = c.structure.model
    actuator = c.actuator(specimen)
    everything = model.physical(c.coordinates(specimen, np.arange(len(c.draws))))
    at_map = model.physical(c.coordinates(specimen))
    at_mean = {name: np.array([v.mean()]) for name, v in everything.items()}
    some = {name: v[c.rows(draws)] for name, v in everything.items()} if draws else {}
    notes = check_effects(model)
    has_modes = at_voltage_V is None and not model.spec.effects and model.is_linear
    settled = None
    if at_voltage_V is None:
        names = ("voltage_squared_V2", "displacement_m")
        words = "u = V^2 (the square of the voltage, in V^2), y = displacement in m (shortening is positive)"
    else:
        names = ("delta_voltage_V", "delta_displacement_m")
        settled = around(plants_at(model, at_map, actuator)[0], at_voltage_V, model.name).settled
        words = (
            f"u = V - {at_voltage_V:g} V, y = displacement in m less {settled:.6g} m (MAP), where the "
            "actuator has settled; for small changes of V"
        )

    def of(values: Mapping[str, Array]) -> list[StateSpace]:
        if has_modes:
            D, k, T = model.modes_of(values)
            gain = stress_factor(actuator) * stroke_factor(actuator)
            return [from_modes(gain * D[i], gain * k[i], T[i], Ts, hold) for i in range(len(D))]
        found = [_lags(model, plant, at_voltage_V, actuator) for plant in plants_at(model, values, actuator)]
        return [from_modes(x.direct, x.gain, x.T, Ts, hold) for x in found]

    said = {
        "end": "the row's input was in force until the row's time",
        "start": "the row's input is in force from the row's time on, the reading is taken just before it",
        "zoh": "as c2d(sys, Ts, 'zoh'): the row's input is in force from the row's time on, the reading is taken just "
        "after it",
    }[hold]
    about = {
        "model": model.name,
        "campaign": str(c.summary.get("campaign")),
        "specimen": specimen,
        "input_name": names[0],
        "output_name": names[1],
        "units": f"u in {'V^2' if at_voltage_V is None else 'V'}, y in m, time in s",
        "hold": hold,
        "at_voltage_V": at_voltage_V,
        "settled_displacement_m": settled,
        "Ts": Ts,
        "comment": f"{model.name}: {words}. Discrete: {said}. From rest all states are zero. Modal coordinates, the "
        "slowest mode first.",
    }
    return Systems(of(at_map)[0], of(at_mean)[0], tuple(of(some)) if some else (), about, tuple(notes))


def plants_at(model: Model, values: Mapping[str, Array], actuator: Actuator) -> list[Plant]:
    """Plants of physical values by name, each (B,)."""
    count = len(next(iter(values.values())))
    return [plant_of(model, {k: float(v[i]) for k, v in values.items()}, actuator) for i in range(count)]


def _lags(model: Model, plant: Plant, at_voltage_V: float | None, actuator: Actuator) -> Lags:
    if at_voltage_V is not None:
        return around(plant, at_voltage_V, model.name)
    found = in_square(plant)
    if found is None:
        raise InputError(
            f"{model.name} is not linear: it has no state space for all voltages. Give an operating point, e.g. "
            f"--at-voltage {0.5 * (actuator.max_voltage_V or 1000.0):g}: the state space for small changes of the "
            "voltage around it, from the settled state"
        )
    return found

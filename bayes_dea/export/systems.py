"""From a calibration to its state spaces: MAP, posterior mean and draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..models.electrostatics import stress_factor, stroke_factor
from ..models.model import Model
from ..models.networks import maxwell_to_modes
from ..models.static import LAWS, law_stress_tangent
from ..prediction.calibrated import Calibrated
from .state_space import StateSpace, from_modes

Array = NDArray[np.float64]
#: largest strain at which an operating point is sought
_E_MOST = 0.9


@dataclass(frozen=True)
class Systems:
    """State spaces of a calibration; `about` says what they are (input, output, hold, ...)."""

    map: StateSpace
    mean: StateSpace
    draws: tuple[StateSpace, ...] = field(repr=False)
    about: dict[str, Any]


def systems(
    c: Calibrated, Ts: float, draws: int, hold: str, specimen: str, at_voltage_V: float | None
) -> Systems:
    """State spaces of MAP, posterior mean (of the physical parameters) and `draws` posterior draws.

    Input is V^2; with at_voltage_V the deviation of V from a voltage at which the actuator has settled. Raises
    InputError for a law that is not linear without an operating voltage, and where there is no such point.
    """
    model = c.structure.model
    actuator = c.actuator(specimen)
    factor, stroke = stress_factor(actuator), stroke_factor(actuator)
    everything = model.physical(c.coordinates(specimen, np.arange(len(c.draws))))
    at_map = model.physical(c.coordinates(specimen))
    at_mean = {name: np.array([v.mean()]) for name, v in everything.items()}
    some = {name: v[c.rows(draws)] for name, v in everything.items()} if draws else {}
    if at_voltage_V is None:
        if not model.is_linear:
            raise InputError(
                f"{model.name} is not linear: it has no state space for all voltages. Give an operating point, e.g. "
                f"--at-voltage {0.5 * (actuator.max_voltage_V or 1000.0):g}: the state space for small changes of the "
                "voltage around it, from the settled state"
            )
        gain, strain_at = factor * stroke, 0.0
        names = ("voltage_squared_V2", "displacement_m")
        words = "u = V^2 (the square of the voltage, in V^2), y = displacement in m (shortening is positive)"
    else:
        gain = 2.0 * at_voltage_V * factor * stroke
        strain_at = float(_settled(model, at_map, factor * at_voltage_V**2)[0][0])
        names = ("delta_voltage_V", "delta_displacement_m")
        words = (
            f"u = V - {at_voltage_V:g} V, y = displacement in m less {stroke * strain_at:.6g} m (MAP), where the "
            "actuator has settled; for small changes of V"
        )

    def of(values: Mapping[str, Array]) -> list[StateSpace]:
        if at_voltage_V is None:
            D, k, T = model.modes_of(values)
        else:
            D, k, T = _around(model, values, factor * at_voltage_V**2)
        return [from_modes(gain * D[i], gain * k[i], T[i], Ts, hold) for i in range(len(D))]

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
        "settled_displacement_m": None if at_voltage_V is None else stroke * strain_at,
        "Ts": Ts,
        "comment": f"{model.name}: {words}. Discrete: {said}. From rest all states are zero. Modal coordinates, the "
        "slowest mode first.",
    }
    return Systems(of(at_map)[0], of(at_mean)[0], tuple(of(some)) if some else (), about)


def _settled(model: Model, values: Mapping[str, Array], stress: float) -> tuple[Array, Array]:
    """Strain (B,) under a stress held for ever, and tangent modulus (B,) Pa of the law there."""
    from scipy.optimize import brentq

    if model.is_black_box or model.spec.law == "hooke":
        D, c, _ = model.modes_of(values)
        Y = values["Y_Pa"] if not model.is_black_box else 1.0 / (D + c.sum(axis=1))
        return stress * (D + c.sum(axis=1)), Y
    assert model.spec.law is not None
    law = LAWS[model.spec.law]
    p = np.stack([values[name] for name in law.parameter_names], axis=1)
    strain, modulus = np.empty((2, len(p)))
    for b, row in enumerate(p):
        packed = law.pack(row)
        upper = 0.01
        while upper < _E_MOST and law_stress_tangent(law.law_id, packed, upper)[0] < stress:
            upper = min(1.3 * upper, _E_MOST)
        if not law_stress_tangent(law.law_id, packed, upper)[0] >= stress:
            raise InputError(
                f"--at-voltage: {model.name} settles nowhere below {100 * _E_MOST:g} % strain at that voltage; take a "
                "lower one"
            )
        low = lambda e, packed=packed: min(law_stress_tangent(law.law_id, packed, e)[0], 10 * stress) - stress  # noqa: E731
        strain[b] = brentq(low, 0.0, upper, xtol=1e-15, rtol=1e-14)
        modulus[b] = law_stress_tangent(law.law_id, packed, strain[b])[1]
    if model.spec.network == "gkv":
        # the law is the spring in series with the elements, which carry the stress as well
        k = np.stack([values[f"k_{i}_Pa"] for i in range(1, model.spec.elements + 1)], axis=1)
        strain = strain + stress * (1.0 / k).sum(axis=1)
    return strain, modulus


def _around(model: Model, values: Mapping[str, Array], stress: float) -> tuple[Array, Array, Array]:
    """Modes D (B,), c (B, m) 1/Pa, T (B, m) s for small changes of the stress around the settled state.

    Branches and dampers are linear, so the law's tangent takes the place of its modulus.
    """
    if model.is_linear:
        return model.modes_of(values)
    _, E = _settled(model, values, stress)
    if not np.all(E > 0):
        raise InputError(f"--at-voltage: {model.name} softens there (tangent below zero), it has no stable state")
    n, network = model.spec.elements, model.spec.network
    if network == "none":
        return 1.0 / E, np.zeros((E.size, 0)), np.ones((E.size, 0))
    k = np.stack([values[f"k_{i}_Pa"] for i in range(1, n + 1)], axis=1)
    tau = np.stack([values[f"tau_{i}_s"] for i in range(1, n + 1)], axis=1)
    if network == "gkv":
        return 1.0 / E, 1.0 / k, tau
    d0 = np.ascontiguousarray(values["d0_Pa_s"]) if network == "gkm" else np.zeros(E.size)
    return maxwell_to_modes(E, k, tau, d0)

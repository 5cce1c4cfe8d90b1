"""Small changes of a whole chain around the state in which it has settled under a voltage, as sums of lags.

Where the strain has settled at e under the stress S = F phi(e) W, with W = (w + P) w of the volts w that are left of
the stored charge, everything is followed to first order: law, stiffening and softening by their tangents; thickness and
permittivity as a spring of -F W phi'; branches, damper and mass as they are, for they are linear; the circuit with the
current C V' + V C' of a capacitance that moves; stored charge, polarisation and the sensor's lag as lags. Effects whose
answer to a rise is not the opposite of that to a fall, however small, have no such tangent and are refused; so is a
pure delay, which no state space holds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..errors import InputError
from ..models.model import Model
from ..models.networks import modes_to_maxwell
from ..models.plant import Plant
from ..models.static import HOOKE, N_PARAMETERS, law_stress_tangent

Array = NDArray[np.float64]
#: strains at which an operating point is sought
_E_SOUGHT = np.append(0.0, np.geomspace(1e-6, 0.9, 600))
#: why an effect has no state space
_REFUSED = {
    "acquisition_delay": "is a pure delay",
    "one_quadrant_supply": "falls otherwise than it rises, however small the change",
    "rate_independent_hysteresis": "sticks at every turn, however small the change",
    "mullins_softening": "unloads otherwise than it loads, however small the change",
}
#: effects that answer to something else than the command, or to large changes alone
_UNSEEN = ("supply_current_limit", "thermal_expansion", "sensor_drift", "mains_pickup")


@dataclass(frozen=True)
class Lags:
    """y = direct u + sum gain_j lag_j(u), gain and T (K,) complex in pairs where a mass swings; settled: y (m) itself
    where u = 0."""

    direct: float
    gain: NDArray[np.complex128]
    T: NDArray[np.complex128]
    settled: float = 0.0


def check_effects(model: Model) -> list[str]:
    """Warnings about effects that a state space does not show. Raises InputError for those that have none."""
    effects = model.spec.effects
    for name in effects:
        if name in _REFUSED:
            left = replace(model.spec, effects=tuple(e for e in effects if e not in _REFUSED)).name
            first = "Shift the recorded displacement_m by T_d_s, then calibrate" if "delay" in name else "Calibrate"
            raise InputError(
                f"{model.name}: {name} {_REFUSED[name]}: it has no state space. {first} {left} and export that, or "
                "take `bayes-dea predict`, which simulates all of it"
            )
    unseen = ", ".join(name for name in effects if name in _UNSEEN)
    return [f"Small changes of the command do not show {unseen}: no part of the state space."] if unseen else []


def in_square(plant: Plant) -> Lags | None:
    """Lags (m per V^2) where the displacement is a sum of lags of V^2 at all voltages, else None."""
    straight = plant.is_linear or plant.swings
    if not (straight and plant.has_plain_stress and plant.q_2_per_m == 0.0 and plant.y_max_m == np.inf):
        return None
    D, c, T = _mechanics(plant)
    per_square = plant.stroke_m * plant.factor
    return _sensed(plant, Lags(per_square * D, per_square * c, T))


def around(plant: Plant, voltage_V: float, where: str) -> Lags:
    """Lags (m per V) for small changes of the command around one under which the plant has settled.

    where: the model's name. Raises InputError where it settles nowhere, or something is at its limit there.
    """
    supplied = voltage_V - plant.V_dead_V
    if supplied <= 0.0:
        raise _limit(voltage_V, where, f"is in the dead zone of the supply ({plant.V_dead_V:.4g} V); take a higher one")
    if supplied >= plant.V_max_V:
        raise _limit(voltage_V, where, f"lies beyond what the supply gives ({plant.V_max_V:.4g} V); take a lower one")
    volts = _on_the_dielectric(plant, supplied)
    left = (1.0 - plant.a_q) * volts
    square = (1.0 + plant.chi) * left * left
    if plant.process is not None:
        e, local = plant.factor * square * float(plant.process[0].sum()), plant
    else:
        e, local = _settled(plant, square, voltage_V, where)
    found = _straight(plant, local, e, volts)
    y = plant.stroke_m * e
    slope, shown = 1.0 + 2.0 * plant.q_2_per_m * y, y + plant.q_2_per_m * y * y
    if shown >= plant.y_max_m:
        raise _limit(voltage_V, where, f"is where the sensor clips ({plant.y_max_m:.4g} m); take a lower one")
    return Lags(slope * found.direct, slope * found.gain, found.T, shown)


def _limit(voltage_V: float, where: str, what: str) -> InputError:
    return InputError(f"--at-voltage {voltage_V:g}: {where}: {what}")


def _conductance(plant: Plant, volts: float) -> tuple[float, float]:
    """Current (A) of the leak over its voltage, and its tangent (1/ohm)."""
    root = np.sqrt(abs(volts) / (plant.thickness_m * plant.E_0_V_per_m)) if plant.E_0_V_per_m > 0.0 else 0.0
    leak = float(np.exp(root)) / plant.R_leak_ohm
    return leak, leak * (1.0 + 0.5 * root)


def _on_the_dielectric(plant: Plant, supplied: float) -> float:
    """Volts behind resistance and leak at rest."""
    if plant.R_s_ohm == 0.0:
        return supplied
    return float(brentq(lambda v: v * (1.0 + plant.R_s_ohm * _conductance(plant, v)[0]) - supplied, 0.0, supplied))


def _stretch(e: float, thins: bool, c_eps: float) -> tuple[float, float]:
    """What the strain makes of stress or capacitance: factor and derivative."""
    f, d = 1.0 + c_eps * e, c_eps
    return (f / (1.0 - e) ** 2, d / (1.0 - e) ** 2 + 2.0 * f / (1.0 - e) ** 3) if thins else (f, d)


def _settled(plant: Plant, square: float, voltage_V: float, where: str) -> tuple[float, Plant]:
    """Strain under a voltage that is held for ever, and the plant with springs in place of all that is curved there."""
    law, behind = plant.law[:N_PARAMETERS], 0.0 if plant.creep is None else float(plant.creep[0].sum())

    def held(spring: float) -> tuple[float, float, float]:
        """Strain of the whole where that of the static law is `spring`, what it holds (Pa), and the stress on it."""
        s = law_stress_tangent(plant.law_id, law, spring)[0]
        e = spring + behind * s
        beside = plant.beta * plant.Y_Pa * e**3 + plant.dE_Pa * e / (1.0 + abs(e) / plant.e_c)
        pressed = plant.factor * square * _stretch(min(e, 0.99), plant.thickness_feedback, plant.c_eps)[0]
        return e, s + beside, pressed

    def over(spring: float) -> float:
        _, holds, pressed = held(spring)
        most = 10.0 * plant.factor * square  # a law may lock
        return holds - pressed if holds - pressed < most else most

    # the first strain that holds the stress: behind it the layers may give way
    first = next((i for i, x in enumerate(_E_SOUGHT) if i > 0 and over(x) >= 0.0), 0)
    if first == 0 or held(_E_SOUGHT[first])[0] >= 1.0:
        raise _limit(voltage_V, where, "settles nowhere at that voltage: the layers give way; take a lower one")
    spring = float(brentq(over, _E_SOUGHT[first - 1], _E_SOUGHT[first], xtol=1e-15, rtol=1e-14))
    e = held(spring)[0]
    Y, branches = float(law_stress_tangent(plant.law_id, law, spring)[1]), plant.branches
    if plant.creep is not None and Y > 0.0:
        compliances, times = plant.creep
        modulus, k, tau, _ = modes_to_maxwell(np.array([1.0 / Y]), compliances[None], times[None])
        Y, branches = float(modulus[0]), [*branches, *zip(k[0].tolist(), tau[0].tolist(), strict=True)]
    Y += 3.0 * plant.beta * plant.Y_Pa * e * e + plant.dE_Pa / (1.0 + abs(e) / plant.e_c) ** 2
    Y -= plant.factor * square * _stretch(e, plant.thickness_feedback, plant.c_eps)[1]
    if not Y > 0.0:
        raise _limit(voltage_V, where, "softens there (tangent below zero), it has no stable state; take a lower one")
    faster = np.sqrt(Y / plant.Y_Pa)  # mass and its damper stay; frequency and ratio are those on the modulus
    local = replace(plant, law_id=HOOKE, law=np.append(Y, np.zeros(N_PARAMETERS - 1)), Y_Pa=Y, branches=branches,
                    creep=None, f_1_Hz=plant.f_1_Hz * faster, zeta=plant.zeta / faster)
    return e, local


def _mechanics(local: Plant) -> tuple[float, NDArray[np.complex128], NDArray[np.complex128]]:
    """D (1/Pa), c (K,) 1/Pa and T (K,) s of a plant that is straight."""
    D, c, T = (0.0, *local.swinging_modes) if np.isfinite(local.f_1_Hz) else local.modes
    return D, c.astype(np.complex128), T.astype(np.complex128)


def _straight(plant: Plant, local: Plant, e: float, volts: float) -> Lags:
    """Lags (m per V) of the plant with the mechanics of `local`, at strain e and so many volts on the dielectric."""
    D, c, T = _mechanics(local)
    black_box = plant.process is not None
    phi = 1.0 if black_box else _stretch(e, plant.thickness_feedback, plant.c_eps)[0]
    left = (1.0 - plant.a_q) * volts
    per_volt = plant.factor * phi * (2.0 + plant.chi) * left
    if plant.R_s_ohm == 0.0 and plant.a_q == 0.0 and plant.chi == 0.0:
        return _sensed(plant, Lags(plant.stroke_m * per_volt * D, plant.stroke_m * per_volt * c, T))
    # states: the lags of the mechanics, stored charge, polarisation, volts
    m = T.size
    Q, P, V = m, m + 1, m + 2
    stress = np.zeros(m + 3, np.complex128)  # its change, by the states
    stress[[Q, P, V]] = -per_volt, plant.factor * phi * left, per_volt
    A = np.zeros((m + 3, m + 3), np.complex128)
    A[range(m), range(m)] = -1.0 / T
    A[:m] += stress / T[:, None]
    A[Q, [V, Q]] = plant.a_q / plant.tau_q_s, -1.0 / plant.tau_q_s
    A[P, [V, Q, P]] = plant.chi / plant.tau_d_s, -plant.chi / plant.tau_d_s, -1.0 / plant.tau_d_s
    strain = D * stress
    strain[:m] += c
    kept = [*range(m), *([Q] if plant.a_q else []), *([P] if plant.chi else [])]
    if plant.R_s_ohm == 0.0:
        # the volts are the input
        B, direct = A[kept, V], D * per_volt
    else:
        room, bend = (1.0, 0.0) if black_box else _stretch(e, True, plant.c_eps)
        # C V' + V dC/de e' = (u - V)/R - leak, where V' is a part of e' too
        moves = plant.capacitance_F * volts * bend
        capacitance = plant.capacitance_F * room + moves * strain[V]
        without = strain.copy()
        without[V] = 0.0
        A[V] = -moves * (without @ A)
        A[V, V] -= 1.0 / plant.R_s_ohm + _conductance(plant, volts)[1]
        A[V] /= capacitance
        kept.append(V)
        B, direct = np.zeros(len(kept), np.complex128), 0.0
        B[-1] = 1.0 / (plant.R_s_ohm * capacitance)
    poles, shapes = np.linalg.eig(A[np.ix_(kept, kept)])
    times = np.asarray(-1.0 / poles, np.complex128)
    gain = (strain[kept] @ shapes) * np.linalg.solve(shapes, B) * times
    # where nothing swings rounding alone leaves an imaginary part
    real = np.abs(times.imag) < 1e-9 * np.abs(times)
    times.imag[real] = gain.imag[real] = 0.0
    return _sensed(plant, Lags(plant.stroke_m * direct, plant.stroke_m * gain, times))


def _sensed(plant: Plant, x: Lags) -> Lags:
    """What the sensor's lag makes of an answer: one more lag, by partial fractions."""
    tau = plant.tau_s_s
    if tau == 0.0:
        return x
    # lag_T of lag_tau is T lag_T/(T - tau) - tau lag_tau/(T - tau)
    away = x.T - tau
    away = np.where(np.abs(away) < 1e-9 * tau, 1e-9 * tau, away)
    own = x.direct - np.sum(x.gain * tau / away)
    return Lags(0.0, np.append(x.gain * x.T / away, own.real), np.append(x.T, tau))

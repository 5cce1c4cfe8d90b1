"""From effects by name to the constants of the equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .actuator import Actuator, Material
from .recordings import Array, Effects

EPS0 = 8.8541878128e-12  # F/m
#: friction elements where nothing else is said
_ELEMENTS = 96


class Laws(NamedTuple):
    """Constants of a chain, in SI units; a law whose constant is zero does not act."""

    Y_Pa: float
    layer_m: float
    #: Maxwell stress over the whole area, per square of the voltage on a layer
    maxwell_Pa_per_V2: float
    capacitance_F: float
    # electrical
    series_ohm: float = 0.0
    strain_ohm_per_pct: float = 0.0
    leak_ohm: float = 0.0
    leak_field_V_per_m: float = 0.0
    slew_V_per_s: float = 0.0
    fall_tau_s: float = 0.0
    saturation_V: float = 0.0
    dead_V: float = 0.0
    retained: float = 0.0
    retained_tau_s: float = 0.0
    ringing_Hz: float = 0.0
    ringing_zeta: float = 0.0
    ripple: float = 0.0
    ripple_Hz: float = 0.0
    sag_per_kV: float = 0.0
    sag_tau_s: float = 0.0
    # electrostatic; feedback: exponent of the stretch
    feedback: float = 0.0
    permittivity_per_strain: float = 0.0
    absorbed: float = 0.0
    absorbed_tau_s: float = 0.0
    # mechanical
    stiffening: float = 0.0
    softening_Pa: float = 0.0
    softening_strain: float = 0.0
    damper_Pa_s: float = 0.0
    quadratic_damper_Pa_s2: float = 0.0
    mullins_share: float = 0.0
    mullins_Pa: float = 0.0
    mullins_slope: float = 0.0
    mass_Pa_s2: float = 0.0
    mass_damper_Pa_s: float = 0.0


class Friction(NamedTuple):
    """Sliders in parallel: yield strain (m,) of each, and the stiffness that all of them have."""

    yield_strain: Array
    element_Pa: float


class Chain(NamedTuple):
    """All constants of an actuator with its effects; Maxwell branches (b,) with those that effects add."""

    laws: Laws
    branch_Pa: Array
    branch_s: Array
    friction: Friction


#: effects whose parameters are constants as they stand
_FIELDS: dict[str, dict[str, str]] = {
    "series_resistance": {"R_s_ohm": "series_ohm"},
    "supply_current_limit": {"slew_V_per_s": "slew_V_per_s"},
    "one_quadrant_supply": {"tau_s": "fall_tau_s"},
    "supply_saturation": {"V_max_V": "saturation_V"},
    "supply_dead_zone": {"V_dead_V": "dead_V"},
    "charge_retention": {"a": "retained", "tau_s": "retained_tau_s"},
    "stretch_dependent_permittivity": {"c": "permittivity_per_strain"},
    "dielectric_absorption": {"chi": "absorbed", "tau_s": "absorbed_tau_s"},
    "strain_stiffening": {"beta": "stiffening"},
    "amplitude_softening": {"dE_Pa": "softening_Pa", "e_c": "softening_strain"},
    "parallel_damper": {"d0_Pa_s": "damper_Pa_s"},
    "amp_ringing": {"f_Hz": "ringing_Hz", "zeta": "ringing_zeta"},
    "amp_ripple": {"rel": "ripple", "f_Hz": "ripple_Hz"},
    "amp_warmup_sag": {"per_kV": "sag_per_kV", "tau_s": "sag_tau_s"},
    "electrode_resistance_strain": {"R_per_pct_ohm": "strain_ohm_per_pct"},
    "quadratic_damper": {"d2_Pa_s2": "quadratic_damper_Pa_s2"},
}


def _constants(effects: Effects, Y_Pa: float) -> dict[str, float]:
    """Fields of Laws that the effects set."""
    out: dict[str, float] = {}
    for name, q in effects.items():
        for parameter, field in _FIELDS.get(name, {}).items():
            out[field] = q[parameter]
    if "leakage" in effects:
        q = effects["leakage"]
        out |= {"leak_ohm": q["R_l_ohm"], "leak_field_V_per_m": q.get("E_0_V_per_m", 0.0)}
        if "series_resistance" not in effects:  # a leak acts through a resistance, its own where nothing else is there
            out["series_ohm"] = q["R_s_ohm"]
    if "thickness_feedback" in effects:
        out["feedback"] = 2.0
    if "mullins_softening" in effects:
        q = effects["mullins_softening"]
        out |= {"mullins_share": 1 / q["r"], "mullins_Pa": q["m_Pa"], "mullins_slope": q["b"]}
    if "inertia" in effects:
        q = effects["inertia"]
        mass = Y_Pa / (2 * np.pi * q["f_Hz"]) ** 2
        out |= {"mass_Pa_s2": mass, "mass_damper_Pa_s": 2 * q["zeta"] * np.sqrt(Y_Pa * mass)}
    return out


def _friction(effects: Effects) -> Friction:
    """Elements whose yield strains are exponentially distributed."""
    q = effects.get("rate_independent_hysteresis")
    if q is None:
        return Friction(np.zeros(0), 0.0)
    count = int(q.get("elements", 0))
    if count:  # at the quantiles, rescaled to the mean, as in the conformance set
        yields = -np.log1p(-(np.arange(count) + 0.5) / count)
        yields *= q["eps_y"] / yields.mean()
    else:  # the means of classes equally probable, whose mean is exact
        count = _ELEMENTS
        survival = 1 - np.arange(count) / count
        beyond = np.append((1 - np.log(survival)) * survival, 0.0)
        yields = q["eps_y"] * count * (beyond[:-1] - beyond[1:])
    return Friction(yields, q["sigma_y_Pa"] / q["eps_y"] / count)


def _branches(effects: Effects, material: Material) -> tuple[Array, Array]:
    """Stiffness and time constant of every Maxwell branch."""
    k, tau = list(material.k_Pa), list(material.tau_s)
    for name, q in effects.items():
        if name == "extra_relaxation_mode":
            k.append(q["k_Pa"])
            tau.append(q["tau_s"])
        elif name == "fractional_relaxation":  # a branch a decade
            decades = 10.0 ** np.arange(-3, 5)
            k += list(q["K_Pa"] * decades ** -q["alpha"])
            tau += list(decades)
    return np.array(k), np.array(tau)


def chain_of(actuator: Actuator, material: Material, effects: Effects) -> Chain:
    """The constants of an actuator with its material and effects."""
    a = actuator
    stress = (
        EPS0 * a.relative_permittivity / a.layer_thickness_m**2 * a.electrode_area_m2 / a.total_area_m2
    )  # Pa/V^2, averaged over the whole area
    capacitance = a.layers * EPS0 * a.relative_permittivity * a.electrode_area_m2 / a.layer_thickness_m
    constants = {k: float(v) for k, v in _constants(effects, material.Y_Pa).items()}
    laws = Laws(float(material.Y_Pa), a.layer_thickness_m, stress, capacitance, **constants)
    return Chain(laws, *_branches(effects, material), _friction(effects))

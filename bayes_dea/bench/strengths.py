"""How effects and disturbances are drawn for a concealed campaign: secondary parameters, range of the strength.

Ranges are those of the catalogue of missing physics where it gives any, else the bench's own. A strength is a number
that grows with what the effect does (the inverse of a slew rate, of a resonance's frequency, ...).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bayes_dea.bench.effects import Effects
from bayes_dea.bench.rig import Material


@dataclass(frozen=True)
class Context:
    """What a draw needs to know of the campaign it is for."""

    material: Material
    largest_V: float
    largest_m: float
    recordings: int


@dataclass(frozen=True)
class Strength:
    """One drawn effect up to its strength: parameters as a function of it, its range, what it is measured against."""

    make: Callable[[float], dict[str, float]]
    low: float
    high: float
    against: Callable[[float], Effects] | None = None
    searched: bool = True


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice((-1.0, 1.0)))


def _one(name: str, low: float, high: float, sign: float = 1.0, **others: float) -> Strength:
    return Strength(lambda s: {name: sign * s} | others, low, high)


def _inverse(name: str, low: float, high: float, **others: float) -> Strength:
    return Strength(lambda s: {name: 1.0 / s} | others, 1.0 / high, 1.0 / low)


def _short_of(name: str, top: float, low: float, high: float, **others: float) -> Strength:
    return Strength(lambda s: {name: top * (1.0 - s)} | others, low, high)


def _leakage(rng: np.random.Generator) -> Strength:
    R_s = _log(rng, 1e3, 1e5)
    if rng.random() < 0.3:
        # a linear leak is gain and a shorter time constant: nothing tells it from a series resistance
        return Strength(lambda s: {"R_leak_ohm": 1.0 / s, "R_s_ohm": R_s}, 1.0 / 1e9, 1.0 / 3e6, searched=False)
    E_0 = _log(rng, 3e5, 5e7)
    return Strength(lambda s: {"R_leak_ohm": 1.0 / s, "R_s_ohm": R_s, "E_0_V_per_m": E_0}, 1.0 / 1e12,
                    np.exp(-np.sqrt(4.8e7 / E_0)) / (3.0 * R_s),
                    lambda s: {"series_resistance": {"R_s_ohm": R_s}})


def _extra_mode(rng: np.random.Generator, material: Material) -> Strength:
    """Apart from the branches by a factor 3 at least, so that it is a mode of its own."""
    while True:
        tau = _log(rng, 5e-3, 60.0)
        if all(abs(np.log(tau / t)) > np.log(3.0) for t in material.tau_s):
            return _one("k_x_Pa", 1e-3 * material.Y_Pa, 0.2 * material.Y_Pa, tau_x_s=tau)


def draw_strength(name: str, rng: np.random.Generator, context: Context) -> Strength:
    """`name` with all its parameters drawn but its strength."""
    Y, top = context.material.Y_Pa, context.largest_m
    V = context.largest_V
    draws: dict[str, Callable[[], Strength]] = {
        "series_resistance": lambda: _one("R_s_ohm", 1e3, 1e6),
        "supply_current_limit": lambda: _inverse("slew_V_per_s", 5e3, 2e6),
        "one_quadrant_supply": lambda: _one("tau_fall_s", 2e-4, 0.1),
        "supply_saturation": lambda: _short_of("V_max_V", V, 1e-4, 0.45),
        "supply_dead_zone": lambda: _one("V_dead_V", 0.5, 150.0),
        "leakage": lambda: _leakage(rng),
        "charge_retention": lambda: _one("a_q", 5e-4, 0.8, tau_q_s=_log(rng, 0.1, 300.0)),
        "thickness_feedback": lambda: Strength(lambda s: {}, 1.0, 1.0, searched=False),
        "stretch_dependent_permittivity": lambda: (
            _one("c_eps", 0.02, 2.0, -1.0) if rng.random() < 0.67 else _one("c_eps", 0.02, 1.0)),
        "dielectric_absorption": lambda: _one("chi", 5e-4, 0.1, tau_d_s=_log(rng, 0.05, 100.0)),
        "strain_stiffening": lambda: _one("beta", 1.0, 500.0),
        "amplitude_softening": lambda: _one("dE_Pa", 2e-3 * Y, 1.6 * Y, e_c=_log(rng, 0.003, 0.02)),
        "rate_independent_hysteresis": lambda: _one("sigma_y_Pa", 20.0, 1e4, eps_y=_log(rng, 5e-4, 0.01)),
        "extra_relaxation_mode": lambda: _extra_mode(rng, context.material),
        "fractional_relaxation": lambda: _one("k_f_Pa", 500.0, 4e4, alpha_f=float(rng.uniform(0.0, 0.06))),
        "parallel_damper": lambda: _one("d0_Pa_s", 100.0, 3e4),
        "mullins_softening": lambda: _one("mullins_share", 1e-3, 0.2, mullins_m_Pa=_log(rng, 5.0, 100.0),
                                          mullins_b=float(rng.uniform(0.0, 1.0))),
        "inertia": lambda: _inverse("f_1_Hz", 40.0, 400.0, zeta=_log(rng, 0.03, 0.3)),
        "thermal_expansion": lambda: _one("alpha_T_m_per_K", 1e-7, 2e-5),
        "acquisition_delay": lambda: _one("T_d_s", 1.5e-3, 0.05),
        "sensor_lag": lambda: _one("tau_s_s", 2e-4, 0.05),
        "sensor_nonlinearity": lambda: _one("q_2_per_m", 2.0, 19.4e-6 / top**2, _sign(rng)),
        "sensor_drift": lambda: _one("drift_m_per_s", 2e-9, 2e-7, _sign(rng)),
        "mains_pickup": lambda: replace(_one("mains_m", 0.2e-6, 10e-6, mains_Hz=float(rng.choice((50.0, 60.0)))),
                                        searched=False),
        "sensor_clipping": lambda: _short_of("y_max_m", top, 2e-3, 0.5, clip_noise=float(rng.random() < 0.5)),
        "self_heating": lambda: _one("heat_share", 2e-4, 0.15, -1.0 if rng.random() < 0.3 else 1.0,
                                     tau_heat_s=_log(rng, 10.0, 300.0)),
        "field_dependent_relaxation": lambda: _one("field_rate_per_kV2", 0.02, 1.5, _sign(rng)),
        "quadratic_damper": lambda: _one("d2_Pa_s2", 1.0, 3e4),
        "asymmetric_viscosity": lambda: Strength(lambda s: {"unload_ratio": 1.0 + s}, 0.05, 20.0),
        "rest_recovery": lambda: _one("broken_share", 1e-3, 0.3, strain_to_break=_log(rng, 0.01, 0.2),
                                      tau_recover_s=_log(rng, 5.0, 60.0)),
        "module_lost": lambda: _short_of("stiffness_factor", 1.0, 5e-4, 0.3,
                                         recording=float(rng.integers(0, context.recordings)),
                                         after_part=float(rng.uniform(0.3, 0.7))),
        "supply_droop": lambda: _one("droop_share", 1e-3, 0.2, tau_droop_s=_log(rng, 3.0, 60.0)),
        "output_backlash": lambda: _one("play_m", 0.2e-6, 40e-6),
        "lost_contact": lambda: _one("lift_off_m", 1e-6, 0.5 * top),
        "edge_crosstalk": lambda: _one("crosstalk_m_per_V", 1e-10, 2e-7, _sign(rng),
                                       tau_crosstalk_s=_log(rng, 2e-3, 0.05)),
        "holder_resonance": lambda: _one("holder_share", 1e-3, 0.5, holder_Hz=float(rng.uniform(8.0, 20.0)),
                                         holder_zeta=_log(rng, 0.02, 0.2)),
        "cyclic_error": lambda: _one("cyclic_m", 0.2e-6, 20e-6, cyclic_period_m=_log(rng, 20e-6, 100e-6)),
        "soft_knee": lambda: _one("knee_m", 0.3e-6, 40e-6, _sign(rng), knee_at_m=top * float(rng.uniform(0.25, 0.6)),
                                  knee_width_m=_log(rng, 3e-6, 20e-6)),
        "sample_slips": lambda: _one("slip_s", 2e-3, 0.1, every_s=_log(rng, 0.5, 5.0)),
        "sensor_random_walk": lambda: _one("walk_m_per_sqrt_s", 0.05e-6, 5e-6),
    }
    return draws[name]()

"""What can be switched on in the bench: every effect of CONTRACT 3 and disturbances that are on no list.

An effect is a name and its parameters: {"series_resistance": {"R_s_ohm": 1.5e5}}. At its null value it changes
nothing. Equations stand at the place where they are solved: `coupled` (supply, dielectric, material) and `sensing`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bayes_dea.errors import InputError

Parameters = Mapping[str, float]
Effects = Mapping[str, Parameters]

STAGES = ("electrical", "electrostatic", "mechanical", "sensor")


@dataclass(frozen=True)
class Entry:
    """One effect of the bench: stage, parameters with nominal values, the null of its strength, optional ones.

    `parameters`: nominal value by name. `null`: values at which nothing changes; empty where there is no such
    (thickness feedback). `optional`: further parameters with their defaults. `signed`: names that may be negative.
    """

    stage: str
    parameters: Parameters
    null: Parameters
    about: str
    optional: Parameters | None = None
    signed: tuple[str, ...] = ()


_E = Entry
#: effects of CONTRACT 3, in its order
EFFECTS: dict[str, Entry] = {
    "series_resistance": _E("electrical", {"R_s_ohm": 150e3}, {"R_s_ohm": 0.0},
                            "q' = (V_s - q/C) / R_s with C = C0 (1 + c e) / (1 - e)^2, charge q the state"),
    "supply_current_limit": _E("electrical", {"slew_V_per_s": 60e3}, {"slew_V_per_s": math.inf},
                               "|dV_s/dt| <= slew"),
    "one_quadrant_supply": _E("electrical", {"tau_fall_s": 15e-3}, {"tau_fall_s": 0.0},
                              "falls with V_s' = -(V_s - V_command) / tau_fall, rises at once"),
    "supply_saturation": _E("electrical", {"V_max_V": 900.0}, {"V_max_V": math.inf}, "|V_s| <= V_max"),
    "supply_dead_zone": _E("electrical", {"V_dead_V": 30.0}, {"V_dead_V": 0.0},
                           "V_s = sign(V) max(0, |V| - V_dead)"),
    "leakage": _E("electrical", {"R_leak_ohm": 40e6, "R_s_ohm": 50e3}, {"R_leak_ohm": math.inf, "R_s_ohm": 0.0},
                  "q' gets - (q/C) exp(sqrt(E/E_0)) / R_leak, behind the series resistance R_s",
                  {"E_0_V_per_m": math.inf}),
    "charge_retention": _E("electrical", {"a_q": 0.2, "tau_q_s": 10.0}, {"a_q": 0.0},
                           "V_d - V_q acts, tau_q V_q' = a_q V_d - V_q"),
    "thickness_feedback": _E("electrostatic", {}, {}, "stress x (1 - e)^-2"),
    "stretch_dependent_permittivity": _E("electrostatic", {"c_eps": -1.0}, {"c_eps": 0.0},
                                         "permittivity x (1 + c_eps e)", signed=("c_eps",)),
    "dielectric_absorption": _E("electrostatic", {"chi": 0.03, "tau_d_s": 0.5}, {"chi": 0.0},
                                "stress = (D + P) E A_e/A_c, tau_d P' = chi D - P"),
    "strain_stiffening": _E("mechanical", {"beta": 50.0}, {"beta": 0.0}, "stress + beta Y e^3"),
    "amplitude_softening": _E("mechanical", {"dE_Pa": 0.8e6, "e_c": 0.008}, {"dE_Pa": 0.0},
                              "stress + dE e / (1 + |e| / e_c)"),
    "rate_independent_hysteresis": _E("mechanical", {"sigma_y_Pa": 2000.0, "eps_y": 0.0025}, {"sigma_y_Pa": 0.0},
                                      "Iwan: parallel friction elements, exponential yield strains of mean eps_y",
                                      {"elements": 48.0}),
    "extra_relaxation_mode": _E("mechanical", {"k_x_Pa": 80e3, "tau_x_s": 0.1}, {"k_x_Pa": 0.0},
                                "one more Maxwell branch"),
    "fractional_relaxation": _E("mechanical", {"k_f_Pa": 15e3, "alpha_f": 0.04}, {"k_f_Pa": 0.0},
                                "a branch a decade, 1e-3 to 1e4 s, k_i = k_f tau_i^-alpha"),
    "parallel_damper": _E("mechanical", {"d0_Pa_s": 2000.0}, {"d0_Pa_s": 0.0}, "stress + d0 e'"),
    "mullins_softening": _E("mechanical", {"mullins_share": 0.1, "mullins_m_Pa": 30.0, "mullins_b": 0.5},
                            {"mullins_share": 0.0},
                            "static stress x (1 - share erf((W_m - W) / (m + b W_m))) (Ogden and Roxburgh 1999)"),
    "inertia": _E("mechanical", {"f_1_Hz": 80.0, "zeta": 0.05}, {"f_1_Hz": math.inf},
                  "stress + M e'' + 2 zeta sqrt(Y M) e', M = Y / (2 pi f_1)^2"),
    "thermal_expansion": _E("mechanical", {"alpha_T_m_per_K": 3e-6}, {"alpha_T_m_per_K": 0.0},
                            "displacement - alpha_T (T - T at the first row)", signed=("alpha_T_m_per_K",)),
    "acquisition_delay": _E("sensor", {"T_d_s": 12.3e-3}, {"T_d_s": 0.0},
                            "y(t) = x(t - T_d), linear between samples"),
    "sensor_lag": _E("sensor", {"tau_s_s": 8e-3}, {"tau_s_s": 0.0}, "tau_s y' = x - y"),
    "sensor_nonlinearity": _E("sensor", {"q_2_per_m": 150.0}, {"q_2_per_m": 0.0}, "y = x + q_2 x^2",
                              signed=("q_2_per_m",)),
    "sensor_drift": _E("sensor", {"drift_m_per_s": 2e-7}, {"drift_m_per_s": 0.0}, "y = x + drift t",
                       signed=("drift_m_per_s",)),
    "mains_pickup": _E("sensor", {"mains_m": 3e-6}, {"mains_m": 0.0}, "y = x + mains sin(2 pi f t + phase)",
                       {"mains_Hz": 50.0}),
    "sensor_clipping": _E("sensor", {"y_max_m": 160e-6}, {"y_max_m": math.inf},
                          "y = min(x, y_max), noise included (or not: clip_noise 0)", {"clip_noise": 1.0}),
}

#: what no list names: each is known to the bench alone
DISTURBANCES: dict[str, Entry] = {
    "self_heating": _E("mechanical", {"heat_share": -0.05, "tau_heat_s": 60.0}, {"heat_share": 0.0},
                       "all stiffness x (1 + share T), tau T' = (V/kV)^2 - T", signed=("heat_share",)),
    "field_dependent_relaxation": _E("mechanical", {"field_rate_per_kV2": 1.0}, {"field_rate_per_kV2": 0.0},
                                     "every relaxation is faster by exp(rate (V/kV)^2)",
                                     signed=("field_rate_per_kV2",)),
    "quadratic_damper": _E("mechanical", {"d2_Pa_s2": 800.0}, {"d2_Pa_s2": 0.0}, "stress + d2 |e'| e'"),
    "asymmetric_viscosity": _E("mechanical", {"unload_ratio": 4.0}, {"unload_ratio": 1.0},
                               "dashpots that stretch back have their time constants x ratio"),
    "rest_recovery": _E("mechanical", {"broken_share": 0.1, "strain_to_break": 0.05, "tau_recover_s": 20.0},
                        {"broken_share": 0.0},
                        "stiffness x (1 - share D), D grows with the strain travelled and heals with rest"),
    "module_lost": _E("mechanical", {"stiffness_factor": 0.93, "recording": 5.0, "after_part": 0.5},
                      {"stiffness_factor": 1.0},
                      "stiffness x factor from a moment in one recording (its number, part of its length) on"),
    "supply_droop": _E("electrical", {"droop_share": 0.03, "tau_droop_s": 20.0}, {"droop_share": 0.0},
                       # with V_slow' = V - V_slow it would be the very equation of charge_retention
                       "the supply gives way as it warms up: V (1 - share w), tau w' = (V/kV)^2 - w"),
    "output_backlash": _E("sensor", {"play_m": 4e-6}, {"play_m": 0.0},
                          "what is read follows the stack with play of this width"),
    "lost_contact": _E("sensor", {"lift_off_m": 40e-6}, {"lift_off_m": 0.0},
                       "what is read touches the stack only above this displacement"),
    "edge_crosstalk": _E("sensor", {"crosstalk_m_per_V": 1e-8, "tau_crosstalk_s": 5e-3},
                         {"crosstalk_m_per_V": 0.0}, "y = x + k w, w' = V' - w / tau of the command",
                         signed=("crosstalk_m_per_V",)),
    "holder_resonance": _E("sensor", {"holder_share": 0.1, "holder_Hz": 12.0, "holder_zeta": 0.05},
                           {"holder_share": 0.0}, "y = x + share r, r'' + 2 zeta w r' + w^2 r = -x''"),
    "cyclic_error": _E("sensor", {"cyclic_m": 1.5e-6, "cyclic_period_m": 60e-6}, {"cyclic_m": 0.0},
                       "y = x + a sin(2 pi x / period), as of an interferometer"),
    "soft_knee": _E("sensor", {"knee_m": 4e-6, "knee_at_m": 100e-6, "knee_width_m": 10e-6}, {"knee_m": 0.0},
                    "y = x - knee (1 + tanh((x - at) / width)) / 2", signed=("knee_m",)),
    "sample_slips": _E("sensor", {"slip_s": 15e-3, "every_s": 4.0}, {"slip_s": 0.0},
                       "stretches of random length arrive late by slip, the others in time"),
    "sensor_random_walk": _E("sensor", {"walk_m_per_sqrt_s": 1e-6}, {"walk_m_per_sqrt_s": 0.0},
                             "the zero walks at random"),
}

#: everything that the bench can switch on
ALL: dict[str, Entry] = EFFECTS | DISTURBANCES


def checked(effects: Effects, where: str = "effects of the bench") -> dict[str, dict[str, float]]:
    """`effects` with their optional parameters filled in, in the order of `ALL`.

    Raises InputError for an unknown effect, an unknown or missing parameter, or an impossible value.
    """
    for name in effects:
        if name not in ALL:
            raise InputError(f"{where}: {name!r} is unknown; known are {', '.join(ALL)}")
    out: dict[str, dict[str, float]] = {}
    for name, entry in ALL.items():
        if name not in effects:
            continue
        given, optional = effects[name], dict(entry.optional or {})
        if not isinstance(given, Mapping):
            raise InputError(f"{where}: {name} is {given!r}; give a table of its parameters: "
                             f"{', '.join(entry.parameters) or 'none'}")
        for parameter, value in given.items():
            if parameter not in entry.parameters and parameter not in optional:
                raise InputError(f"{where}: {name} has no parameter {parameter!r}; it has "
                                 f"{', '.join([*entry.parameters, *optional]) or 'none'}")
            if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
                raise InputError(f"{where}: {parameter} of {name} is {value!r}; give a number")
            is_null = parameter in entry.null and value == entry.null[parameter]
            infinite = math.isinf(value) and not is_null and value != optional.get(parameter)
            impossible = value < 0.0 and parameter not in entry.signed
            zero = value == 0.0 and not is_null and parameter not in ("clip_noise", "recording", "after_part",
                                                                      "mullins_b", "zeta", "alpha_f")
            if infinite or impossible or zero:
                raise InputError(f"{where}: {parameter} of {name} is {value:g}; give a "
                                 f"{'finite' if parameter in entry.signed else 'positive'} number")
        missing = [p for p in entry.parameters if p not in given]
        if missing:
            raise InputError(f"{where}: {name} needs {', '.join(missing)}; add it")
        out[name] = optional | {p: float(v) for p, v in given.items()}
    return out


def parse_effect(text: str) -> tuple[str, dict[str, float]]:
    """`NAME`, `NAME=value,value` (in the order of its parameters) or `NAME=parameter:value,...`.

    A bare name takes the nominal values. Raises InputError where the text is none of these.
    """
    name, _, rest = text.partition("=")
    where = f"--effect {text}"
    name = name.strip()
    if name not in ALL:
        raise InputError(f"{where}: {name!r} is unknown; known are {', '.join(ALL)}")
    entry = ALL[name]
    names = [*entry.parameters, *(entry.optional or {})]
    values: dict[str, float] = dict(entry.parameters)
    items = [item.strip() for item in rest.split(",") if item.strip()]
    if len(items) > len(names):
        raise InputError(f"{where}: {len(items)} values for {', '.join(names) or 'no parameter'}; leave some out")
    for place, item in enumerate(items):
        parameter, colon, number = item.rpartition(":")
        parameter = parameter.strip() if colon else names[place]
        try:
            values[parameter] = float(number)
        except ValueError:
            raise InputError(f"{where}: {number!r} is not a number; give NAME=value,... for "
                             f"{', '.join(names)}") from None
    return name, checked({name: values}, where)[name]


def read_effects(path: Path) -> dict[str, dict[str, float]]:
    """Effects of a TOML file, a table each ([series_resistance] R_s_ohm = 1.5e5); InputError where it is not that."""
    try:
        with path.open("rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise InputError(f"--effects {path}: cannot be read ({error.strerror}); give a TOML file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"--effects {path}: is not TOML ({error}); mend that line") from None
    return checked(table, str(path))


def truth_name(effects: Effects) -> str:
    """The answer a diagnosis should give: "none", names of CONTRACT 3 joined by +, or "unknown:<names>"."""
    active = {n: v for n, v in checked(effects).items()
              if not ALL[n].null or any(v[p] != null for p, null in ALL[n].null.items())}
    listed = [n for n in EFFECTS if n in active]
    others = [n for n in DISTURBANCES if n in active]
    if others:
        return "unknown:" + "+".join([*listed, *others])
    return "+".join(listed) or "none"

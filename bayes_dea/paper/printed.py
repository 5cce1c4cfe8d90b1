"""The numbers printed in the reference paper, from `printed.toml`: as printed, and as used where a misprint is mended.

`printed()` loads them once. Everything is in SI units unless a name says otherwise.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator, Sensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Value:
    """One number: where it stands, as printed, as used, and why these differ ("" where they do not)."""

    where: str
    printed: float
    used: float
    why: str = ""

    @property
    def mended(self) -> bool:
        """Whether the printed number is not the one to use."""
        return self.used != self.printed


@dataclass(frozen=True)
class LawRow:
    """A row of Table SIV: `law` is a name of `bayes_dea.models.static.LAWS`, values in the order of its parameters.

    `printed` carries the paper's signs; `used` is tension positive as in Table SI, misprints mended.
    """

    law: str
    title: str
    names: tuple[str, ...]
    printed: tuple[float, ...]
    used: tuple[float, ...]
    why: str


@dataclass(frozen=True)
class MaxwellRow:
    """Table SVI: spring Y in Pa, branch stiffnesses (3,) in Pa, dampers (3,) in Pa s (printed as Pa/s)."""

    Y_Pa: float
    k_Pa: tuple[float, ...]
    d_Pa_s: tuple[float, ...]

    @property
    def tau_s(self) -> Array:
        """Time constants d/k (3,) in s."""
        return np.array(self.d_Pa_s) / np.array(self.k_Pa)


@dataclass(frozen=True)
class KelvinRow:
    """A row of Table SVII: k0..k3 in Pa; alpha1..alpha3 in 1/s (printed as Pa/s)."""

    voltage_V: float
    k_Pa: tuple[float, ...]
    rate_per_s: tuple[float, ...]

    @property
    def tau_s(self) -> Array:
        """Retardation times 1/alpha (3,) in s, in the order of the table (shortest first)."""
        return 1.0 / np.array(self.rate_per_s)

    @property
    def dampers_Pa_s(self) -> Array:
        """k_i / alpha_i (3,) in Pa s."""
        return np.array(self.k_Pa[1:]) / np.array(self.rate_per_s)

    def compliance(self, time_s: Any) -> Array:
        """Strain per unit stress in 1/Pa at times since the step, Eq. (10)."""
        t = np.asarray(time_s, dtype=float)
        shares = -np.expm1(-t[..., None] * np.array(self.rate_per_s)) / np.array(self.k_Pa[1:])
        return np.asarray(1.0 / self.k_Pa[0] + shares.sum(axis=-1))


@dataclass(frozen=True)
class StateSpaceRow:
    """A row of Table SVIII: A (3, 3), B (3,), C (3,), D = 0, as printed; `A11_used` is the mended first pole."""

    voltage_V: float
    A: Array
    B: Array
    C: Array
    A11_used: float
    sample_time_s: float

    @property
    def A_used(self) -> Array:
        """A (3, 3) with the mended first pole."""
        out = self.A.copy()
        out[0, 0] = self.A11_used
        return out

    @property
    def poles_per_s(self) -> Array:
        """-ln(A_ii)/Ts (3,) in 1/s of the mended matrix, slowest first."""
        return np.asarray(-np.log(np.diag(self.A_used)) / self.sample_time_s)

    def step(self, rows: int) -> Array:
        """Response (rows,) to a unit step, one row a sample, the first at the step; um measured per um of Hooke."""
        x = np.zeros(3)
        out = np.empty(rows)
        A, B, C = self.A_used, self.B, self.C
        for i in range(rows):
            out[i] = C @ x
            x = A @ x + B
        return out


@dataclass(frozen=True)
class Printed:
    """Everything the paper prints as numbers. Groups of single values are mappings from name to `Value`."""

    constants: Mapping[str, Value]
    actuators: Mapping[str, Mapping[str, Value]]
    static: Mapping[str, LawRow]
    maxwell: MaxwellRow
    kelvin_voigt: Mapping[int, KelvinRow]
    state_space: Mapping[int, StateSpaceRow]
    statements: Mapping[str, Value]
    noise: Mapping[str, Value]
    compression: Mapping[str, Value]
    relaxation: Mapping[str, Value]
    creep: Mapping[str, Value]
    optimisation: Mapping[str, Value]
    validation: Mapping[str, Value]
    validation_frequencies_Hz: tuple[float, ...]
    validation_shapes: tuple[str, ...]
    timing: Mapping[str, Value]

    def actuator(self, name: str) -> Actuator:
        """The mended actuator "compression_and_validation" or "creep", as a campaign describes it."""
        a, c = self.actuators[name], self.constants
        return Actuator(
            name=name,
            layers=round(c["layers"].used),
            layer_thickness_m=c["layer_thickness_m"].used,
            relative_permittivity=c["relative_permittivity"].used,
            electrode_area_m2=a["electrode_area_m2"].used,
            total_area_m2=a["total_area_m2"].used,
            stack_height_m=a["height_m"].used,
            layer_mass_kg=c["moving_mass_kg"].printed,
            max_frequency_Hz=c["max_frequency_Hz"].used,
        )

    def sensor(self, channel: str) -> Sensor:
        """Stated accuracies of "displacement", "force" or "position"."""
        n = self.noise

        def get(what: str) -> float | None:
            found = [v.used for k, v in n.items() if k.startswith(f"{channel}_{what}_")]
            return found[0] if found else None

        return Sensor(get("fluctuation"), get("accuracy"), get("resolution"))

    def electrostatic_stress(self, voltage_V: Any) -> Array:
        """Eq. (1): eps0 eps_r (V/z0)^2 in Pa, misprints mended. Tables SVII and (10) go with this one."""
        c = self.constants
        field = np.asarray(voltage_V, dtype=float) / c["layer_thickness_m"].used
        return np.asarray(c["vacuum_permittivity_F_per_m"].used * c["relative_permittivity"].used * field**2)

    def passive_stress(self, voltage_V: Any, actuator: str = "creep") -> Array:
        """Eq. (2): the stress in the elastomer, Eq. (1) times A_e/A_c, in Pa. Models GM, GKM and Hooke go with it."""
        a = self.actuators[actuator]
        return self.electrostatic_stress(voltage_V) * a["electrode_area_m2"].used / a["total_area_m2"].used

    def creep_displacement(self, voltage_V: int, time_s: Any) -> Array:
        """Displacement in m by Table SVII at times (s) since the step: Eqs. (1) and (10), strain over the height."""
        height = self.actuators["creep"]["height_m"].used
        return self.electrostatic_stress(voltage_V) * self.kelvin_voigt[voltage_V].compliance(time_s) * height


@cache
def printed() -> Printed:
    """The paper's numbers, read once."""
    text = files("bayes_dea.paper").joinpath("printed.toml").read_text(encoding="utf-8")
    t = tomllib.loads(text)
    laws = {
        law: LawRow(law, d["title"], tuple(d["names"]), tuple(d["printed"]), tuple(d["used"]), d.get("why", ""))
        for law, d in t["static"].items()
    }
    m = t["maxwell"]
    step = float(t["state_space"]["sample_time_s"])
    return Printed(
        constants=_values(t["constants"]),
        actuators=MappingProxyType({name: _values(d) for name, d in t["actuators"].items()}),
        static=MappingProxyType(laws),
        maxwell=MaxwellRow(float(m["Y_Pa"]), tuple(m["k_Pa"]), tuple(m["d_Pa_s"])),
        kelvin_voigt=MappingProxyType({int(r["voltage_V"]): _kelvin(r) for r in t["kelvin_voigt"]["rows"]}),
        state_space=MappingProxyType({int(r["voltage_V"]): _state(r, step) for r in t["state_space"]["rows"]}),
        validation_frequencies_Hz=tuple(t["validation"]["frequencies_Hz"]),
        validation_shapes=tuple(t["validation"]["shapes"]),
        **{name: _values(t[name]) for name in ("statements", "noise", "compression", "relaxation", "creep",
                                               "optimisation", "validation", "timing")},
    )


def _values(table: dict[str, Any]) -> Mapping[str, Value]:
    out = {}
    for name, d in table.items():
        if isinstance(d, dict):
            number = float(d["printed"])
            out[name] = Value(d["where"], number, float(d["used"]) if "used" in d else number, d.get("why", ""))
    return MappingProxyType(out)


def _kelvin(row: dict[str, Any]) -> KelvinRow:
    return KelvinRow(float(row["voltage_V"]), tuple(map(float, row["k_Pa"])), tuple(map(float, row["rate_per_s"])))


def _state(row: dict[str, Any], step: float) -> StateSpaceRow:
    A = np.array(row["A"], dtype=float)
    A.setflags(write=False)
    return StateSpaceRow(float(row["voltage_V"]), A, np.array(row["B"], dtype=float), np.array(row["C"], dtype=float),
                         float(row.get("A11_used", A[0, 0])), step)

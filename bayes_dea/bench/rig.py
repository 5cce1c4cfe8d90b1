"""The reference actuator of the virtual bench: geometry, material and the physics between them.

Equations (compression positive): Maxwell stress eps0 eps_r (V / z0)^2 A_e / A_c = Y e + sum_i s_i with
s_i' = k_i e' - s_i / tau_i; displacement = layers x layer thickness x e (Eqs. 1, 2 and the generalised
Maxwell model of the reference paper). Between plates: force = true stress x A_c / (1 - e), incompressible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.errors import InputError

Array = NDArray[np.float64]

#: vacuum permittivity in F/m (CODATA 2018)
EPS0 = 8.8541878128e-12


def check_positive(where: str, **values: float) -> None:
    """Raise InputError naming the first of `values` that is not a finite positive number."""
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{where}: {name} is {value}; give a positive number")


@dataclass(frozen=True)
class Geometry:
    """Geometry and limits of one stacked actuator, in SI units; defaults: the creep actuator of the paper."""

    name: str = "CT25.2-10-10-10"
    layers: int = 399
    layer_thickness_m: float = 25e-6
    relative_permittivity: float = 2.8
    electrode_area_m2: float = 7.5602e-5
    total_area_m2: float = 1.1450e-4
    stack_height_m: float = 10.261e-3
    layer_mass_kg: float = 3.4962e-6
    max_voltage_V: float = 1200.0
    max_frequency_Hz: float = 100.0
    payload_kg: float = 0.0

    def __post_init__(self) -> None:
        check_positive("geometry of the bench's actuator", layers=self.layers,
                       layer_thickness_m=self.layer_thickness_m,
                       relative_permittivity=self.relative_permittivity,
                       electrode_area_m2=self.electrode_area_m2, total_area_m2=self.total_area_m2,
                       stack_height_m=self.stack_height_m, max_voltage_V=self.max_voltage_V)


@dataclass(frozen=True)
class Material:
    """Spring Y_Pa beside Maxwell branches (k_Pa, tau_s), slowest first; default: the conformance baseline."""

    Y_Pa: float = 1.20e6
    k_Pa: tuple[float, ...] = (70e3, 50e3, 60e3)
    tau_s: tuple[float, ...] = (200.0, 20.0, 1.0)

    def __post_init__(self) -> None:
        if len(self.k_Pa) != len(self.tau_s):
            raise InputError(f"material of the bench: {len(self.k_Pa)} stiffnesses k_Pa for "
                             f"{len(self.tau_s)} time constants tau_s; give one of each a branch")
        check_positive("material of the bench", Y_Pa=self.Y_Pa,
                       **{f"k_{i}_Pa": k for i, k in enumerate(self.k_Pa, 1)},
                       **{f"tau_{i}_s": t for i, t in enumerate(self.tau_s, 1)})
        if any(a <= b for a, b in zip(self.tau_s, self.tau_s[1:], strict=False)):
            raise InputError(f"material of the bench: tau_s = {list(self.tau_s)} must fall from branch to "
                             "branch; put the slowest first")

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Material:
        """A specimen of the same type: log-normal scatter around the defaults, order of the branches kept.

        Log standard deviations 0.1 (Y), 0.3 (k), 0.35 (tau): a batch of silicone differs by a tenth in its
        modulus, its relaxation by more. Drawings whose time constants come closer than a factor two are
        repeated, as two such branches would be one.
        """
        base = cls()
        Y = base.Y_Pa * np.exp(0.1 * rng.standard_normal())
        k = np.array(base.k_Pa) * np.exp(0.3 * rng.standard_normal(3))
        tau = np.array(base.tau_s) * np.exp(0.35 * rng.standard_normal(3))
        while np.any(tau[:-1] < 2.0 * tau[1:]):
            tau = np.array(base.tau_s) * np.exp(0.35 * rng.standard_normal(3))
        return cls(float(Y), tuple(map(float, k)), tuple(map(float, tau)))

    def parameters(self) -> dict[str, float]:
        """Names and values as the tool reports them: Y_Pa, k_1_Pa, tau_1_s, ..."""
        named = {"Y_Pa": self.Y_Pa}
        for i, (k, tau) in enumerate(zip(self.k_Pa, self.tau_s, strict=True), 1):
            named |= {f"k_{i}_Pa": k, f"tau_{i}_s": tau}
        return named


@dataclass(frozen=True)
class Rig:
    """One actuator on the bench. Every run starts rested; nothing is carried from one to the next."""

    geometry: Geometry
    material: Material

    def maxwell_stress(self, voltage_V: Array) -> Array:
        """Stress in Pa, averaged over the whole area, from the voltage on the layers (Eq. 1 of the paper)."""
        g = self.geometry
        field = voltage_V / g.layer_thickness_m
        return EPS0 * g.relative_permittivity * field**2 * (g.electrode_area_m2 / g.total_area_m2)

    def drive(self, time_s: Array, voltage_V: Array) -> Array:
        """True displacement (n,) in m; the voltage of a row is in force until its time (hold "end")."""
        from bayes_dea.bench.integrate import SUBSTEP, strain_under_stress

        k, tau = np.array(self.material.k_Pa), np.array(self.material.tau_s)
        time, stress = np.ascontiguousarray(time_s, dtype=float), self.maxwell_stress(voltage_V)
        strain = strain_under_stress(time, stress, self.material.Y_Pa, k, tau, SUBSTEP)
        return strain * (self.geometry.layers * self.geometry.layer_thickness_m)

    def press(self, time_s: Array, position_m: Array, contact_m: float) -> Array:
        """True force (n,) in N between plates at `position_m`, linear between rows, touching at `contact_m`.

        Raises InputError where the plates would squeeze the stack to nothing.
        """
        from bayes_dea.bench.integrate import SUBSTEP, stress_between_plates

        imposed = (position_m - contact_m) / self.geometry.stack_height_m
        if imposed.size and imposed.max() >= 1.0:
            raise InputError(f"compression of the bench: strain {imposed.max():.3g} at a stack height of "
                             f"{self.geometry.stack_height_m} m; keep it below 1")
        k, tau = np.array(self.material.k_Pa), np.array(self.material.tau_s)
        strain, stress = stress_between_plates(np.ascontiguousarray(time_s, dtype=float),
                                               np.ascontiguousarray(imposed, dtype=float),
                                               self.material.Y_Pa, k, tau, SUBSTEP)
        return stress * self.geometry.total_area_m2 / (1.0 - strain)

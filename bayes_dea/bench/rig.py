"""The reference actuator of the virtual bench: geometry, material and the physics between them.

Equations (compression positive): Maxwell stress eps0 eps_r (V / z0)^2 A_e / A_c = Y e + sum_i s_i with
s_i' = k_i e' - s_i / tau_i; displacement = layers x layer thickness x e (Eqs. 1, 2 and the generalised
Maxwell model of the reference paper); effects join these where they belong (`coupled`). Between plates:
force = true stress x A_c / (1 - e), incompressible.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.effects import ALL, Effects, checked
from bayes_dea.compiled import read_only
from bayes_dea.errors import InputError

if TYPE_CHECKING:
    from bayes_dea.bench.coupled import Physics

Array = NDArray[np.float64]

#: vacuum permittivity in F/m (CODATA 2018)
EPS0 = 8.8541878128e-12
#: longest substep between plates
_LONGEST_PRESS_S = 5e-3


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
    """One actuator on the bench. Every run starts rested; nothing is carried from one to the next.

    `effects`: what acts beside the equations above, by name and parameters (see `effects.ALL`). Those of the
    sensor are not in here (see `sensing`). `stiffness`: factors on all stiffness before and after a moment in s.
    `roughness`: factor on the tolerances of the integrator.
    """

    geometry: Geometry
    material: Material
    effects: Effects = field(default_factory=dict)
    stiffness: tuple[float, float, float] = (1.0, 1.0, np.inf)
    roughness: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "effects", checked(self.effects))

    def maxwell_stress(self, voltage_V: Array) -> Array:
        """Stress in Pa, averaged over the whole area, from the voltage on the layers (Eq. 1 of the paper)."""
        g = self.geometry
        field = voltage_V / g.layer_thickness_m
        return EPS0 * g.relative_permittivity * field**2 * (g.electrode_area_m2 / g.total_area_m2)

    @property
    def capacitance_F(self) -> float:
        """Capacitance at rest: the layers are electrically in parallel."""
        g = self.geometry
        return g.layers * EPS0 * g.relative_permittivity * g.electrode_area_m2 / g.layer_thickness_m

    @property
    def _coupled(self) -> bool:
        stages = {ALL[name].stage for name in self.effects if name != "thermal_expansion"}
        return bool(stages - {"sensor"}) or self.stiffness[:2] != (1.0, 1.0)

    def branches(self) -> tuple[Array, Array]:
        """Stiffness and time constant of every Maxwell branch, those of effects included."""
        k, tau = list(self.material.k_Pa), list(self.material.tau_s)
        if "extra_relaxation_mode" in self.effects:
            k.append(self.effects["extra_relaxation_mode"]["k_x_Pa"])
            tau.append(self.effects["extra_relaxation_mode"]["tau_x_s"])
        if "fractional_relaxation" in self.effects:
            p = self.effects["fractional_relaxation"]
            decades = [10.0**n for n in range(-3, 5)]
            k += [p["k_f_Pa"] * t ** -p["alpha_f"] for t in decades]
            tau += decades
        return np.array(k), np.array(tau)

    def _physics(self) -> tuple[Physics, Array]:
        """Constants of the coupled equations, and the yield strains of the friction elements."""
        def of(name: str, parameter: str, otherwise: float) -> float:
            return self.effects[name][parameter] if name in self.effects else otherwise

        Y = self.material.Y_Pa
        yields = np.empty(0)
        slider = 0.0
        if of("rate_independent_hysteresis", "sigma_y_Pa", 0.0) > 0.0:
            p = self.effects["rate_independent_hysteresis"]
            count = round(p["elements"])
            yields = -np.log1p(-(np.arange(count) + 0.5) / count)
            yields *= p["eps_y"] / yields.mean()
            slider = p["sigma_y_Pa"] / p["eps_y"] / count
        f_1 = of("inertia", "f_1_Hz", np.inf)
        mass = Y / (2.0 * np.pi * f_1) ** 2
        before, after, switch = self.stiffness
        # a leak's own series resistance gives way to that of the circuit where both are there
        resistance = of("series_resistance", "R_s_ohm", of("leakage", "R_s_ohm", 0.0))
        from bayes_dea.bench.coupled import Physics

        return Physics(
            Y=Y, stress_per_V2=float(self.maxwell_stress(np.array(1.0))), C0=self.capacitance_F,
            field_per_V=1.0 / self.geometry.layer_thickness_m, R_s=resistance,
            R_leak=of("leakage", "R_leak_ohm", np.inf), E_0=of("leakage", "E_0_V_per_m", np.inf),
            slew=of("supply_current_limit", "slew_V_per_s", np.inf),
            tau_fall=of("one_quadrant_supply", "tau_fall_s", 0.0),
            a_q=of("charge_retention", "a_q", 0.0), tau_q=of("charge_retention", "tau_q_s", 1.0),
            feedback=float("thickness_feedback" in self.effects),
            c_eps=of("stretch_dependent_permittivity", "c_eps", 0.0),
            chi=of("dielectric_absorption", "chi", 0.0), tau_d=of("dielectric_absorption", "tau_d_s", 1.0),
            beta=of("strain_stiffening", "beta", 0.0),
            dE=of("amplitude_softening", "dE_Pa", 0.0), e_c=of("amplitude_softening", "e_c", 1.0),
            slider_k=slider,
            mullins_share=of("mullins_softening", "mullins_share", 0.0),
            mullins_m=of("mullins_softening", "mullins_m_Pa", 1.0),
            mullins_b=of("mullins_softening", "mullins_b", 0.0),
            mass=mass, mass_damper=2.0 * of("inertia", "zeta", 0.0) * float(np.sqrt(Y * mass)),
            d0=of("parallel_damper", "d0_Pa_s", 0.0), d2=of("quadratic_damper", "d2_Pa_s2", 0.0),
            heat=of("self_heating", "heat_share", 0.0), tau_heat=of("self_heating", "tau_heat_s", 1.0),
            field_rate=of("field_dependent_relaxation", "field_rate_per_kV2", 0.0),
            unload_ratio=of("asymmetric_viscosity", "unload_ratio", 1.0),
            thixotropy=of("rest_recovery", "broken_share", 0.0),
            thixotropy_strain=of("rest_recovery", "strain_to_break", 1.0),
            tau_thixotropy=of("rest_recovery", "tau_recover_s", 1.0),
            factor_before=before, factor_after=after, switch_s=switch), yields

    def supply_command(self, time_s: Array, voltage_V: Array) -> Array:
        """Voltage (n,) in V that the supply aims at: dead zone, then saturation, then droop."""
        volts = np.asarray(voltage_V, dtype=float)
        if "supply_dead_zone" in self.effects:
            dead = self.effects["supply_dead_zone"]["V_dead_V"]
            volts = np.sign(volts) * np.maximum(np.abs(volts) - dead, 0.0)
        if "supply_saturation" in self.effects:
            most = self.effects["supply_saturation"]["V_max_V"]
            volts = np.clip(volts, -most, most)
        if "supply_droop" in self.effects:
            from bayes_dea.bench.sensing import first_order

            p = self.effects["supply_droop"]
            warmth = first_order(read_only(time_s), read_only((1e-3 * volts) ** 2), p["tau_droop_s"], 0.0)
            volts = volts * (1.0 - p["droop_share"] * warmth)
        return volts

    def drive(self, time_s: Array, voltage_V: Array) -> Array:
        """True displacement (n,) in m; the voltage of a row is in force until its time (hold "end")."""
        from bayes_dea.bench.integrate import SUBSTEP, strain_under_stress

        time = read_only(time_s)
        k, tau = self.branches()
        if self._coupled:
            from bayes_dea.bench.coupled import TOLERANCE, TOLERANCE_RING, drive_coupled

            physics, yields = self._physics()
            strain, _ = drive_coupled(time, read_only(self.supply_command(time, voltage_V)), physics, k, tau, yields,
                                      TOLERANCE * self.roughness, TOLERANCE_RING * self.roughness)
        else:
            stress = read_only(self.maxwell_stress(voltage_V))
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
        k, tau = self.branches()
        time, imposed = read_only(time_s), read_only(imposed)
        if self._coupled:
            from bayes_dea.bench.coupled import press_coupled

            physics, yields = self._physics()
            # material alone: what the supply and the dielectric do needs a voltage. Only relaxation asks for
            # substeps, so that a strain rate is that of the positions given: mean over the interval of its row
            longest = 0.2 * float(tau.min(initial=np.inf))
            strain, stress = press_coupled(time, imposed, physics, k, tau, yields, longest)
        else:
            strain, stress = stress_between_plates(time, imposed, self.material.Y_Pa, k, tau, SUBSTEP)
        return stress * self.geometry.total_area_m2 / (1.0 - strain)

"""The actuator and its material, as numbers."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Actuator:
    """What [actuator] of campaign.toml states, in its order; default: the actuator of the conformance set."""

    name: str = "CT25.2-10-10-10"
    layers: int = 399
    layer_thickness_m: float = 25e-6
    relative_permittivity: float = 2.8
    electrode_area_m2: float = 7.5602e-5
    total_area_m2: float = 1.1450e-4
    stack_height_m: float = 10.261e-3
    layer_mass_kg: float = 3.4962e-6
    max_voltage_V: int = 1200
    max_frequency_Hz: int = 100
    payload_kg: float = 0.0


@dataclass(frozen=True)
class Material:
    """A spring beside three Maxwell branches, slowest first; default: the baseline of the conformance set."""

    Y_Pa: float = 1.2e6
    k_Pa: tuple[float, ...] = (70e3, 50e3, 60e3)
    tau_s: tuple[float, ...] = (200.0, 20.0, 1.0)

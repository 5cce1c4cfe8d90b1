"""Left out between the command and the dielectric: what supply, leads and leakage do to the voltage."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...priors import Parameter, Prior
from .effect import Effect, off, quantity

if TYPE_CHECKING:
    from ...campaign.schema import Campaign

_CATALOGUE = "catalogue of missing physics"


def largest_command(campaign: Campaign) -> float:
    """Largest magnitude (V) of the commands of a campaign, 0 where it has none."""
    peaks = [float(np.nanmax(np.abs(r.columns["voltage_V"]))) for r in campaign.recordings if "voltage_V" in r.columns]
    return max(peaks, default=0.0)


class SeriesResistance(Effect):
    """A resistor in the line: the dielectric charges through it."""

    name = "series_resistance"
    stage = "electrical"
    label = "series resistance"
    equation = "q' = (V_s - q/C)/R_s,  V_d = q/C,  C = C_0 (1 - e)^-2,  C_0 = N eps0 eps_r A_e/z0"
    source = f"{_CATALOGUE}, E1 and E2; reference paper, Sec. III"
    null = off("R_s_ohm")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the resistance."""
        return (f"between the command and the dielectric a series resistance of {quantity(values['R_s_ohm'], 'ohm')} "
                "was left out")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["R_s_ohm"] = values["R_s_ohm"]


class SupplyCurrentLimit(Effect):
    """The supply gives no more than so much current: edges become ramps."""

    name = "supply_current_limit"
    stage = "electrical"
    in_supply = True
    moves_corners = True
    label = "current limit of the supply"
    equation = "|V_s'| <= I_max/C_0"
    source = f"{_CATALOGUE}, E3"
    null = None
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the slew rate."""
        return (f"the supply's current is limited: its voltage rises and falls by no more than "
                f"{values['slew_V_per_s'] / 1e3:.3g} V/ms")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["slew_V_per_s"] = values["slew_V_per_s"]


class OneQuadrantSupply(Effect):
    """A supply that can push charge but not pull it: falls go through a bleeder."""

    name = "one_quadrant_supply"
    stage = "electrical"
    in_supply = True
    moves_corners = True
    label = "one-quadrant supply"
    equation = "V_s' = -(V_s - V_command)/tau_fall while V_s > V_command; rises at once"
    source = f"{_CATALOGUE}, E4"
    null = off("tau_fall_s")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the time constant."""
        return (f"the supply cannot sink current: its voltage falls with a time constant of "
                f"{quantity(values['tau_fall_s'], 's')}, whatever the command does")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["tau_fall_s"] = values["tau_fall_s"]


class SupplySaturation(Effect):
    """The supply's voltage ends at a limit below the command."""

    name = "supply_saturation"
    stage = "electrical"
    in_supply = True
    moves_corners = True
    label = "saturation of the supply"
    equation = "V_s = min(V_command, V_max)"
    source = f"{_CATALOGUE}, E5"
    null = None
    black_box = True

    def prior_for(self, campaign: Campaign) -> dict[str, Prior]:
        """From half of the campaign's largest command to all of it."""
        top = largest_command(campaign)
        return {"V_max_V": Prior("uniform", 0.5 * top, top)} if top > 0 else {}

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the voltage."""
        return f"the supply saturates: it gives no more than {values['V_max_V']:.4g} V"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["V_max_V"] = values["V_max_V"]


class SupplyDeadZone(Effect):
    """The first volts of a command do nothing."""

    name = "supply_dead_zone"
    stage = "electrical"
    in_supply = True
    label = "dead zone of the supply"
    equation = "V_s = max(0, V_command - V_dead)"
    source = f"{_CATALOGUE}, E6"
    null = off("V_dead_V")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the voltage."""
        return f"the supply has a dead zone: {values['V_dead_V']:.3g} V of every command are missing at its output"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["V_dead_V"] = values["V_dead_V"]


class Leakage(Effect):
    """A current through the dielectric, which drops voltage at whatever resistance is in series."""

    name = "leakage"
    stage = "electrical"
    label = "leakage"
    equation = "q' = (V_s - q/C)/R_s - q/(R_l C);  R_l exp(-sqrt(E/E_0)) where a field activates it"
    source = f"{_CATALOGUE}, E7"
    null = None
    black_box = True

    def parameters_in(self, effects: tuple[str, ...]) -> tuple[Parameter, ...]:
        """The resistance of the actuator itself is a parameter where SPEC has no series resistance."""
        if "series_resistance" in effects:
            return tuple(p for p in self.parameters if p.name != "R_s_ohm")
        return self.parameters

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with both resistances."""
        return (f"the dielectric leaks through {quantity(values['R_leak_ohm'], 'ohm')}, behind a series resistance of "
                f"{quantity(values['R_s_ohm'], 'ohm')}")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["R_leak_ohm"] = values["R_leak_ohm"]
        plant["E_0_V_per_m"] = values["E_0_V_per_m"]
        plant["R_s_ohm"] = values["R_s_ohm"]


class ChargeRetention(Effect):
    """Charge that stays in film or oil and screens the field, with a sign."""

    name = "charge_retention"
    stage = "electrical"
    label = "retained charge"
    equation = "field = (V_d - V_q)/z,  tau_q V_q' = a V_d - V_q"
    source = f"{_CATALOGUE}, E8b"
    null = off("a_q")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with share and time."""
        return (f"charge stays in the film: after some {quantity(values['tau_q_s'], 's')} it screens "
                f"{100 * values['a_q']:.3g} % of the voltage, and acts on when the voltage is off")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["a_q"], plant["tau_q_s"] = values["a_q"], values["tau_q_s"]


EFFECTS = (SeriesResistance(), SupplyCurrentLimit(), OneQuadrantSupply(), SupplySaturation(), SupplyDeadZone(),
           Leakage(), ChargeRetention())

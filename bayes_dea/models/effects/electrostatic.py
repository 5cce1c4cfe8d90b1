"""Left out between the voltage on the dielectric and the Maxwell stress."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Any

from .effect import Effect, off, quantity

_CATALOGUE = "catalogue of missing physics"


class ThicknessFeedback(Effect):
    """Layers get thinner under voltage, which raises field and stress."""

    name = "thickness_feedback"
    stage = "electrostatic"
    label = "thickness feedback"
    equation = "sigma_M = eps0 eps_r (V/z0)^2 (1 - e)^-2"
    source = f"{_CATALOGUE}, E9"
    null = None
    parameters = ()

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence."""
        return ("the layers' own thinning was left out: field and Maxwell stress were taken at the thickness at rest, "
                "not at that under voltage")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["thickness_feedback"] = True


class StretchDependentPermittivity(Effect):
    """Permittivity changes with strain."""

    name = "stretch_dependent_permittivity"
    stage = "electrostatic"
    label = "permittivity that depends on stretch"
    equation = "eps_r (1 + c e)"
    source = f"{_CATALOGUE}, E10"
    null = off("c_eps")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the slope."""
        c = values["c_eps"]
        return (f"the permittivity {'rises' if c > 0 else 'falls'} by {abs(c):.3g} % for every per cent of "
                "compression, which was left out")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["c_eps"] = values["c_eps"]


class DielectricAbsorption(Effect):
    """A part of the polarisation follows late."""

    name = "dielectric_absorption"
    stage = "electrostatic"
    label = "dielectric absorption"
    equation = "sigma_M = (D + P) E,  D = eps0 eps_r E,  tau_d P' = chi D - P"
    source = f"{_CATALOGUE}, E8"
    null = off("chi")
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with share and time."""
        return (f"a part of the polarisation was left out, {100 * values['chi']:.3g} % of it, which follows the field "
                f"with a time constant of {quantity(values['tau_d_s'], 's')} (dielectric absorption)")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["chi"], plant["tau_d_s"] = values["chi"], values["tau_d_s"]


EFFECTS = (ThicknessFeedback(), StretchDependentPermittivity(), DielectricAbsorption())

"""Left out between stress and strain."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from typing import Any

import numpy as np

from ...errors import InputError
from .effect import BOTH, Effect, off, quantity

_CATALOGUE = "catalogue of missing physics"
#: relaxation times of the power-law spectrum, one a decade (s)
FRACTIONAL_TAU_S = 10.0 ** np.arange(-3, 5)


class StrainStiffening(Effect):
    """The material gets stiffer with strain, beyond its static law."""

    name = "strain_stiffening"
    stage = "mechanical"
    label = "strain stiffening"
    equation = "s = s_law(e) + beta Y e^3"
    source = f"{_CATALOGUE}, E13; contract, section 3"
    acts_on = BOTH
    null = off("beta")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the rise at 2 % strain."""
        return (f"the material stiffens with strain: at 2 % compression its tangent modulus is "
                f"{100 * 3 * values['beta'] * 4e-4:.3g} % above that at rest (beta = {values['beta']:.3g})")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["beta"] = values["beta"]


class AmplitudeSoftening(Effect):
    """The secant modulus falls with amplitude, without a loop (Payne effect)."""

    name = "amplitude_softening"
    stage = "mechanical"
    label = "softening with amplitude"
    equation = "s = s_law(e) + dE e/(1 + |e|/e_c)"
    source = f"{_CATALOGUE}, E12 (Kraus)"
    acts_on = BOTH
    null = off("dE_Pa")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with modulus and strain."""
        return (f"the material is stiffer at small strain: {quantity(values['dE_Pa'], 'Pa')} of modulus are lost with "
                f"amplitude, half of them at {100 * values['e_c']:.3g} % strain")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["dE_Pa"], plant["e_c"] = values["dE_Pa"], values["e_c"]


class RateIndependentHysteresis(Effect):
    """Friction in the filler network: springs with sliders, the same loop at every speed."""

    name = "rate_independent_hysteresis"
    stage = "mechanical"
    moves_corners = True
    label = "rate-independent hysteresis"
    equation = "s = s_law(e) + sum s_j,  s_j = clip(s_j + k de, +-k y_j),  y_j exponential, mean eps_y; " \
               "sum k y_j = sigma_y"
    source = f"{_CATALOGUE}, E12; Iwan 1967, 10.1115/1.3607751"
    acts_on = BOTH
    null = off("sigma_y_Pa")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with stress and strain."""
        return (f"friction in the material was left out: loops that do not depend on speed, with a yield stress of "
                f"{quantity(values['sigma_y_Pa'], 'Pa')} reached at about {100 * values['eps_y']:.3g} % strain")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        count = values["friction_elements"]
        if count != round(count):
            raise InputError(f"friction_elements is {count:g}; elements are counted: give one whole number, e.g. "
                             "friction_elements=64, and no prior that can lie between two")
        plant["sigma_y_Pa"], plant["eps_y"] = values["sigma_y_Pa"], values["eps_y"]
        plant["friction_elements"] = round(count)


class ExtraRelaxationMode(Effect):
    """One more Maxwell branch."""

    name = "extra_relaxation_mode"
    stage = "mechanical"
    label = "another relaxation mode"
    equation = "s = ... + q,  q' = k_x e' - q/tau_x"
    source = f"{_CATALOGUE}, E14; Table SII of the reference paper"
    acts_on = BOTH
    null = off("k_x_Pa")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with stiffness and time."""
        return (f"a relaxation of {quantity(values['k_x_Pa'], 'Pa')} with a time constant of "
                f"{quantity(values['tau_x_s'], 's')} was left out")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["branches"] = [*plant["branches"], (values["k_x_Pa"], values["tau_x_s"])]


class FractionalRelaxation(Effect):
    """A continuous spectrum of relaxation times, a power law."""

    name = "fractional_relaxation"
    stage = "mechanical"
    label = "power-law relaxation"
    equation = "s = ... + sum q_i,  a branch a decade, tau_i = 1e-3 ... 1e4 s,  k_i = k_f (tau_i/1 s)^-alpha_f"
    source = f"{_CATALOGUE}, E14"
    acts_on = BOTH
    null = off("k_f_Pa")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with stiffness and exponent."""
        return (f"relaxation over all times was left out: {quantity(values['k_f_Pa'], 'Pa')} a decade around 1 s, with "
                f"an exponent of {values['alpha_f']:.3g}")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        k = values["k_f_Pa"] * FRACTIONAL_TAU_S ** -values["alpha_f"]
        plant["branches"] = [*plant["branches"], *zip(k.tolist(), FRACTIONAL_TAU_S.tolist(), strict=True)]


class ParallelDamper(Effect):
    """A damper beside everything else."""

    name = "parallel_damper"
    stage = "mechanical"
    label = "parallel damper"
    equation = "s = ... + d0 e'"
    source = f"{_CATALOGUE}, E15; Table SII of the reference paper, model 3"
    acts_on = BOTH
    null = off("d0_Pa_s")
    without_network = "gkm"

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the viscosity."""
        return f"a viscous part of {values['d0_Pa_s']:.3g} Pa s in parallel with the material was left out"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["d0_Pa_s"] = values["d0_Pa_s"]


class MullinsSoftening(Effect):
    """The material is softer where it has been before."""

    name = "mullins_softening"
    stage = "mechanical"
    moves_corners = True
    label = "Mullins softening"
    equation = "s = s_law(e) (1 - share erf((W_m - W)/(m + b W_m))),  W_m the largest energy so far"
    source = f"{_CATALOGUE}, E16; Ogden and Roxburgh 1999, 10.1098/rspa.1999.0431 (share = 1/r)"
    acts_on = BOTH
    null = off("mullins_share")

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the share."""
        return (f"the first loading softens the material by up to {100 * values['mullins_share']:.3g} % below the "
                "largest strain it has seen (Mullins effect)")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        for name in ("mullins_share", "mullins_m_Pa", "mullins_b"):
            plant[name] = values[name]


class Inertia(Effect):
    """The mass of stack and payload."""

    name = "inertia"
    stage = "mechanical"
    moves_corners = True
    label = "inertia"
    equation = "s = ... + M e'' + 2 zeta sqrt(Y M) e',  M = Y/(2 pi f_1)^2"
    source = f"{_CATALOGUE}, E17"
    null = None

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with frequency and damping, which are those of the mass on the spring Y alone."""
        return (f"the moving mass was left out: on the spring Y alone it resonates at {values['f_1_Hz']:.3g} Hz with a "
                f"damping ratio of {values['zeta']:.2g} (the other branches shift what rings in the recordings)")

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["f_1_Hz"], plant["zeta"] = values["f_1_Hz"], values["zeta"]


class ThermalExpansion(Effect):
    """The stack grows with temperature against the direction of its stroke; alpha_T < 0: its holder, and by more."""

    name = "thermal_expansion"
    stage = "mechanical"
    moves_corners = True
    label = "thermal expansion"
    equation = "x = ... - alpha_T (T - T at the first row)"
    source = f"{_CATALOGUE}, E20"
    null = off("alpha_T_m_per_K")
    needs = ("temperature_C",)
    black_box = True

    def explain(self, values: Mapping[str, float]) -> str:
        """One sentence with the coefficient."""
        alpha = 1e6 * values["alpha_T_m_per_K"]
        if alpha < 0.0:
            return (f"thermal expansion was left out: readings rise by {-alpha:.3g} um per K of recorded temperature, "
                    "so what holds the sensor grows by more than the stack")
        return f"thermal expansion was left out: {alpha:.3g} um per K, to be taken from the recorded temperature"

    def write(self, plant: MutableMapping[str, Any], values: Mapping[str, float]) -> None:
        """See `Effect.write`."""
        plant["alpha_T_m_per_K"] = values["alpha_T_m_per_K"]


EFFECTS = (StrainStiffening(), AmplitudeSoftening(), RateIndependentHysteresis(), ExtraRelaxationMode(),
           FractionalRelaxation(), ParallelDamper(), MullinsSoftening(), Inertia(), ThermalExpansion())

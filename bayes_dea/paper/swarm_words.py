"""The companion's text to the optimisation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .creep_words import volts
from .printed import printed
from .section import Paragraph
from .smooth_law import SmoothLaw
from .swarm_entries import EQUAL, deflection
from .swarm_fits import (
    SEARCH_IN_WORDS,
    Optimised,
)

Array = NDArray[np.float64]
#: the noise hides what the compliance is below it
_LOW_V = 300.0


def paragraphs(
    sets: dict[str, Optimised],
    as_printed: Optimised,
    law: SmoothLaw,
    curves: dict[str, Any],
    damper: dict[str, float],
    small: Optimised,
) -> tuple[Paragraph, ...]:
    """Paragraphs in the order of the page."""
    gm, gkv = sets["gm"], sets["gkv"]
    i6, i12 = 5, 11
    um = 1e6
    share = 100.0 * float(gm.at_bound.mean())
    factor = implementation_factor()
    printed_factor = (
        factor
        * printed().actuators["creep"]["total_area_m2"].used
        / printed().actuators["creep"]["total_area_m2"].printed
    )
    b = curves["bumps"]
    dampers = sets["gkm"].individual[:, 6]
    # from where on the optimum is near the lower bound, in decades
    below = np.flatnonzero(dampers > 1e-2 * damper["start"])
    soft = np.arange(dampers.size) > (int(below[-1]) if below.size and below[-1] + 1 < dampers.size else -1)
    soft_V = float(sets["gkm"].voltage_V[soft][0])
    fast, slow = by_scale(law)
    return (
        Paragraph(
            "Figure 10",
            "Optimised generalised Maxwell model",
            f"{SEARCH_IN_WORDS} Identified in relaxation, GM is {um * gm.error_start[i6]:.0f} um off at 600 V and "
            f"{um * gm.error_start[i12]:.1f} um at 1200 V (of {um * deflection(gm)[i6]:.0f} and "
            f"{um * deflection(gm)[i12]:.0f} um 30 s after the step); optimised one by one, "
            f"{um * gm.error_individual[i6]:.0f} and {um * gm.error_individual[i12]:.1f} um. {share:.0f} % of the "
            f"factors end at the box: Y is not among what is optimised, and no choice of branches within 40 % makes "
            f"an actuator stiffer by half at 600 V than at 1200 V. The averaged set ends at "
            f"{um * gm.error_averaged[i6]:.0f} and {um * gm.error_averaged[i12]:.0f} um. {_beaten(gm)}",
            "figure_10",
            "Third step at 600 V and 1200 V, delay left in: identified, individual and averaged sets. "
            "Right: mean absolute error over the voltage; grey: 10 % of the displacement.",
        ),
        Paragraph(
            "Figure 11",
            "Optimised generalised Kelvin-Voigt model",
            f"Why GKV starts furthest from its own data can be computed: it was identified with Eq. (1) and strain "
            f"over the height, but is run with the force on A_e carried by A_c and strain over j z_0. Its "
            f"stiffnesses must be multiplied by {factor:.2f} to say the same, which the box of 40 % just allows; "
            f"with the printed A_c = 1.450e-4 m2 by {printed_factor:.2f}, which it does not. Noise and a force that "
            f"is not constant, the paper's reasons, are not needed. Optimised one by one GKV then reaches the noise "
            f"({um * gkv.error_individual[i12]:.2f} um at 1200 V). That the averaged set is always better than the "
            f"individual ones does not come out: with the mended area it is at "
            f"{int(np.sum(gkv.error_averaged < gkv.error_individual))} of 12 voltages, with the printed one at "
            f"{int(np.sum(as_printed.error_averaged < as_printed.error_individual))} of 12 voltages, "
            f"where the second box reaches what the first could not.",
            "figure_11",
            "As Figure 10, for GKV.",
        ),
        Paragraph(
            "Figure 12",
            "Optimised generalised Kelvin-Maxwell model",
            f"With d_0 = {pascal_seconds(damper['start'])} as the start, eight decades wide as the paper sets its "
            f"bounds, the swarm finds a use for the damper that is none: at {damper['voltage_V']:.0f} V d_0 = "
            f"{pascal_seconds(damper['d0'])}, a time constant of {damper['time_s']:.0f} s, so that a model that "
            f"is too soft there has not arrived after 600 s. The mean error falls from {um * damper['without']:.1f} to "
            f"{um * damper['with']:.1f} um that way, and the step response is ruined. From {soft_V:.0f} V up, where "
            f"GM is soft enough, d_0 falls to between {pascal_seconds(dampers[soft].min())} "
            f"and {pascal_seconds(dampers[soft].max())}, towards the lower bound of "
            f"{pascal_seconds(1e-4 * damper['start'])} and far above what silicone has (about 1 kPa s). The paper "
            f"finds GM and GKM almost identical. Reading 1e-4 and 1e4 as Pa s and not as factors brings the "
            f"individual errors within {largest_percent(small.error_individual, gm.error_individual)} of those of "
            f"GM (as factors: {largest_percent(sets['gkm'].error_individual, gm.error_individual)}), with d_0 at "
            f"{pascal_seconds(float(np.median(small.individual[:, 6])))} at the median. {_reading(sets, small)}",
            "figure_12",
            "As Figure 10, for GKM. At 600 V the optimised damper delays the answer by minutes.",
        ),
        Paragraph(
            "Section IV.C",
            "What replaces the look-up (the bumps of Figure 14)",
            f"A look-up joins twelve separate optima by straight lines. Their parameters are not continuous, the 1 s "
            f"mode of 500 V turns into the 30 s mode of 600 V, and the slope of displacement against voltage jumps "
            f"at every breakpoint: its total variation is {b['gkv']:.1f} times its span for GKV, {b['gm']:.1f} for "
            f"GM and {b['gkm']:.1f} for GKM, where 1 is a slope that only rises. One posterior over all twelve "
            f"recordings does without: modes with fixed times, each with a compliance that is a smooth function of "
            f"the voltage (a Gaussian process whose width and length, {law.width.length_V:.0f} V, are learned), "
            f"linear and therefore exact. Its slope has {b['smooth']:.2f} +- {curves['bumps_sd']:.2f}; the law that "
            f"was put in has {b['put in']:.2f}. It needs no swarm, takes less than a second, and comes with bands.",
            "smooth_slopes",
            "Slope of the displacement 30 s after a step against the voltage, in the range of the validation "
            "signals. Band: 90 % of the smooth posterior.",
        ),
        Paragraph(
            "Table SVII, replaced",
            "The compliances as functions of the voltage",
            f"What the smooth posterior says in place of the table: the compliance that acts at once or within 0.1 s "
            f"grows {fast[-1] / fast[0]:.1f}-fold from {_LOW_V:.0f} to 1200 V, which is the deviation from V^2; what "
            f"acts within 25 to 125 s is {100 * slow[-1] / fast[-1]:.0f} % of it at 1200 V. Below 500 V a part of the "
            f"fast one moves to 1 to 5 s. That is in the printed rows; at 1 to 20 um of displacement it may well be "
            f"their noise and their moving median.",
            "smooth_compliances",
            "Compliance by time scale with 90 % bands.",
        ),
    )


def by_scale(law: SmoothLaw) -> tuple[Array, Array]:
    """Compliance within 0.1 s and within 25 to 125 s at `_LOW_V` and 1200 V, each (2,)."""
    c, t = law.at(np.array([_LOW_V, 1200.0])), np.array(law.times_s)
    return c[t <= 0.11].sum(axis=0), c[(t >= 20.0) & (t <= 130.0)].sum(axis=0)


def _beaten(gm: Optimised) -> str:
    """Where the averaged set is ahead of the individual ones, in words."""
    ahead = [round(float(v)) for v, a, i in zip(gm.voltage_V, gm.error_averaged, gm.error_individual, strict=True)
             if a * (1.0 + EQUAL) < i]  # fmt: skip
    if not ahead:
        return "It is nowhere ahead of the individual sets, as the paper reports."
    return f"It beats the individual sets at {volts(ahead)}, other than the paper reports: it has passed two boxes."


def _reading(sets: dict[str, Optimised], small: Optimised) -> str:
    """Which reading of the bounds of d_0 the paper's results speak for."""
    off = [float(np.max(np.abs(o.error_individual / sets["gm"].error_individual - 1.0))) for o in (sets["gkm"], small)]
    if off[1] < 0.05 < off[0]:
        return "The sentence in the paper says the former, its results the latter."
    return "The results do not tell which of the two was meant."


def pascal_seconds(value: float) -> str:
    """A damper with its prefix: 195 MPa s."""
    for power, prefix in ((1e6, "M"), (1e3, "k")):
        if value >= power:
            digits = f"{value / power:.2g}"
            return f"{float(digits):.0f} {prefix}Pa s" if value / power >= 10 else f"{digits} {prefix}Pa s"
    return f"{value:.2g} Pa s"


def largest_percent(a: Array, b: Array) -> str:
    """Largest relative difference, in words."""
    return f"{100.0 * float(np.max(np.abs(a / b - 1.0))):.2g} %"


def implementation_factor() -> float:
    """By what a stiffness of Table SVII is multiplied to mean the same in the model as it is run."""
    p = printed()
    a = p.actuators["creep"]
    stroke = p.constants["layers"].used * p.constants["layer_thickness_m"].used
    return float(a["electrode_area_m2"].used / a["total_area_m2"].used * stroke / a["height_m"].used)

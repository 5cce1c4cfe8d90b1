"""The companion's text to the optimisation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .printed import printed
from .section import Paragraph
from .smooth_law import SmoothLaw
from .swarm_fits import (
    SEARCH_IN_WORDS,
    Optimised,
)

Array = NDArray[np.float64]


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
    return (
        Paragraph(
            "Figure 10",
            "Optimised generalised Maxwell model",
            f"{SEARCH_IN_WORDS} Identified in relaxation, GM is {um * gm.error_start[i6]:.0f} um off at 600 V and "
            f"{um * gm.error_start[i12]:.1f} um at 1200 V (of 51 and 287 um); optimised one by one, "
            f"{um * gm.error_individual[i6]:.0f} and {um * gm.error_individual[i12]:.1f} um. {share:.0f} % of the "
            f"factors end at the box: Y is not among what is optimised, and no choice of branches within 40 % makes "
            f"an actuator stiffer by half at 600 V than at 1200 V. The averaged set ends at "
            f"{um * gm.error_averaged[i6]:.0f} and {um * gm.error_averaged[i12]:.0f} um. It beats the individual "
            f"sets below 1100 V, other than the paper reports: it has passed two boxes.",
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
            f"individual ones does not come out: with the mended area it never is beyond the noise, with the printed "
            f"one it is at {int(np.sum(as_printed.error_averaged < as_printed.error_individual))} of 12 voltages, "
            f"where the second box reaches what the first could not.",
            "figure_11",
            "As Figure 10, for GKV.",
        ),
        Paragraph(
            "Figure 12",
            "Optimised generalised Kelvin-Maxwell model",
            f"With d_0 = {damper['start']:.3g} Pa s as the start, eight decades wide as the paper sets its bounds, "
            f"the swarm finds a use for the damper that is none: at {damper['voltage_V']:.0f} V d_0 = "
            f"{damper['d0']:.2g} Pa s, a time constant of {damper['time_s']:.0f} s, so that a model that is too soft "
            f"there has not arrived after 600 s. The mean error falls from {um * damper['without']:.1f} to "
            f"{um * damper['with']:.1f} um that way, and the step response is ruined. From 900 V up, where GM is "
            f"soft enough, d_0 falls to 7e4 to 2e5 Pa s, near the lower bound of 1.9e4 Pa s and far above what "
            f"silicone has (about 1e3). The paper finds GM and GKM almost identical. That comes out if 1e-4 and 1e4 "
            f"are read as Pa s and not as factors: the individual errors are then within "
            f"{largest_percent(small.error_individual, gm.error_individual)} of those of GM, and d_0 is "
            f"{np.median(small.individual[:, 6]):.2g} Pa s at the median. The sentence in the paper says the former, "
            f"its results the latter.",
            "figure_12",
            "As Figure 10, for GKM. At 600 V the optimised damper delays the answer by minutes.",
        ),
        Paragraph(
            "Figure 14",
            "What replaces the look-up",
            f"A look-up joins twelve separate optima by straight lines. Their parameters are not continuous, the 1 s "
            f"mode of 500 V turns into the 30 s mode of 600 V, and the slope of displacement against voltage jumps "
            f"at every breakpoint: its total variation is {b['gkv']:.1f} times its span for GKV, {b['gm']:.1f} for "
            f"GM and {b['gkm']:.1f} for GKM, where 1 is a slope that only rises. One posterior over all twelve "
            f"recordings does without: modes with fixed times, each with a compliance that is a smooth function of "
            f"the voltage (a Gaussian process whose width and length, {law.width.length_V:.0f} V, are learned), "
            f"linear and therefore exact. Its slope has {b['smooth']:.2f} +- {curves['bumps_sd']:.2f}; the law that "
            f"was put in has {b['put in']:.2f}. It needs no swarm, takes a fifth of a second, and comes with bands.",
            "smooth_slopes",
            "Slope of the displacement 30 s after a step against the voltage, in the range of the validation "
            "signals. Band: 90 % of the smooth posterior.",
        ),
        Paragraph(
            "Table SVII",
            "The compliances as functions of the voltage",
            "What the smooth posterior says in place of the table: the compliance that acts at once or within 0.1 s "
            "grows fourfold with the voltage, which is the deviation from V^2; the slower ones are a tenth of it and "
            "nearly constant. Below 500 V a part of it moves to 1 to 5 s. That is in the printed rows; at 1 to 20 um "
            "of displacement it may well be their noise and their moving median.",
            "smooth_compliances",
            "Compliance by time scale with 90 % bands.",
        ),
    )


def largest_percent(a: Array, b: Array) -> str:
    """Largest relative difference, in words."""
    return f"{100.0 * float(np.max(np.abs(a / b - 1.0))):.2g} %"


def implementation_factor() -> float:
    """By what a stiffness of Table SVII is multiplied to mean the same in the model as it is run."""
    p = printed()
    a = p.actuators["creep"]
    stroke = p.constants["layers"].used * p.constants["layer_thickness_m"].used
    return float(a["electrode_area_m2"].used / a["total_area_m2"].used * stroke / a["height_m"].used)

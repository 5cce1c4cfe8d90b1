"""Inconsistencies of constants, geometry, mass and stroke: each decided from the printed numbers."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from ..models.static import law, stress
from .misprint_decision import Decision
from .printed import Printed

_HIGH = (600, 700, 800, 900, 1000, 1100, 1200)


def vacuum_permittivity(p: Printed) -> Decision:
    """Item 1."""
    c = p.constants["vacuum_permittivity_F_per_m"]
    height = p.actuators["creep"]["height_m"].used
    right = float(p.creep_displacement(1200, 600.0)) / height
    wrong = right * c.printed / c.used
    # the compression test knows no permittivity: what Hooke's row asks for at 1200 V
    hooke = float(p.passive_stress(1200.0)) / p.maxwell.Y_Pa
    digits = f"{c.used * 1e12:.4f}"[1:] == f"{c.printed * 1e12:.4f}"[1:]
    return Decision(
        1, c.where, "vacuum permittivity", c.printed, c.used, "F/m", "misprint",
        f"all digits but the first are those of the constant of nature ({digits}); with it Table SVII gives a strain "
        "of "
        f"{100 * right:.1f} % at 1200 V and Hooke's row of the compression test {100 * hooke:.1f} %, with the printed "
        "one "
        f"{100 * wrong:.1f} % and {100 * hooke * c.printed / c.used:.1f} %, too little for such actuators (3.3 % in "
        "the "
        "literature)",
        {"strain_used": right, "strain_printed": wrong, "hooke_used": hooke, "digits_match": float(digits)},
    )  # fmt: skip


def step_ratio(p: Printed, area_m2: float, height_m: float, at_s: float) -> float:
    """Table SVIII times Hooke over Table SVII at a time, mean over 600 to 1200 V: one where the tables agree."""
    length = p.constants["layers"].used * p.constants["layer_thickness_m"].used
    electrode = p.actuators["creep"]["electrode_area_m2"].used
    out = []
    for v in _HIGH:
        row = p.state_space[v]
        rows = round(at_s / row.sample_time_s) + 1
        hooke = float(p.electrostatic_stress(v)) * electrode / area_m2 / p.maxwell.Y_Pa * length
        kelvin = float(p.electrostatic_stress(v) * p.kelvin_voigt[v].compliance(at_s)) * height_m
        out.append(row.step(rows)[-1] * hooke / kelvin)
    return float(np.mean(out))


def creep_area(p: Printed) -> Decision:
    """Item 2."""
    a = p.actuators["creep"]
    sides = p.constants["measured_width_m"].used * p.constants["measured_depth_m"].used
    printed, used, height = a["total_area_m2"].printed, a["total_area_m2"].used, a["height_m"].used
    right, wrong = step_ratio(p, used, height, 1.0), step_ratio(p, printed, height, 1.0)
    electrode = a["electrode_area_m2"].used
    return Decision(
        2, a["total_area_m2"].where, "total area of the creep actuator", printed, used, "m2", "misprint",
        f"11.429 mm x 10.018 mm are {sides * 1e4:.4f}e-4 m2; with that area Tables SVII and SVIII, identified apart "
        "from one "
        f"another, agree within {100 * abs(right - 1):.1f} % at 1 s (600 V and more), with the printed one they are "
        f"{100 * abs(wrong - 1):.0f} % apart; A_e/A_c is {electrode / used:.3f} as on the other actuator, not "
        f"{electrode / printed:.3f}",
        {"sides": sides, "ratio_used": right, "ratio_printed": wrong, "share_used": electrode / used},
    )  # fmt: skip


def whose_sides(p: Printed) -> Decision:
    """Item 3."""
    sides = p.constants["measured_width_m"].used * p.constants["measured_depth_m"].used
    creep = p.actuators["creep"]["total_area_m2"].used
    press = p.actuators["compression_and_validation"]["total_area_m2"].used
    return Decision(
        3, "Section III.C", "actuator whose sides are 11.429 mm by 10.018 mm", "compression", "creep", "1", "misprint",
        f"the sides give {sides * 1e4:.4f}e-4 m2: {100 * abs(sides / creep - 1):.3f} % from the creep actuator's area, "
        f"{100 * abs(sides / press - 1):.2f} % from that of the compression actuator (Table SIII)",
        {"from_creep": abs(sides / creep - 1), "from_compression": abs(sides / press - 1)},
    )  # fmt: skip


def creep_height(p: Printed) -> Decision:
    """Item 4."""
    v = p.creep["strain_height_m"]
    area = p.actuators["creep"]["total_area_m2"].used
    own = float(np.mean([step_ratio(p, area, v.used, t) for t in (1.0, 30.0)]))
    other = float(np.mean([step_ratio(p, area, v.printed, t) for t in (1.0, 30.0)]))
    return Decision(
        4, v.where, "height that the creep strains refer to", v.printed, v.used, "m", "misprint",
        "the text names the height of the compression actuator, Table SV that of the creep actuator; Tables SVIII and "
        "SVII "
        f"then stand at {own:.3f} to one with 10.261 mm and at {other:.3f} with 10.412 mm: a slip of the text, "
        "decided by one and a half per cent",
        {"ratio_own": own, "ratio_other": other},
    )  # fmt: skip


def stack_length(p: Printed) -> Decision:
    """Item 5."""
    layers, z0 = p.constants["layers"].used, p.constants["layer_thickness_m"].used
    length = layers * z0
    heights = {n: a["height_m"].used for n, a in p.actuators.items()}
    creep, press = heights["creep"], heights["compression_and_validation"]
    at_1200 = float(p.creep_displacement(1200, 1.0))
    return Decision(
        5, "Table SX", "height of the elastomer that moves", press, length, "m", "artefact",
        f"399 layers of 25 um are {length * 1e3:.3f} mm, {100 * (1 - length / creep):.1f} and "
        f"{100 * (1 - length / press):.1f} % less than the two measured heights; the difference is "
        f"{(creep / layers - z0) * 1e6:.1f} to {(press / layers - z0) * 1e6:.1f} um of electrode a layer. "
        "Displacement goes "
        f"with the layers; {at_1200 * (1 - length / creep) * 1e6:.1f} um of {at_1200 * 1e6:.0f} um hang on it",
        {"length_m": length, "short_creep": 1 - length / creep, "short_compression": 1 - length / press,
         "at_stake_m": at_1200 * (1 - length / creep)},
    )  # fmt: skip


def moving_mass(p: Printed) -> Decision:
    """Item 14."""
    m, Y = p.constants["moving_mass_kg"], p.maxwell.Y_Pa
    a, z0 = p.actuators["compression_and_validation"], p.constants["layer_thickness_m"].used
    area, height = a["total_area_m2"].used, a["height_m"].used
    density = m.printed / (area * z0)
    layer = sqrt(Y * area / z0 / m.printed) / (2 * pi)
    stack = 0.25 * sqrt(Y * area / height / m.used)
    return Decision(
        14, m.where, "mass that moves", m.printed, m.used, "kg", "misprint",
        f"3.4962e-6 kg are one layer ({density:.0f} kg/m3) and make an oscillator of {layer / 1e3:.0f} kHz, which is "
        "why the "
        f"solvers had to be stiff; 399 layers weigh {m.used * 1e3:.3f} g and swing at {stack:.0f} Hz (rod with one "
        "free end)",
        {"density": density, "layer_Hz": layer, "stack_Hz": stack},
    )  # fmt: skip


def strokes(p: Printed) -> Decision:
    """Item 26."""
    height = p.actuators["compression_and_validation"]["height_m"].used
    long, short = p.compression["travel_m"].used, p.relaxation["travel_m"].used
    slack = long - p.compression["strain"].used * height, short - p.relaxation["strain"].used * height
    hooke = {end: _projected_modulus(p, end) for end in (p.compression["strain"].used, long / height)}
    at_20, at_full = hooke.values()
    return Decision(
        26, "Section III.C", "strain of the compression "
                             "test", p.compression["strain"].used, long / height, "1", "misprint",
        f"20 % and 15 % of 10.412 mm leave {slack[0] * 1e3:.2f} and {slack[1] * 1e3:.2f} mm of the strokes of 2.5 and "
        "1.75 mm, "
        f"{100 * (slack[0] - slack[1]) / height:.1f} % of strain apart. Table SIV decides: Hooke's row follows from "
        "Yeoh's as "
        f"{at_20 / 1e6:.4f} MPa over 20 % and as {at_full / 1e6:.4f} MPa over 2.5 mm, printed is 1.1947 MPa. The "
        "stroke "
        "was strain from end to end, and the zero of the relaxation test is off by up to 1.8 %",
        {"slack_compression_m": slack[0], "slack_relaxation_m": slack[1], "Y_at_20": at_20, "Y_at_full": at_full},
    )  # fmt: skip


def _projected_modulus(p: Printed, end: float) -> float:
    e = np.linspace(0.0, end, 2001)
    return float(e @ stress(law("yeoh"), p.static["yeoh"].used, e) / (e @ e))


def load_cell(p: Printed) -> Decision:
    """Item 27."""
    Y, area = p.maxwell.Y_Pa, p.actuators["compression_and_validation"]["total_area_m2"].used
    limit = p.noise["load_cell_range_N"].used

    def force(e: float) -> float:
        return Y * e * area / (1 - e)

    at_limit = limit / (Y * area + limit)
    end = p.compression["travel_m"].used / p.actuators["compression_and_validation"]["height_m"].used
    peak = (Y + sum(p.maxwell.k_Pa)) * p.relaxation["strain"].used * area / (1 - p.relaxation["strain"].used)
    return Decision(
        27, "Section III.C", "force at 20 % against the cell's range", limit, force(0.2), "N", "misprint",
        f"by Hooke's row 20 % take {force(0.2):.1f} N ({Y * 0.2 * area:.1f} N even as engineering stress); the cell's "
        "20 N "
        f"are reached at {100 * at_limit:.1f} %; over the whole 2.5 mm (item 26) it takes {force(end):.0f} N. The "
        f"relaxation peak is {peak:.1f} N. Clipping or bending of the cell "
        "above 20 N "
        "cannot be excluded without the records",
        {"force_N": force(0.2), "strain_at_limit": at_limit, "relaxation_N": peak},
    )  # fmt: skip


def manufacturer_modulus(p: Printed) -> Decision:
    """Item 28."""
    Y, given = p.maxwell.Y_Pa, p.constants["manufacturer_modulus_Pa"].used
    instant = Y + sum(p.maxwell.k_Pa)
    return Decision(
        28, "Section V", "modulus that corresponds to the manufacturer's", Y, instant, "Pa", "artefact",
        f"1.1947 MPa are {100 * (Y / given - 1):.0f} % from 1.4 MPa; the instantaneous modulus Y + k_1 + k_2 + k_3 is "
        f"{100 * (instant / given - 1):+.0f} % from it and {100 * ((instant - p.maxwell.k_Pa[0]) / given - 1):+.0f} % "
        "without k_1, which is no mode",
        {"slow": Y / given - 1, "instant": instant / given - 1},
    )  # fmt: skip


def two_masses(p: Printed) -> Decision:
    """Item 34."""
    m, z0 = p.constants["moving_mass_kg"].printed, p.constants["layer_thickness_m"].used
    rho = {n: m / (a["total_area_m2"].used * z0) for n, a in p.actuators.items()}
    creep, press = rho["creep"], rho["compression_and_validation"]
    return Decision(
        34, "Tables SIX, SX", "one mass for two actuators", m, m, "kg", "stands",
        f"the density it means is {creep:.0f} and {press:.0f} kg/m3, {100 * (press / creep - 1):.2f} % apart; below "
        "100 Hz "
        "nothing hangs on it",
        {"density_creep": creep, "density_compression": press},
    )  # fmt: skip


def other_actuator(p: Printed) -> Decision:
    """Item 35."""
    a, b = p.actuators["creep"], p.actuators["compression_and_validation"]
    ratio = {k: b[k].used / a[k].used - 1 for k in ("height_m", "total_area_m2", "electrode_area_m2")}
    share = (1 + ratio["electrode_area_m2"]) / (1 + ratio["total_area_m2"]) - 1
    return Decision(
        35, "Section IV.D", "gain from the actuator of the optimisation to that of the validation", "1 (implied)",
        "unknown", "1", "open",
        f"height {100 * ratio['height_m']:+.1f} %, A_c {100 * ratio['total_area_m2']:+.2f} %, A_e "
        f"{100 * ratio['electrode_area_m2']:+.2f} %, A_e/A_c {100 * share:+.1f} %: geometry makes the two alike, but "
        "the "
        "modulus of the second under voltage is printed nowhere, so a free gain between them has to be allowed",
        {**ratio, "share": share},
    )  # fmt: skip

"""The companion's text to the left-out effect."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..mismatch.diagnosis import Diagnosis
from .creep_law_entries import BIAS_V, RIVALS, SWING_V, best_single, by_state_space, law_points, with_feedback
from .creep_laws import Weighed, exponent, stroke_m
from .printed import Printed
from .section import Paragraph

Array = NDArray[np.float64]


def paragraphs(
    p: Printed,
    rows: Diagnosis,
    common: Diagnosis,
    laws: list[Weighed],
    probability: Array,
    swings: dict[str, tuple[float, float]],
    ask: dict[str, Any],
) -> tuple[Paragraph, ...]:
    """Paragraphs in the order of the page."""
    V, x = law_points(p)
    high = V >= 600
    plain, fed = with_feedback(p, np.array([1200.0]))
    chi2 = {w.name: w.chi2 for w in laws}
    good = [(w, float(q)) for w, q in zip(laws, probability, strict=True) if q > 0.01]
    single, share = best_single(rows)
    single_common, share_common = best_single(common)
    named = ", ".join(f"{w.name} ({q:.2f})" for w, q in good)
    low, top = (min, max)
    values = {w.name: swings[w.name][0] for w, _ in good}
    few, many = low(values, key=lambda n: values[n]), top(values, key=lambda n: values[n])
    asked = ""
    if ask:
        settings = ", ".join(f"{k} = {v:.3g}" if isinstance(v, float) else str(v) for k, v in ask["recording"].items())
        asked = f" For its own two fits ({' and '.join(RIVALS)}) the tool asks for: {settings} ({ask['why']})."
    return (
        Paragraph(
            "Eqs. (1) and (4)",
            "The law in the paper's own tables",
            f"Eq. (1) with Hooke's law says that displacement goes as V^2. The rows of Table SVII at 30 s go as "
            f"V^{exponent(V, x):.2f} from 100 to 1200 V and as V^{exponent(V[high], x[high]):.2f} from 600 V up; "
            f"Table SVIII, identified separately, gives V^{exponent(V, by_state_space(p)):.2f}. The secant modulus "
            f"falls from {1e-6 * float((p.passive_stress(V) / (x / stroke_m()))[0]):.2f} to "
            f"{1e-6 * float((p.passive_stress(V) / (x / stroke_m()))[-1]):.2f} MPa. The thickness that Eq. (1) keeps "
            f"constant accounts for {1e6 * float(fed[0] - plain[0]):.0f} um at 1200 V, which is as much as the "
            f"sensor's accuracy, but not for a factor of two. The creep after the step has the same shape at all "
            f"voltages, so that what is missing is a static law and not a viscous one. The paper sees its traces (a "
            f"GM that is right at 1200 V and 40 % off at 600 V, averaged sets that suit large deformations) and "
            f"takes them for the look-up's.",
            "voltage_law",
            "Left: displacement 30 s after the step by both tables, and laws fitted to Table SVII. Right: the secant "
            "modulus.",
        ),
        Paragraph(
            "Tables SVII and SVIII",
            "The tool's verdict",
            f'Given recordings of the twelve rows, diagnose with hooke+gm3 says: "{rows.summary["statement"]}" '
            f"With one common time shape, so that nothing but the law differs between voltages: "
            f'"{common.summary["statement"]}" The single effect that takes most is {single} ({100 * share:.0f} % '
            f"of what is missing, with one time shape {single_common}, {100 * share_common:.0f} %). "
            f"{_beside(rows, common)} {_judged(rows, common)}: the recordings claim 4.7 um of white noise over many "
            f"samples, the twelve rows behind them were fitted one by one and scatter by "
            f"{scatter(V, x, laws[0]):.1f} % around the best "
            f"smooth law (300 to 1200 V), and no physics explains a scatter of the tables. Reconstructed recordings "
            f"cannot carry a stronger verdict.",
            "voltage_law_verdict",
            "Log evidence gained over hooke+gm3, in nats.",
        ),
        Paragraph(
            "Section VI",
            "The rivals, weighed with the scatter of the rows",
            f"With an error of 3 % and 1 um for each row, chi^2 of the twelve points is {chi2['V^2']:.0f} for Hooke, "
            f"{chi2['V^2 + thickness feedback']:.0f} with the exact Maxwell stress, {chi2['dead zone']:.0f} for a "
            f"dead zone of the supply, {chi2['V^2 + V^4']:.1f} for a compliance that grows with the field, "
            f"{chi2['softening']:.1f} for a modulus that falls with strain, and {chi2['friction']:.1f} for friction "
            f"in the material ({chi2['friction + thickness feedback']:.1f} with the exact stress). Those with more "
            f"than one per cent of the probability: {named}. Twelve static points leave it at that. Friction alone "
            f"also foretells a residual strain and an open loop in slow compression, both of which the paper "
            f"reports, but of another actuator.",
            "voltage_law_rivals",
            "Left: chi^2 and probability. Right: the stroke that each law foretells for 50 V on a bias of 1000 V.",
        ),
        Paragraph(
            "Next experiment",
            "The experiment that would decide",
            f"A small sine on a large bias: {SWING_V:.0f} V at 1 Hz on {BIAS_V:.0f} V moves the actuator by "
            f"{1e6 * values[few]:.0f} um if it is {few} and by {1e6 * values[many]:.0f} um if it is {many}, "
            f"with an uncertainty of {1e6 * max(swings[n][1] for n in values):.1f} um at most; ten periods at 1 kHz "
            f"tell 0.2 um. A blocked force that goes as V^2 would put the cause into the material, one that does not "
            f"into the field. A repetition of 600 V after 1200 V would show whether the twelve rising voltages "
            f"softened the actuator.{asked}",
        ),
    )


def _parts(d: Diagnosis) -> list[str]:
    """Effects of the best hypothesis that has a name."""
    named = [h["name"] for h in d.summary["hypotheses"] if h["name"] not in ("unknown", "none")]
    return str(named[0]).split("+") if named else []


def _beside(rows: Diagnosis, common: Diagnosis) -> str:
    """What is named beside it, and whether that can be relied on."""
    a, b = _parts(rows), _parts(common)
    both = [name for name in a if name in b]
    if set(a) == set(b):
        return f"Both name {' and '.join(both)}."
    once = [name for name in (*a, *b) if name not in both]
    return (f"What is named beside the largest ({', '.join(once)} once each) changes from one reconstruction to the "
            "next, and with another noise; only what comes back is to be considered at all.")


def _judged(rows: Diagnosis, common: Diagnosis) -> str:
    """What to think of the verdicts."""
    short = [d.summary["verdict"] == "unknown" for d in (rows, common)]
    if all(short):
        return "That it stops short of a name is right"
    return "That it gives a name goes further than such recordings allow" if not any(short) else (
        "That it stops short of a name for one of them is right")


def scatter(V: Array, x: Array, w: Weighed) -> float:
    """RMS in % of the rows around a law, from 300 V up."""
    off = (x / w.displacement_m - 1.0)[V >= 300]
    return float(100.0 * np.sqrt(np.mean(off**2)))

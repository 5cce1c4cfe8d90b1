"""Data of the pictures of the left-out effect."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mismatch.diagnosis import Diagnosis
from .creep_law_entries import BIAS_V, SWING_V, by_state_space, law_points
from .creep_laws import ROW_ERROR, Weighed, stroke_m
from .printed import Printed
from .reconstruct import listed

Array = NDArray[np.float64]


def draw_law(p: Printed, laws: list[Weighed]) -> dict:
    """Data of the picture of the law."""
    V, x = law_points(p)
    hooke = next(w for w in laws if w.name == "V^2")
    shown = {w.name: listed(1e6 * w.displacement_m) for w in laws[:3]} | {"V^2": listed(1e6 * hooke.displacement_m)}
    return {
        "voltage_V": listed(V),
        "x_um": listed(1e6 * x),
        "x8_um": listed(1e6 * by_state_space(p)),
        "sd_um": listed(1e6 * np.hypot(ROW_ERROR[0] * x, ROW_ERROR[1])),
        "laws": shown,
        "secant_MPa": listed(1e-6 * p.passive_stress(V) / (x / stroke_m())),
    }


def draw_rivals(laws: list[Weighed], probability: Array, swings: dict[str, tuple[float, float]]) -> dict:
    """Data of the picture of the rivals."""
    return {
        "names": [w.name for w in laws],
        "chi2": [w.chi2 for w in laws],
        "probability": listed(probability),
        "swing_um": [1e6 * swings[w.name][0] for w in laws],
        "swing_sd_um": [1e6 * swings[w.name][1] for w in laws],
        "bias_V": BIAS_V,
        "swing_V": SWING_V,
    }


def draw_verdict(rows: Diagnosis, common: Diagnosis) -> dict:
    """Data of the picture of the log evidences."""
    out = []
    for title, d in (("rows as printed", rows), ("one time shape", common)):
        e = d.naming.log_evidence
        kept = [n for n in e if (n in d.naming.weighed or n in ("none", "unknown")) and np.isfinite(e[n])]
        order = sorted(kept, key=lambda n: -e[n])
        singles = [n for n in order if "+" not in n][:8]
        shown = [n for n in order if n in set(order[:3]) | set(singles)]
        out.append({"title": title, "names": shown, "gain": listed([e[n] - e["none"] for n in shown])})
    return {"panels": out}

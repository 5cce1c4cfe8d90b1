"""Data of the pictures of the optimisation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .reconstruct import (
    CreepRecording,
    listed,
    processed,
    thin,
)
from .smooth_law import SmoothLaw
from .swarm_entries import FIGURES, SHOWN, deflection
from .swarm_fits import (
    NAMES,
    TITLES,
    Geometry,
    Optimised,
    modes_of,
    step_answers,
)

Array = NDArray[np.float64]


def picture_key(model: str) -> str:
    """Key of the figure of a model."""
    return FIGURES[model].lower().replace(" ", "_")


def draw(model: str, recordings: tuple[CreepRecording, ...], o: Optimised, g: Geometry) -> dict:
    """Data of Figure 10, 11 or 12."""
    panels = []
    for i, r in enumerate(recordings):
        if r.voltage_V not in SHOWN:
            continue
        # the paper checks on the data with the delay in
        shown = processed(r, delay_s=0.0)
        rows = thin(shown.time_s.size, 220, logarithmic=True)
        t = shown.time_s[rows]
        scale = 1e6 * g.stroke_m * g.stress_per_V2 * r.voltage_V**2
        panel: dict[str, Any] = {
            "voltage_V": r.voltage_V,
            "time_s": listed(t),
            "data_um": listed(1e6 * shown.displacement_m[rows]),
        }
        for name, p in (("org", o.start[i]), ("indiv", o.individual[i]), ("avg", o.averaged)):
            panel[f"{name}_um"] = listed(scale * step_answers(modes_of(model, p), t)[0])
        panels.append(panel)
    return {
        "model": TITLES[model],
        "panels": panels,
        "voltage_V": listed(o.voltage_V),
        "org": listed(1e6 * o.error_start),
        "indiv": listed(1e6 * o.error_individual),
        "avg": listed(1e6 * o.error_averaged),
        "size": listed(1e6 * deflection(o)),
        "names": list(NAMES[model]),
        "bound_share": listed(o.at_bound.mean(axis=0)),
    }


def draw_law(law: SmoothLaw, rng: np.random.Generator) -> dict:
    """Data of the picture of the law."""
    v = np.arange(100.0, 1201.0, 10.0)
    draws = law.at(v, 200, rng)
    low, high = np.quantile(draws, [0.05, 0.95], axis=0)
    mean = law.at(v)
    groups = (
        ("at once and within 0.1 s", [0, 1]),
        ("within 1 to 5 s", [2, 3]),
        ("within 25 to 125 s", [4, 5]),
        ("later (3000 s)", [6]),
    )
    out = []
    for title, pick in groups:
        total = draws[:, pick].sum(axis=1)
        low, high = np.quantile(total, [0.05, 0.95], axis=0)
        out.append({"title": title, "mean": listed(mean[pick].sum(axis=0)), "low": listed(low), "high": listed(high)})
    return {"voltage_V": listed(v), "groups": out, "length_V": law.width.length_V}

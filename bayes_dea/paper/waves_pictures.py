"""Data of the pictures of the validation: Figures 13 to 16, the repaired 10 Hz, the diagnosis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .reconstruct import (
    WaveRecording,
    listed,
    thin,
)
from .waves_bumps import last_period
from .waves_entries import NAMES

Array = NDArray[np.float64]


def draw(
    model: str,
    waves: tuple[WaveRecording, ...],
    answers: list[dict[str, Array]],
    table: dict[str, Array],
    bands: list[dict[str, Any]],
) -> dict:
    """Data of one figure."""
    keys = [k for k in table if k.split()[0] == model]
    extra = {"gkv": ["smooth, slow"], "gkm": ["gkm2 look-up"]}.get(model, [])
    panels = []
    for i, (w, a, band) in enumerate(zip(waves, answers, bands, strict=True)):
        part = last_period(w)
        t = w.time_s[part] - w.time_s[part.start]
        rows = thin(t.size, 110)
        panels.append(
            {
                "name": w.name,
                "time_s": listed(t[rows]),
                "data_um": listed(1e6 * w.displacement_m[part][rows], 4),
                "curves": {k: listed(1e6 * a[k][part][rows], 4) for k in keys + extra},
                "r2": {k: float(table[k][i]) for k in keys + extra},
                "low_um": listed(1e6 * band["low"][part][rows], 4),
                "high_um": listed(1e6 * band["high"][part][rows], 4),
            }
        )
    return {"model": NAMES[model], "panels": panels}


def draw_repaired(
    waves: tuple[WaveRecording, ...],
    answers: list[dict[str, Array]],
    mended: list[dict[str, Array]],
    bands: list[dict[str, Any]],
) -> dict:
    """Data of the picture of 10 Hz before and after the repair."""
    panels = []
    for w, a, b, band in zip(waves, answers, mended, bands, strict=True):
        if w.frequency_Hz != 10.0:
            continue
        part = last_period(w)
        t = w.time_s[part] - w.time_s[part.start]
        rows = thin(t.size, 100)

        def um(y: Array, part: slice = part, rows: NDArray[np.int64] = rows) -> list[float]:
            return listed(1e6 * y[part][rows], 4)

        panels.append(
            {
                "name": w.name,
                "time_s": listed(t[rows]),
                "data_um": um(w.displacement_m),
                "gm_um": um(a["gm avg"]),
                "gm_mended_um": um(b["gm avg"]),
                "ours_um": um(b["smooth, slow"]),
                "low_um": um(band["low"]),
                "high_um": um(band["high"]),
            }
        )
    return {"panels": panels}


def draw_diagnosis(v: dict[str, Any]) -> dict:
    """Data of the picture of held-out errors."""
    held = v["proof"]["held_out"]
    return {
        "recordings": [h["recording"].removesuffix(".csv").replace("_", " ").replace("Hz", " Hz") for h in held],
        "before_um": listed([1e6 * h["rmse_before_m"] for h in held]),
        "after_um": listed([1e6 * h["rmse_after_m"] for h in held]),
        "noise_um": 1e6 * v["proof"]["noise_m"],
        "verdict": v["verdict"],
        "confidence": v["confidence"],
    }

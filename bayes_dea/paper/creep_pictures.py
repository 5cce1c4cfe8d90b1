"""Data of the pictures of the creep section."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .creep_entries import SHOWN, TABLE, gain, printed_value
from .creep_fits import (
    RATE_BOUND_PER_S,
    DirectFit,
    ProcessFit,
    hooke_input,
)
from .printed import Printed
from .reconstruct import (
    CreepRecording,
    listed,
    median_window,
    moving_median,
    processed,
    thin,
)

Array = NDArray[np.float64]


def draw_eight(
    recordings: tuple[CreepRecording, ...], fits: dict[int, dict[str, Any]], rng: np.random.Generator
) -> dict:
    """Data of Figure 8."""
    panels = []
    for r in recordings:
        if r.voltage_V not in SHOWN:
            continue
        data = processed(r)
        rows = thin(data.time_s.size, 300, logarithmic=True)
        t = data.time_s[rows]
        f = fits[r.voltage_V]
        low, high = f["post3"].band(t, rng)
        panels.append(
            {
                "voltage_V": r.voltage_V,
                "time_s": listed(t),
                "data_um": listed(1e6 * data.displacement_m[rows]),
                "two_um": listed(1e6 * f["two"].displacement(t)),
                "three_um": listed(1e6 * f["three"].displacement(t)),
                "low_um": listed(1e6 * low),
                "high_um": listed(1e6 * high),
                "r2_two": f["two"].r2,
                "r2_three": f["three"].r2,
            }
        )
    return {
        "panels": panels,
        "voltage_V": [float(v) for v in fits],
        "r2_two": [f["two"].r2 for f in fits.values()],
        "r2_three": [f["three"].r2 for f in fits.values()],
        "nats": [f["post3"].log_evidence - f["post2"].log_evidence for f in fits.values()],
    }


def draw_table(p: Printed, fits: dict[int, dict[str, Any]]) -> dict:
    """Data of the picture of Table SVII."""
    out: dict[str, Any] = {"voltage_V": [float(v) for v in fits], "bound_per_s": RATE_BOUND_PER_S, "values": {}}
    for name in TABLE:
        logs = np.array([f["post3"].log_value(name) for f in fits.values()])
        out["values"][name] = {
            "printed": listed([printed_value(p, v, name) for v in fits]),
            "ours": listed(np.exp(logs[:, 0])),
            "low": listed(np.exp(logs[:, 0] - 1.645 * logs[:, 1])),
            "high": listed(np.exp(logs[:, 0] + 1.645 * logs[:, 1])),
        }
    return out


def draw_nine(recordings: tuple[CreepRecording, ...], fits: dict[int, dict[str, Any]]) -> dict:
    """Data of Figure 9."""
    panels = []
    for r in recordings:
        if r.voltage_V not in SHOWN:
            continue
        f = fits[r.voltage_V]
        process: ProcessFit = f["process"]
        direct: DirectFit = f["direct"]
        y = moving_median(r.displacement_m, median_window(r.voltage_V))
        simulated = process.simulate(r.time_s, hooke_input(r))
        rows = thin(r.time_s.size, 380)
        begin = r.step - 10
        edge = np.arange(begin, begin + 80)
        panel: dict[str, Any] = {"voltage_V": r.voltage_V, "r2_process": process.r2, "r2_direct": direct.r2}
        for key, at in (("whole", rows), ("edge", edge)):
            since = 0.0 if key == "whole" else r.time_s[r.step - 1]
            panel[key] = {
                "time_s": listed(r.time_s[at] - since, 6),
                "data_um": listed(1e6 * y[at]),
                "process_um": listed(1e6 * simulated[at]),
                "direct_um": listed(1e6 * direct.simulated_m[at]),
            }
        panels.append(panel)
    return {
        "panels": panels,
        "voltage_V": [float(v) for v in fits],
        "r2_process": [f["process"].r2 for f in fits.values()],
        "r2_direct": [f["direct"].r2 for f in fits.values()],
    }


def draw_gains(p: Printed, fits: dict[int, dict[str, Any]]) -> dict:
    """Data of the picture of Table SVIII."""
    voltages = list(fits)
    return {
        "voltage_V": [float(v) for v in voltages],
        "gain_printed": listed([gain(p, v) for v in voltages]),
        "gain_ours": listed([fits[v]["process"].step(np.array([30.0]))[0] for v in voltages]),
        "fast_printed_ms": listed([1e3 * np.sum(1.0 / p.state_space[v].poles_per_s[1:]) for v in voltages]),
        "fast_ours_ms": listed([1e3 * fits[v]["process"].Tp[1:].sum() for v in voltages]),
    }

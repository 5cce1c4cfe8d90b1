"""Optimised parameters: Figures 10 to 12, the look-up table, and the smooth posterior that replaces it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..printed import printed
from ..reconstruct import (
    Sensing,
    creep_recordings,
    listed,
    processed,
    thin,
    voltage_law,
)
from ..section import Section, Task
from ..smooth_law import TIMES_S, SmoothLaw, bumpiness, learn, sums_of
from ..swarm_entries import ANCHOR_S, claims, small_damper, smooth_entries
from ..swarm_fits import (
    MODELS,
    TITLES,
    Geometry,
    Optimised,
    StepData,
    errors,
    modes_of,
    optimise,
    start_values,
    step_answers,
    step_data,
)
from ..swarm_pictures import draw, draw_law, picture_key
from ..swarm_words import paragraphs
from ..waves_models import looked_up

Array = NDArray[np.float64]
#: range of the validation signals, over which a look-up is read (V), and the step of the curves
_RANGE_V = (250.0, 1050.0)
_GRID_V = 2.0


def run(task: Task) -> Section:
    """Swarm optimisation as in the paper, and what replaces the look-up."""
    began = time.perf_counter()
    rng = task.generator("optimisation")
    recordings = creep_recordings(rng)
    data = [step_data(processed(r)) for r in recordings]
    done = 0
    of = (len(MODELS) + 2) * 13 + 3

    def step() -> None:
        nonlocal done
        done += 1
        task.report("particle swarms", done, of)

    g = Geometry.of("creep")
    sets = {m: optimise(m, data, g, rng, report=step) for m in MODELS}
    printed_area = Geometry.of("creep", printed().actuators["creep"]["total_area_m2"].printed)
    as_printed = optimise("gkv", data, printed_area, rng, report=step)
    small_d0 = optimise("gkm", data, g, rng, report=step, absolute=True)
    task.report("smooth posterior", of - 2, of)
    law = learn(sums_of(recordings, Sensing().delay_s, Sensing().sigma_m, TIMES_S))
    curves = _curves(sets, law, rng)
    low_d0 = _slow_damper(sets["gkm"], data, g)
    out_entries = (*claims(sets, as_printed), *small_damper(sets, small_d0), *smooth_entries(law, curves))
    pictures = {picture_key(m): draw(m, recordings, sets[m], g) for m in MODELS}
    pictures["smooth_slopes"] = curves["data"]
    pictures["smooth_compliances"] = draw_law(law, rng)
    task.report("particle swarms", of, of)
    return Section(
        "optimisation",
        "Optimised parameters and what replaces the look-up",
        paragraphs(sets, as_printed, law, curves, low_d0, small_d0),
        out_entries,
        pictures,
        (),
        time.perf_counter() - began,
    )


def _curves(sets: dict[str, Optimised], law: SmoothLaw, rng: np.random.Generator) -> dict[str, Any]:
    """Displacement 30 s after a step and its slope over the voltage: look-ups, smooth posterior, what was put in."""
    v = np.arange(_RANGE_V[0], _RANGE_V[1] + 1.0, _GRID_V)
    g = Geometry.of("creep")
    t = np.array([ANCHOR_S])
    x: dict[str, Array] = {}
    for m in MODELS:
        rows = looked_up(sets[m].voltage_V, sets[m].individual, v)
        x[m] = g.stroke_m * g.stress_per_V2 * v**2 * step_answers(modes_of(m, rows), t)[:, 0]
    x["smooth"] = law.step(v, ANCHOR_S)
    x["put in"] = voltage_law(printed())(v)
    draws = law.step(v, ANCHOR_S, 200, rng)
    bumps = {k: bumpiness(v, y) for k, y in x.items()}
    spread = np.array([bumpiness(v, d) for d in draws])
    middle = 0.5 * (v[1:] + v[:-1])
    at = thin(middle.size, 350)
    slopes = {k: listed(1e6 * (np.diff(y) / np.diff(v))[at]) for k, y in x.items()}
    band = np.quantile(np.diff(draws, axis=1) / _GRID_V, [0.05, 0.95], axis=0)
    titles = {m: f"look-up of {TITLES[m]}" for m in MODELS} | {"smooth": "smooth posterior", "put in": "the law put in"}
    return {
        "bumps": bumps,
        "bumps_sd": float(spread.std()),
        "titles": titles,
        "data": {
            "voltage_V": listed(middle[at]),
            "slope_um_per_V": slopes,
            "bumps": bumps,
            "titles": titles,
            "low": listed(1e6 * band[0][at]),
            "high": listed(1e6 * band[1][at]),
            "x_voltage_V": listed(v[thin(v.size, 200)]),
            "x_um": {k: listed(1e6 * y[thin(v.size, 200)]) for k, y in x.items()},
        },
    }


def _slow_damper(o: Optimised, data: list[StepData], g: Geometry) -> dict[str, float]:
    """What the damper d_0 gains at 300 V over the model without it, and the time it acts over."""
    i = int(np.argmin(np.abs(o.voltage_V - 300.0)))
    with_it = float(o.error_individual[i])
    p = o.individual[i].copy()
    without = float(errors("gm", p[None, :6], data[i], g)[0])
    d0 = float(p[6])
    return {
        "voltage_V": float(o.voltage_V[i]),
        "with": with_it,
        "without": without,
        "d0": d0,
        "time_s": d0 / (printed().maxwell.Y_Pa + float(p[:3].sum())),
        "start": float(start_values("gkm", 300)[6]),
    }

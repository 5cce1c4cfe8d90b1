"""Validation: nine signals, Figures 13 to 16, and whether delay and series resistance are what fails at 10 Hz."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...mismatch.diagnosis import DiagnosisSettings, diagnose
from ..creep_fits import r_squared
from ..printed import printed
from ..reconstruct import (
    Sensing,
    WaveRecording,
    creep_recordings,
    delayed,
    listed,
    low_pass,
    processed,
    wave_recordings,
)
from ..section import Section, Task
from ..smooth_law import SKIP_S, SLOW_TIMES_S, TIMES_S, SmoothLaw, learn, sums_of
from ..swarm_fits import MODELS, Geometry, Optimised, optimise, step_data
from ..waves_campaign import bench_campaign
from ..waves_entries import FIGURES, TRUE_VERDICT, claims, diagnosis_entries, r2_entries, suspicion
from ..waves_models import fixed_answer, lookup_answer, state_space_answer
from ..waves_pictures import draw, draw_diagnosis, draw_repaired
from ..waves_words import paragraphs

Array = NDArray[np.float64]
_ACTUATOR = "compression_and_validation"
_DRAWS = 40


def run(task: Task) -> Section:
    """Nine signals through every model and implementation, and the paper's suspicion put to `diagnose`."""
    began = time.perf_counter()
    rng = task.generator("validation")
    of = 7
    task.report("optimised sets", 0, of)
    creep = creep_recordings(rng)
    data = [step_data(processed(r)) for r in creep]
    sets = {m: optimise(m, data, Geometry.of("creep"), rng) for m in MODELS}
    sets["gkm2"] = optimise("gkm", data, Geometry.of("creep"), rng, absolute=True)
    s = Sensing()
    laws = {
        "smooth": learn(sums_of(creep, s.delay_s, s.sigma_m, TIMES_S)),
        "smooth, slow": learn(sums_of(creep, s.delay_s, s.sigma_m, SLOW_TIMES_S, SKIP_S)),
    }
    task.report("nine signals", 1, of)
    waves = wave_recordings(rng)
    answers = [_answers(w, sets, laws) for w in waves]
    mended = [_answers(w, sets, laws, delay=True) for w in waves]
    task.report("bands", 2, of)
    bands = [_band(w, laws["smooth, slow"], rng) for w in waves]
    table = {
        k: np.array([r_squared(w.displacement_m, a[k]) for w, a in zip(waves, answers, strict=True)])
        for k in answers[0]
    }
    after = {
        k: np.array([r_squared(w.displacement_m, a[k]) for w, a in zip(waves, mended, strict=True)]) for k in mended[0]
    }
    verdicts = []
    for i, (seed, effects) in enumerate(((task.seed, True), (task.seed + 1, True), (task.seed, False))):
        task.report("diagnosing the bench's recordings", 3 + i, of)
        campaign = bench_campaign(seed, effects=effects)
        verdicts.append(diagnose(campaign, "hooke+gm3", task.seed, DiagnosisSettings(workers=task.workers)).summary)
    task.report("drawing", 6, of)
    entries = (
        *r2_entries(waves, table, after, bands),
        *claims(waves, table, answers),
        *suspicion(waves, table, after),
        *diagnosis_entries(verdicts),
    )
    pictures: dict[str, Any] = {
        FIGURES[m].lower().replace(" ", "_"): draw(m, waves, answers, table, bands)
        for m in ("gm", "gkv", "gkm", "stsp")
    }
    pictures["waves_repaired"] = draw_repaired(waves, answers, mended, bands)
    pictures["waves_r2"] = {
        "signals": [w.name for w in waves],
        "before": {k: listed(v) for k, v in table.items()},
        "after": {k: listed(v) for k, v in after.items()},
    }
    pictures["waves_diagnosis"] = draw_diagnosis(verdicts[0])
    warnings = tuple(
        f"bench campaign {i + 1} of 2: {v['statement']}"
        for i, v in enumerate(verdicts[:2])
        if v["verdict"] != TRUE_VERDICT
    )
    task.report("validation", of, of)
    return Section(
        "validation",
        "Validation with nine signals",
        paragraphs(waves, table, after, answers, verdicts, sets["gm"]),
        entries,
        pictures,
        warnings,
        time.perf_counter() - began,
    )


def _answers(
    w: WaveRecording, sets: dict[str, Optimised], laws: dict[str, SmoothLaw], delay: bool = False
) -> dict[str, Array]:
    """Displacement (n,) of every model; with `delay`, 40 Hz before it and 20 ms after it."""
    g, s = Geometry.of(_ACTUATOR), Sensing()
    V = low_pass(w.time_s, w.command_V, s.corner_Hz) if delay else w.command_V
    out: dict[str, Array] = {}
    for m, o in sets.items():
        out[f"{m} avg"] = fixed_answer(o.model, o.averaged, w.time_s, V, g)
        out[f"{m} look-up"] = lookup_answer(o.model, o.voltage_V, o.individual, w.time_s, V, g)
    out["stsp look-up"] = state_space_answer(w.time_s, V, _ACTUATOR)
    for name, law in laws.items():
        out[name] = law.displacement(w.time_s, V, area_share=_area_share())
    rows = round(s.delay_s / float(w.time_s[1] - w.time_s[0])) if delay else 0
    return {k: delayed(y, rows) for k, y in out.items()}


def _area_share() -> float:
    p = printed()
    return float(p.passive_stress(1.0, _ACTUATOR) / p.passive_stress(1.0, "creep"))


def _band(w: WaveRecording, law: SmoothLaw, rng: np.random.Generator) -> dict[str, Any]:
    """5 and 95 % of the smooth posterior with delay and low-pass, and the sd of its R^2."""
    s = Sensing()
    V = low_pass(w.time_s, w.command_V, s.corner_Hz)
    rows = round(s.delay_s / float(w.time_s[1] - w.time_s[0]))
    # compliances on a grid of voltages, and from there to the rows of the command
    grid = np.arange(100.0, 1201.0, 10.0)
    c = law.at(grid, _DRAWS, rng)
    y = np.empty((_DRAWS, w.time_s.size))
    for i in range(_DRAWS):
        at_rows = np.array([np.interp(np.clip(np.abs(V), 100.0, 1200.0), grid, row) for row in c[i]])
        y[i] = delayed(law.displacement(w.time_s, V, at_rows, _area_share()), rows)
    low, high = np.quantile(y, [0.05, 0.95], axis=0)
    return {"low": low, "high": high, "sd": float(np.std([r_squared(w.displacement_m, row) for row in y]))}

"""Creep: Figures 8 and 9, Tables SVII and SVIII."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..creep_entries import SHOWN, fast_mode, figure_eight, figure_nine, table_eight, table_seven
from ..creep_fits import (
    KelvinFit,
    fit_direct,
    fit_kelvin,
    fit_process,
    kelvin_posterior,
)
from ..creep_pictures import draw_eight, draw_gains, draw_nine, draw_table
from ..creep_words import paragraphs
from ..printed import printed
from ..reconstruct import (
    CreepRecording,
    creep_recordings,
    processed,
)
from ..section import Section, Task

Array = NDArray[np.float64]


def run(task: Task) -> Section:
    """Creep redone on recordings put together from Tables SVII and SVIII."""
    began = time.perf_counter()
    p, rng = printed(), task.generator("creep")
    recordings = creep_recordings(rng)
    of = len(recordings) + 2
    fits: dict[int, dict[str, Any]] = {}
    for i, r in enumerate(recordings):
        task.report(f"creep at {r.voltage_V} V", i, of)
        fits[r.voltage_V] = _fit_all(r)
    task.report("creep without a fast mode", of - 2, of)
    late = _late_rows(rng)
    task.report("Table SVIII back from its own recordings", of - 1, of)
    returned = {r.voltage_V: fit_process(r) for r in creep_recordings(rng, source="state_space", voltages=SHOWN)}
    entries = (
        *table_seven(p, fits),
        *figure_eight(fits),
        *fast_mode(p, late),
        *table_eight(p, fits, returned),
        *figure_nine(fits),
    )
    data = {
        "figure_8": draw_eight(recordings, fits, rng),
        "table_SVII": draw_table(p, fits),
        "figure_9": draw_nine(recordings, fits),
        "table_SVIII": draw_gains(p, fits),
    }
    task.report("creep", of, of)
    return Section(
        "creep",
        "Creep: generalised Kelvin-Voigt and state space",
        paragraphs(p, fits, late, returned),
        entries,
        data,
        (),
        time.perf_counter() - began,
    )


def _fit_all(r: CreepRecording) -> dict[str, Any]:
    filtered, raw = processed(r), processed(r, filtered=False)
    return {
        "two": fit_kelvin(filtered, 2),
        "three": fit_kelvin(filtered, 3),
        "post2": kelvin_posterior(raw, 2),
        "post3": kelvin_posterior(raw, 3),
        "process": fit_process(r),
        "direct": fit_direct(r),
    }


def _late_rows(rng: np.random.Generator) -> dict[int, KelvinFit]:
    """Eq. (10) fitted to recordings without any fast mode in which three rows of the delay were left."""
    recordings = creep_recordings(rng, common_shape=True, voltages=SHOWN)
    return {r.voltage_V: fit_kelvin(processed(r, filtered=False, leftover=3), 3) for r in recordings}

"""The biggest effect that the paper leaves out: displacement does not go as V^2."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...campaign import Campaign, campaign_from_recordings, recording_from_arrays
from ...experiments.limits import limits_of_actuator
from ...mismatch.ask import next_experiment
from ...mismatch.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from ..creep_law_entries import BIAS_V, RIVALS, SWING_V, law_entries, rival_entries, verdict_entries
from ..creep_law_pictures import draw_law, draw_rivals, draw_verdict
from ..creep_law_words import paragraphs
from ..creep_laws import LAWS, swing, weigh
from ..printed import printed
from ..reconstruct import Sensing, creep_recordings
from ..section import Section, Task

Array = NDArray[np.float64]
_VALIDATE_V = (300, 700, 1000)
_RATE_HZ = 20.0


def run(task: Task) -> Section:
    """The law of the printed rows, the tool's verdict on their recordings, the rivals, and what would decide."""
    began = time.perf_counter()
    p, rng = printed(), task.generator("left_out")
    task.report("diagnosing the creep recordings", 0, 4)
    rows = _diagnose(task, rng, common=False)
    task.report("diagnosing them with one time shape", 1, 4)
    common = _diagnose(task, rng, common=True)
    task.report("weighing static laws", 2, 4)
    laws = sorted((weigh(law, feedback) for law in LAWS for feedback in (False, True)), key=lambda w: -w.log_evidence)
    probability = np.exp([w.log_evidence - laws[0].log_evidence for w in laws])
    probability /= probability.sum()
    swings = {w.name: swing(w, BIAS_V, SWING_V, rng) for w in laws}
    task.report("asking for the next experiment", 3, 4)
    ask = _ask(common)
    entries = (*law_entries(p), *rival_entries(laws, probability, swings), *verdict_entries(rows, common))
    data = {
        "voltage_law": draw_law(p, laws),
        "voltage_law_rivals": draw_rivals(laws, probability, swings),
        "voltage_law_verdict": draw_verdict(rows, common),
    }
    task.report("left out", 4, 4)
    return Section(
        "left_out",
        "The biggest left-out effect: displacement does not go as V^2",
        paragraphs(p, rows, common, laws, probability, swings, ask),
        entries,
        data,
        (),
        time.perf_counter() - began,
    )


def creep_campaign(rng: np.random.Generator, common: bool) -> Campaign:
    """The twelve creep recordings at 20 Hz, delay removed; 300, 700 and 1000 V are kept to validate."""
    p = printed()
    actuator = replace(p.actuator("creep"), max_voltage_V=1200.0)
    made = [
        recording_from_arrays(
            f"creep_{r.voltage_V:04d}V",
            "creep",
            {"time_s": r.time_s, "voltage_V": r.command_V, "displacement_m": r.displacement_m},
            "validate" if r.voltage_V in _VALIDATE_V else "identify",
            actuator,
            zeroed=True,
        )
        for r in creep_recordings(rng, _RATE_HZ, replace(Sensing(), delay_s=0.0), common_shape=common)
    ]
    return campaign_from_recordings(made, {"displacement": p.sensor("displacement")}, name="creep of the paper")


def _diagnose(task: Task, rng: np.random.Generator, common: bool) -> Diagnosis:
    return diagnose(creep_campaign(rng, common), "hooke+gm3", task.seed, DiagnosisSettings(workers=task.workers))


def _ask(d: Diagnosis) -> dict[str, Any]:
    """What the tool would do to split the two mechanical explanations."""
    fits = [d.naming.weighed[n].fit for n in RIVALS if n in d.naming.weighed]
    if len(fits) < len(RIVALS):
        return {}
    actuator = replace(printed().actuator("creep"), max_voltage_V=1200.0)
    return next_experiment(fits, list(RIVALS), limits_of_actuator(actuator, True))

"""`export_state_space`: the calibrated model as files for control engineers."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..campaign.vocabulary import did_you_mean
from ..errors import InputError
from ..prediction.calibrated import Calibrated, open_calibration
from ..results import write_json
from .files import FORMATS, WRITERS
from .state_space import DISCRETE
from .systems import systems

if TYPE_CHECKING:
    from ..calibration import Calibration

SUMMARY_FILE = "model.json"
DRAWS = 100


def export_state_space(
    calibration: Path | str | Calibration | Calibrated,
    to: str,
    out: Path | str,
    *,
    sample_time_s: float | None = None,
    draws: int | None = None,
    hold: str | None = None,
    specimen: str | None = None,
    at_voltage_V: float | None = None,
) -> Path:
    """Write the calibrated model as state space and return the file's path.

    to: "matlab" (model.mat), "control" (model.npz, see `load_state_space`) or "csv" (model.csv); model.json beside it
    says what it is. MAP, mean of the parameters and `draws` posterior draws (by default 100, or as many as there are);
    continuous, and discrete with sample_time_s (by default that of the fitted recordings). The input is u = V^2; with
    at_voltage_V it is the change of V around that voltage, which also serves laws that are not linear. hold:
    convention of the discrete system, "end", "start" or "zoh" (see `state_space`), by default the campaign's. Raises
    InputError for anything of this that cannot be.
    """
    began = time.perf_counter()
    if to not in FORMATS:
        raise InputError(f"--to {to}: is not known. {did_you_mean(to, FORMATS)}")
    c = open_calibration(calibration)
    name = c.specimen(specimen)
    notes = []
    count = min(DRAWS, len(c.draws)) if draws is None else draws
    if count < 0:
        raise InputError(f"--draws {draws}: must not be negative")
    if sample_time_s is None:
        steps = [r["seen"]["step_s"] for r in c.recordings(name, "displacement") if r.get("seen")]
        if not steps:
            raise InputError("no voltage recording was fitted that would tell the sample time; say it: --sample-time S")
        sample_time_s = float(f"{min(steps):.9g}")
    if not (math.isfinite(sample_time_s) and sample_time_s > 0):
        raise InputError(f"--sample-time {sample_time_s:g}: must be a positive number of seconds")
    if at_voltage_V is not None and not (math.isfinite(at_voltage_V) and at_voltage_V > 0):
        raise InputError(
            f"--at-voltage {at_voltage_V:g}: must be a positive voltage; at 0 V the actuator does not answer to first "
            "order, because it answers to V^2"
        )
    limit = c.actuator(name).max_voltage_V
    if at_voltage_V is not None and limit is not None and at_voltage_V > limit:
        raise InputError(f"--at-voltage {at_voltage_V:g}: lies beyond max_voltage_V = {limit:g}")
    if hold is None:
        hold = str(c.summary.get("conventions", {}).get("hold", "end"))
        if hold == "linear":
            hold = "end"
            notes.append(
                "The campaign's hold is linear, for which no discrete system in V^2 is exact; it was discretised with "
                "hold = end."
            )
    if hold not in DISCRETE:
        raise InputError(f"--hold {hold}: is not known. {did_you_mean(hold, DISCRETE)}")
    if not c.converged:
        notes.append("The calibration's sampler had not converged: mean and draws are provisional.")
    if not c.recordings(name, "displacement"):
        notes.append("No voltage recording was fitted: the stroke is an extrapolation from mechanical recordings.")
    found = systems(c, sample_time_s, count, hold, name, at_voltage_V)
    notes.extend(found.warnings)
    folder = Path(out)
    path = folder / FORMATS[to]
    WRITERS[to](path, found)
    summary: dict[str, Any] = {
        "file": path.name,
        **found.about,
        "draws": len(found.draws),
        "states": int(found.map.A.shape[0]),
        "calibration": c.where,
        "seconds": time.perf_counter() - began,
        "seconds_by": {"export": time.perf_counter() - began},
        "seed": c.summary.get("seed"),
        "version": __version__,
        "inputs": [dict(i) for i in c.inputs],
        "warnings": notes,
    }
    write_json(folder / SUMMARY_FILE, summary)
    return path

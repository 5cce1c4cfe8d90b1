"""`command_for`: the command whose predicted stroke follows a wanted one, within the limits of the actuator."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .answer import DRAWS, Report, answer, as_recording, effects_of_the_sensor, read_both
from .calibrated import Calibrated
from .find_command import as_commanded, find_command, mean_stroke
from .inverse import ABOVE, FAST, MET, NEGATIVE, Limits
from .limits import check_units, seen_by
from .result import SignalPrediction, Unmet
from .rounds import LEFT
from .signal import Signal, read_signal

if TYPE_CHECKING:
    from ..calibration import Calibration

#: intervals that prediction.json lists one by one
LISTED = 200
#: effects behind which the stroke does not follow the end of a straight command at once
_LATE = {"series_resistance", "leakage", "supply_current_limit", "one_quadrant_supply", "parallel_damper", "inertia"}
WHY = {
    MET: "a command that meets it would shake from row to row; the smoothest one that comes near was taken",
    ABOVE: "it would need more than the largest voltage",
    NEGATIVE: "the actuator would have to be pulled back: at 0 V it returns by itself, no faster",
    FAST: "it would need a faster change than the highest frequency allows",
    LEFT: "the command was corrected by the whole simulation round by round, and came no nearer",
}

Array = NDArray[np.float64]


def command_for(
    calibration: Path | str | Calibration | Calibrated,
    wanted: Path | str | Mapping[str, ArrayLike],
    *,
    draws: int | None = None,
    seed: int = 1,
    specimen: str | None = None,
    hold: str | None = None,
    zeroed: bool = False,
    data_root: Path | str | None = None,
    workers: int = 1,
    report: Report | None = None,
) -> SignalPrediction:
    """The command for a wanted stroke: 0 <= V <= max_voltage_V, no faster than max_frequency_Hz; and its prediction.

    wanted: a file or arrays (n,), time_s and displacement_m, from rest. The posterior mean of the predicted stroke
    follows it to below a nanometre wherever that is possible; `unmet` of the result names the intervals where it is
    not, with the reason. The command is `time_s` and `values` (V) of the result, command.csv when it is saved. With a
    black box (pz3, ss3), whose exact inverse would shake from row to row, it is the smoothest command that meets the
    stroke to the resolution of the sensor. With effects it is met to that resolution as well; the stroke is that of the
    actuator, and effects of the sensor, which act on the reading alone, are not made up for: a warning says by how
    much they change it. Other arguments and errors as for `predict`.
    """
    began = time.perf_counter()
    say = report or (lambda *_: None)
    c, wish = read_both(
        calibration, wanted, lambda: read_signal(wanted, ("displacement_m",), "--wanted", data_root), report
    )
    name = c.specimen(specimen)
    actuator = c.actuator(name)
    seen = seen_by(c.recordings(name, "displacement"))
    check_units(wish, actuator, seen)
    limits, notes = limits_of(c, name, seen)
    notes = [*c.taken(specimen), *notes]
    rows = c.rows(DRAWS if draws is None else draws, draws is None)
    flat = Signal("command", "voltage_V", wish.time_s, np.zeros(wish.values.size))
    recording = as_recording(c, flat, name, hold)
    if recording.hold == "linear" and _has_no_jump(c):
        raise InputError(
            f"{c.structure.model.name} with hold = 'linear' cannot be inverted row by row (it would ring): take hold = "
            "'end' for the command"
        )
    say("inverting", 0, 1, wish.label)

    def tell(done: float, of: float) -> None:
        say("inverting", done, of, wish.label)

    found, tolerance = find_command(c, recording, wish.values, rows, limits, workers, tell)
    command = replace(
        flat,
        label=f"command for {wish.label}",
        values=as_commanded(found.voltage, recording.hold),
        inputs=wish.inputs,
        warnings=(*wish.warnings, *notes),
    )
    inverted = time.perf_counter()
    given = answer(c, command, draws, seed, name, hold, zeroed, workers, report, inverted)
    mean, summary = given.mean, given.summary
    sensed = effects_of_the_sensor(c.structure.model)
    if sensed:
        mean = mean_stroke(c, as_recording(c, command, name, hold), rows, workers, lambda share: None)
        away = 1e6 * float(np.max(np.abs(given.mean - mean)))
        note = (
            f"{', '.join(sensed)}: acts on the reading alone. The command makes the stroke of the actuator follow "
            "the wish; what the sensor will show, which is predicted here, differs from that stroke by up to "
            f"{away:.3g} um."
        )
        summary = {**summary, "warnings": [*summary["warnings"], note]}
    unmet = intervals(wish.time_s, mean - wish.values, found.flag, tolerance)
    summary = _summary(summary, wish, mean, unmet, limits, tolerance, inverted - began)
    return replace(given, summary=summary, wanted=wish.values, unmet=unmet)


def limits_of(c: Calibrated, specimen: str, seen: Mapping[str, float]) -> tuple[Limits, list[str]]:
    """Limits of a command, and warnings about those that the campaign does not state."""
    actuator, notes = c.actuator(specimen), []
    top = actuator.max_voltage_V
    if top is None:
        top = seen.get("largest_voltage_V")
        if not top:
            raise InputError(
                f"{c.where}: no max_voltage_V is stated and no recording above 0 V was fitted: write max_voltage_V "
                "under [actuator] in campaign.toml and calibrate again"
            )
        notes.append(
            f"The campaign states no max_voltage_V: the command stays below {top:g} V, the highest voltage that the "
            "calibration has seen."
        )
    if actuator.max_frequency_Hz is None:
        notes.append("The campaign states no max_frequency_Hz: the command may jump and turn at every row.")
    return Limits(float(top), float(actuator.max_frequency_Hz or 0.0)), notes


def _has_no_jump(c: Calibrated) -> bool:
    spec = c.structure.model.spec
    return spec.network in ("gkm", "pz3", "ss3") or not _LATE.isdisjoint(spec.effects)


def intervals(time_s: Array, miss: Array, flag: NDArray[np.int8], tolerance: float) -> tuple[Unmet, ...]:
    """Runs of rows that miss the wish by more than `tolerance` (m) for one and the same reason."""
    code = np.where(np.abs(miss) > tolerance, flag, -1)
    edges = np.flatnonzero(np.diff(code)) + 1
    bounds = np.concatenate([[0], edges, [code.size]])
    return tuple(
        Unmet(float(time_s[a]), float(time_s[b - 1]), WHY[int(code[a])], float(np.max(np.abs(miss[a:b]))))
        for a, b in pairwise(bounds)
        if code[a] >= 0
    )


def _summary(
    summary: dict[str, Any],
    wish: Signal,
    mean: Array,
    unmet: tuple[Unmet, ...],
    limits: Limits,
    tolerance: float,
    seconds: float,
) -> dict[str, Any]:
    step = float(np.median(np.diff(wish.time_s)))
    by: dict[str, dict[str, float]] = {}
    for u in unmet:
        entry = by.setdefault(u.why, {"intervals": 0, "seconds": 0.0, "largest_miss_m": 0.0})
        entry["intervals"] += 1
        entry["seconds"] += u.t_end_s - u.t_start_s + step
        entry["largest_miss_m"] = max(entry["largest_miss_m"], u.miss_m)
    notes = list(summary["warnings"])
    for why, entry in by.items():
        first = next(u for u in unmet if u.why == why)
        times = f"{entry['intervals']:.0f} interval" + ("s" if entry["intervals"] > 1 else "")
        notes.append(
            f"{wish.label}: the wanted stroke is not met in {times} ({entry['seconds']:.4g} s, first at "
            f"{first.t_start_s:g} s, by up to {1e6 * entry['largest_miss_m']:.3g} um): {why}."
        )
    return {
        **summary,
        "wanted": {
            "file": wish.label,
            "limits": {"voltage_V": limits.voltage_V, "frequency_Hz": limits.frequency_Hz or None},
            "rms_miss_m": float(np.sqrt(np.mean((mean - wish.values) ** 2))),
            "largest_miss_m": float(np.max(np.abs(mean - wish.values))),
            "met_to_m": tolerance,
            "unmet_count": len(unmet),
            "unmet_by": by,
            "unmet": [vars(u) for u in unmet[:LISTED]],
        },
        "seconds": summary["seconds"] + seconds,
        "seconds_by": {"invert": seconds, **summary["seconds_by"]},
        "warnings": notes,
    }

"""`command_for`: the command whose predicted stroke follows a wanted one, within the limits of the actuator."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..forward import row_durations
from ..models.chain import materials
from ..models.electrostatics import stress_factor, stroke_factor, voltage_drive
from ..models.lags import simulate_modes
from .answer import DRAWS, Report, answer, as_recording, read_both, simulators_for
from .bands import CHUNK, stretch
from .calibrated import Calibrated
from .follow import follow
from .inverse import ABOVE, FAST, MET, NEGATIVE, Inverted, Limits, invert_linear, invert_material
from .limits import check_units, seen_by
from .result import SignalPrediction, Unmet
from .signal import Signal, read_signal

if TYPE_CHECKING:
    from ..calibration import Calibration

#: a stroke is met when it is predicted to this accuracy
MET_TO_M = 1e-9
#: share of the rows that a command may miss more than another when it does not shake
_WORTH_SMOOTHNESS = 0.01
#: share of the largest voltage by which a command that shakes goes up and down
_SHAKING = 1e-3
#: intervals that prediction.json lists one by one
LISTED = 200
#: rounds in which the mean of the draws is brought onto the wish, for laws where it is not the answer of one of them
_ROUNDS = 4
WHY = {
    MET: "a command that meets it would shake from row to row; the smoothest one that comes near was taken",
    ABOVE: "it would need more than the largest voltage",
    NEGATIVE: "the actuator would have to be pulled back: at 0 V it returns by itself, no faster",
    FAST: "it would need a faster change than the highest frequency allows",
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
    data_root: Path | str | None = None,
    workers: int = 1,
    report: Report | None = None,
) -> SignalPrediction:
    """The command for a wanted stroke: 0 <= V <= max_voltage_V, no faster than max_frequency_Hz; and its prediction.

    wanted: a file or arrays (n,), time_s and displacement_m, from rest. The posterior mean of the predicted stroke
    follows it to below a nanometre wherever that is possible; `unmet` of the result names the intervals where it is
    not, with the reason. The command is `time_s` and `values` (V) of the result, command.csv when it is saved. With a
    black box (pz3, ss3), whose exact inverse would shake from row to row, it is the smoothest command that meets the
    stroke to the resolution of the sensor. Other arguments and errors as for `predict`.
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

    found = _invert(c, recording, wish.values, rows, limits, workers, tell)
    command = replace(
        flat,
        label=f"command for {wish.label}",
        values=_as_commanded(found.voltage, recording.hold),
        inputs=wish.inputs,
        warnings=(*wish.warnings, *notes),
    )
    inverted = time.perf_counter()
    given = answer(c, command, draws, seed, name, hold, workers, report, inverted)
    black_box = c.structure.model.is_black_box
    tolerance = resolution_of(c) if black_box else MET_TO_M
    unmet = intervals(wish.time_s, given.mean - wish.values, found.flag, tolerance)
    summary = _summary(given.summary, wish, given.mean, unmet, limits, inverted - began)
    return replace(given, summary=summary, wanted=wish.values, unmet=unmet)


def shaking(voltage: Array, top: float) -> NDArray[np.bool_]:
    """Rows (n,) in which a command goes up and down from row to row by more than a thousandth of `top` (V)."""
    # an eighth of the third difference is the part that changes its sign with every row; a corner has it for one row
    part = np.diff(voltage, 3) / 8.0
    alternates = (part[1:] * part[:-1] < 0.0) & (np.minimum(np.abs(part[1:]), np.abs(part[:-1])) > _SHAKING * top)
    out = np.zeros(voltage.size, bool)
    for begin in range(5):
        out[begin : begin + alternates.size] |= alternates
    return out


def resolution_of(c: Calibrated) -> float:
    """Resolution (m) of the displacement sensor: a black box is to follow a wish to it; 0.1 um where none is stated."""
    return float(c.summary.get("sensors", {}).get("displacement", {}).get("resolution") or 1e-7)


def limits_of(c: Calibrated, specimen: str, seen: Mapping[str, float]) -> tuple[Limits, list[str]]:
    """Limits of a command, and warnings about those that the campaign does not state."""
    actuator, notes = c.actuator(specimen), []
    top = actuator.max_voltage_V
    if top is None:
        top = seen.get("largest_voltage_V")
        if not top:
            raise InputError(
                f"{c.where}: no max_voltage_V is stated and no recording above 0 V was fitted: write max_voltage_V under "
                "[actuator] in campaign.toml and calibrate again"
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
    return spec.network in ("gkm", "pz3", "ss3")


def _as_commanded(in_force: Array, hold: str) -> Array:
    """Voltages in force at the rows to those of a command file: with hold = start a row is in force from then on."""
    return np.append(in_force[1:], in_force[-1]) if hold == "start" else in_force


def _invert(
    c: Calibrated,
    recording: Any,
    wish_m: Array,
    rows: NDArray[np.int64],
    limits: Limits,
    workers: int,
    tell: Callable[[float, float], None],
) -> Inverted:
    """The command for a wish (n,) m; tell: called with (done, of) where it takes several rounds, `of` the most."""
    model = c.structure.model
    stroke, factor = stroke_factor(recording.actuator), stress_factor(recording.actuator)
    held = replace(recording, hold="linear" if recording.hold == "linear" else "end")
    drive = voltage_drive(held)
    wish = wish_m / stroke
    if recording.hold == "start":
        wish = np.concatenate([[0.0], wish[1:]])  # nothing was in force before the first row
    time_s = recording.time_s
    z = c.coordinates(recording.specimen, rows)
    if model.is_linear:
        # the mean of all draws is itself a linear network, that of all their lags
        D, modes, T = model.modes(z)
        network = float(D.mean()), np.ascontiguousarray((modes / len(D)).ravel()), np.ascontiguousarray(T.ravel())
        if not model.is_black_box:
            return invert_linear(time_s, drive, factor, network, wish, limits)
        _, middle, T_middle = model.modes(z.mean(axis=0)[None])
        smooth = follow(
            time_s, drive, factor, network[1:], (middle[0], T_middle[0]), wish, limits, resolution_of(c) / stroke, tell
        )
        fastest = T.min(axis=1, keepdims=True)
        slow = np.argsort(T, axis=1)[:, 1:]
        c_slow = np.take_along_axis(modes * (1 - fastest / T), slow, 1) / len(D)
        T_slow = np.take_along_axis(T, slow, 1)
        behind = (np.ascontiguousarray(c_slow.ravel()), np.ascontiguousarray(T_slow.ravel()), float(fastest.mean()))
        stepwise = invert_linear(time_s, drive, factor, network, wish, limits, behind)

        def bad(found: Inverted) -> float:
            drive_of = replace(drive, stress=factor * found.voltage**2, middle=factor * found.voltage**2)
            there, _ = simulate_modes(drive_of, *network)
            missed = np.abs(there - wish) * stroke > resolution_of(c)
            return float(np.mean(missed | shaking(found.voltage, limits.voltage_V)))

        # a wish that is out of reach for long is better followed from row to row: what cannot be met is then given up
        # where it comes, and not prepared for; a row that is met by shaking is worth no more than one that is missed
        return smooth if bad(smooth) <= bad(stepwise) + _WORTH_SMOOTHNESS else stepwise
    material = materials(model, c.coordinates(recording.specimen))
    h = row_durations(drive)
    goal = wish.copy()
    for number in range(_ROUNDS):
        found = invert_material(time_s, drive, h, factor, material, goal, limits)
        columns = {**recording.columns, "voltage_V": _as_commanded(found.voltage, recording.hold)}
        commanded = replace(recording, columns=columns)

        def share(done: float, before: int = number) -> None:
            tell(before + done, _ROUNDS)  # nearly all the time goes into the mean

        mean = _mean(c, commanded, rows, workers, share) / stroke
        miss = np.where(found.flag == MET, wish - mean, 0.0)
        if np.max(np.abs(miss)) * stroke < 0.2 * MET_TO_M:
            break
        # a wish for what no voltage does would pile up
        goal = np.where(found.flag == MET, goal + miss, wish)
    return found


def _mean(
    c: Calibrated, recording: Any, rows: NDArray[np.int64], workers: int, tell: Callable[[float], None]
) -> Array:
    """Mean (n,) of the draws' answers; tell: called with the share that is done."""
    from concurrent.futures import ThreadPoolExecutor

    simulators = simulators_for(c, recording, rows, workers)
    n, out = recording.time_s.size, np.empty(recording.time_s.size)
    with ThreadPoolExecutor(len(simulators)) as pool:
        for start in range(0, n, CHUNK):
            stop = min(start + CHUNK, n)
            out[start:stop] = stretch(simulators, start, stop, pool).mean(axis=1)
            tell(stop / n)
    return out


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
    summary: dict[str, Any], wish: Signal, mean: Array, unmet: tuple[Unmet, ...], limits: Limits, seconds: float
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
            "unmet_count": len(unmet),
            "unmet_by": by,
            "unmet": [vars(u) for u in unmet[:LISTED]],
        },
        "seconds": summary["seconds"] + seconds,
        "seconds_by": {"invert": seconds, **summary["seconds_by"]},
        "warnings": notes,
    }

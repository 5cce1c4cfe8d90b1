"""`predict`: the calibrated model's answer to any command, with bands."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import __version__
from ..campaign.schema import HOLDS, Recording
from ..campaign.settings import choice
from ..errors import InputError
from ..models.effects import registered_effects
from ..models.model import Model
from ..store import CALIBRATION_FILE, POSTERIOR_FILE
from .bands import LEVELS, bands
from .calibrated import Calibrated, open_calibration
from .limits import check_units, seen_by, warnings_of
from .reading import reading_of
from .result import SignalPrediction
from .signal import Signal, read_signal
from .simulators import Simulator, simulator

if TYPE_CHECKING:
    from ..calibration import Calibration

#: called with (phase, done, of, text)
Report = Callable[[str, float, float, str], None]
#: draws that make bands smooth enough to read; the 5 % quantile then wobbles by a tenth of an sd
DRAWS = 200
CHANNELS = {"voltage_V": ("displacement", "m"), "position_m": ("force", "N")}


def predict(
    calibration: Path | str | Calibration | Calibrated,
    signal: Path | str | Mapping[str, ArrayLike],
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
    """The calibrated model's answer to a command, from rest, with bands at every row.

    calibration: the --out folder of a calibration, or what `calibrate` returned. signal: a file, or arrays (n,) by
    name: time_s with voltage_V (the answer is the displacement in m) or with position_m (the force in N; contact at
    the first position). hold: what the command does between rows (CONTRACT 1), by default as in the campaign. zeroed:
    whether the sensor will be zeroed just before, which narrows the band of readings. draws: posterior draws, spread
    evenly; by default 200, or as many as there are. Raises InputError for a folder that is no calibration, a signal
    that cannot be read, geometry that is missing, or more draws than there are.
    """
    began = time.perf_counter()
    c, given = read_both(calibration, signal, lambda: read_signal(signal, data_root=data_root), report)
    return answer(c, given, draws, seed, specimen, hold, zeroed, workers, report, began)


def read_both(
    calibration: Path | str | Calibration | Calibrated,
    given: Path | str | Mapping[str, ArrayLike],
    read: Callable[[], Signal],
    report: Report | None,
) -> tuple[Calibrated, Signal]:
    """The calibration, and what `read` makes of `given`; how far it is goes by the bytes of their files."""
    say = report or (lambda *_: None)
    first = sum(_bytes(calibration, name) for name in (CALIBRATION_FILE, POSTERIOR_FILE))
    second = _bytes(given)
    say("reading", 0, 1, str(calibration))
    c = open_calibration(calibration)
    say("reading", first, max(first + second, 1), str(given) if second else "")
    return c, read()


def _bytes(given: object, name: str = "") -> int:
    """Size of a file, or of the one of that name in a folder; 0 for what is in memory or cannot be found."""
    path = Path(given, name) if isinstance(given, (str, Path)) else None
    return path.stat().st_size if path is not None and path.is_file() else 0


def as_recording(c: Calibrated, given: Signal, specimen: str, hold: str | None) -> Recording:
    """The signal as a recording of which nothing was observed yet."""
    used = hold or str(c.summary.get("conventions", {}).get("hold", "end"))
    kind = "voltage" if given.column == "voltage_V" else "compression"
    columns = MappingProxyType({"time_s": given.time_s, given.column: given.values})
    return Recording(
        given.label, Path(given.label), kind, "validate", columns, c.actuator(specimen), specimen,
        choice(used, HOLDS, "hold"),
    )  # fmt: skip


def simulators_for(
    c: Calibrated, recording: Recording, rows: NDArray[np.int64], workers: int, *, sensor: bool = True
) -> list[Simulator]:
    """Simulators of these draws, in parts for `workers` threads; see `simulator`."""
    z = c.coordinates(recording.specimen, rows)
    parts = np.array_split(z, max(1, min(workers, len(z))))
    return [simulator(c.structure.model, part, recording, sensor=sensor) for part in parts]


def answer(
    c: Calibrated,
    given: Signal,
    draws: int | None,
    seed: int,
    specimen: str | None,
    hold: str | None,
    zeroed: bool,
    workers: int,
    report: Report | None,
    began: float,
) -> SignalPrediction:
    """See `predict`; the signal has been read."""
    say = report or (lambda *_: None)
    name = c.specimen(specimen)
    channel, unit = CHANNELS[given.column]
    model = c.structure.model
    if model.is_black_box and channel == "force":
        raise InputError(f"{given.label}: {model.name} is a black box from voltage to displacement; it knows no force")
    chosen = c.rows(DRAWS if draws is None else draws, draws is None)
    recording = as_recording(c, given, name, hold)
    seen = seen_by(c.recordings(name, channel))
    check_units(given, recording.actuator, seen)
    notes = [*given.warnings, *c.taken(specimen), *warnings_of(given, recording.actuator, seen, c.where)]
    if "thermal_expansion" in model.spec.effects and channel == "displacement":
        notes.append("A command holds no temperature: what thermal_expansion does is left out, as at a steady one.")
    if not c.converged:
        notes.append("The calibration's sampler had not converged: the bands are provisional.")
    rng = np.random.default_rng(seed)
    reading, about = reading_of(c, name, channel, unit, chosen, zeroed, notes)
    prepared = time.perf_counter()
    n = given.values.size
    found = bands(
        simulators_for(c, recording, chosen, workers),
        n,
        reading,
        rng,
        lambda done, of: say("predicting", done, of, f"{given.label}, {len(chosen)} draws"),
    )
    if not np.isfinite(found.mean).all():
        at = int(np.argmin(np.isfinite(found.mean)))
        bad = np.isfinite([row[at] for row in found.parameters])
        raise InputError(
            f"{given.label}, row {at + 1}: {model.name} has no answer there for "
            f"{'some' if bad.any() else 'the'} draws; the law cannot carry that load. Lower the command"
        )
    done = time.perf_counter()
    sensed = effects_of_the_sensor(model) if channel == "displacement" else []
    shown = f", as it is shown with {', '.join(sensed)}" if sensed else ""
    summary: dict[str, Any] = {
        "model": model.name,
        "campaign": c.summary.get("campaign"),
        "calibration": c.where,
        "specimen": name,
        "signal": given.label,
        "input": given.column,
        "channel": channel,
        "unit": unit,
        "n": n,
        "duration_s": float(given.time_s[-1] - given.time_s[0]),
        "draws": len(chosen),
        "hold": recording.hold,
        "starts": "rested",
        "levels": list(LEVELS),
        "bands": {
            f"{channel}_qNN_{unit}": f"the {channel} itself{shown}: uncertainty of the parameters alone",
            f"reading_qNN_{unit}": "one reading of the sensor: parameters, its gain as calibrated, the offset of a new "
            "recording, and the noise of one sample",
        },
        "largest": _largest(given, found.mean, found.parameters),
        "sensor": about,
        "limits": {
            "max_voltage_V": recording.actuator.max_voltage_V,
            "max_frequency_Hz": recording.actuator.max_frequency_Hz,
        },
        "seen": seen,
        "origin": _origin(c.summary),
        "seconds": done - began,
        "seconds_by": {"read": prepared - began, "predict": done - prepared},
        "seed": seed,
        "version": __version__,
        "inputs": [*map(dict, c.inputs), *map(dict, given.inputs)],
        "warnings": list(dict.fromkeys(notes)),
    }
    return SignalPrediction(channel, unit, given.column, given.time_s, given.values, found, summary)


def effects_of_the_sensor(model: Model) -> list[str]:
    """Effects of a model that change the reading of a stroke and not the stroke."""
    return [name for name in model.spec.effects if registered_effects()[name].stage == "sensor"]


def _origin(summary: Mapping[str, Any]) -> str:
    meta = summary.get("meta")
    return str(meta.get("origin") or "") if isinstance(meta, Mapping) else ""


def _largest(given: Signal, mean: NDArray, parameters: NDArray) -> dict[str, float]:
    """The row with the largest answer: time, mean and quantiles of the parameters' band."""
    at = int(np.argmax(np.abs(mean)))
    quantiles = {f"q{round(100 * level):02d}": float(v) for level, v in zip(LEVELS, parameters[:, at], strict=True)}
    return {"time_s": float(given.time_s[at]), "mean": float(mean[at]), **quantiles}

"""Writes campaign.toml and the CSV files into a folder, and the truth beside the folder."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .draw import Case, draw
from .observe import Column, Observed, observe
from .protocol import FULL, ProtocolSettings
from .recordings import Recording
from .specimen import STEPS

#: what a mass or a jump of damping needs
_FINE_STEPS = 60
_ROWS_AT_ONCE = 20000


def campaign_toml(case: Case) -> str:
    """Text of campaign.toml."""
    lines = ["[actuator]"]
    for key, value in asdict(case.specimen.actuator).items():
        lines.append(f'{key} = "{value}"' if isinstance(value, str) else f"{key} = {value!r}")
    lines += ["", "[sensor.displacement]", "fluctuation_m = 4.7e-6", "accuracy_m = 19.4e-6", "resolution_m = 0.15e-6"]
    if case.presses:
        lines += ["", "[sensor.force]", "fluctuation_N = 0.02", "accuracy_N = 0.02"]
        lines += ["", "[sensor.position]", "fluctuation_m = 5e-6"]
    lines += ["", "[ambient]", "temperature_C = 21.4", "relative_humidity_pct = 30.7"]
    recordings: list[Recording] = [*case.recordings, *case.presses]
    for rec in recordings:
        lines += ["", "[[recording]]", f'file = "{rec.file}"', f'kind = "{rec.kind}"', f'role = "{rec.role}"']
    return "\n".join(lines) + "\n"


def write_csv(path: Path, columns: list[Column]) -> None:
    """Columns to a CSV file, many rows a format: four times as fast as row by row."""
    form = ",".join(c.form for c in columns) + "\n"
    table = np.stack([c.values for c in columns], 1)
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(c.name for c in columns) + "\n")
        for i in range(0, len(table), _ROWS_AT_ONCE):
            part = table[i : i + _ROWS_AT_ONCE]
            file.write((form * len(part)) % tuple(part.ravel().tolist()))


def truth_file(folder: Path) -> Path:
    """Beside the folder, so that the folder alone can be given to a blind test."""
    return folder.with_name(folder.name + ".truth.json")


def _noise_truth(case: Case, observed: list[Observed]) -> dict[str, Any]:
    out = {k: v for k, v in asdict(case.noise).items() if v is not None}
    out["offsets_m"] = {o.recording.file: o.offset for o in observed}
    if case.noise.clip_last is not None:
        outermost = "clip outermost (offset, noise, spikes inside)"
        out["clip_note"] = outermost if case.noise.clip_last else "clip before gain, offset and noise"
    return out


def write(seed: int, kind: str, folder: Path, settings: ProtocolSettings = FULL) -> dict[str, Any]:
    """Write a campaign folder, and its truth beside the folder; returns the truth."""
    folder = Path(folder)
    began = time.perf_counter()
    case = draw(seed, kind, settings)
    drawn = time.perf_counter()
    steps = _FINE_STEPS if {"inertia", "quadratic_damper"} & set(case.effects) else STEPS
    observed = observe(case, steps)
    simulated = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    for o in observed:
        write_csv(folder / o.recording.file, o.columns)
    (folder / "campaign.toml").write_text(campaign_toml(case), encoding="utf-8")
    material = case.specimen.material
    truth = {
        "truth": case.truth,
        "parameters": case.effects,
        "material": {"Y": material.Y_Pa, "k": list(material.k_Pa), "tau": list(material.tau_s)},
        "noise": _noise_truth(case, observed),
        "sizes": {name: asdict(size) for name, size in case.sizes.items()},
        "temperature_column": case.temperature_column,
        "slack_m": {r.file: r.slack_m for r in case.presses},
        "seed": case.seed,
        "kind": case.kind,
        "redrawn": case.redrawn,
        "nsub": steps,
        "seconds": {
            "draw": drawn - began,
            "simulate": simulated - drawn,
            "write": time.perf_counter() - simulated,
        },
        "rows": int(sum(r.time_s.size for r in case.recordings)),
    }
    truth_file(folder).write_text(json.dumps(truth, indent=1, default=float), encoding="utf-8")
    return truth

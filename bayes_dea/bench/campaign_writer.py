"""Writes a simulated campaign as a folder: campaign.toml, CSV files, and truth.json beside them."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import shutil
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea import __version__
from bayes_dea.bench.effects import truth_name
from bayes_dea.bench.plan import CampaignPlan, SensorSheet
from bayes_dea.bench.simulate import simulate
from bayes_dea.errors import BayesDEAError, InputError
from bayes_dea.results import PARTIAL, write_atomic, write_text

ORIGIN = "virtual bench of bayes-dea, simulated, not measured"
TRUTH = "truth.json"
_UNITS = {"displacement": "m", "force": "N", "position": "m"}


def _sensor_table(sheet: SensorSheet, unit: str) -> dict[str, float]:
    return {f"{name}_{unit}": value for name, value in asdict(sheet).items()}


def campaign_table(plan: CampaignPlan, seed: int) -> dict[str, Any]:
    """What campaign.toml says of `plan` (CONTRACT 1); nothing that only the bench could know."""
    actuator = asdict(plan.geometry)
    rows = []
    used: set[str] = set()
    for recording in plan.recordings:
        kind = recording.protocol.kind
        used |= {"force", "position"} if kind in ("compression", "relaxation") else {"displacement"}
        row: dict[str, Any] = {"file": recording.file, "kind": kind, "role": recording.role}
        if recording.specimen != "A":
            row["specimen"] = recording.specimen
        if recording.zeroed:
            row["zeroed"] = True
        own = asdict(plan.geometry_of(recording))
        differs = {name: value for name, value in own.items() if value != actuator[name]}
        if differs:
            row["actuator"] = differs
        rows.append(row)
    return {
        "actuator": actuator,
        "sensor": {channel: _sensor_table(getattr(plan.sensors, channel), unit)
                   for channel, unit in _UNITS.items() if channel in used},
        "ambient": {"temperature_C": plan.temperature_C, "relative_humidity_pct": plan.relative_humidity_pct},
        "recording": rows,
        "meta": {"origin": ORIGIN, "plan": plan.name, "seed": seed, "version": __version__},
    }


def _write_csv(path: Path, columns: dict[str, NDArray[np.float64]]) -> None:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    # pyarrow writes the shortest text that reads back as the same double: exact and compact. Its header would
    # be in quotes, which not every reader expects.
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            file.write((",".join(columns) + "\n").encode())
            pacsv.write_csv(table, file, pacsv.WriteOptions(include_header=False))

    write_atomic(path, write)


def _toml(table: dict[str, Any]) -> str:
    """The tables of `campaign_table` as text, recordings as [[recording]] with dotted actuator entries."""
    import tomli_w

    parts = [tomli_w.dumps({k: table[k] for k in ("actuator", "sensor", "ambient")})]
    for row in table["recording"]:
        plain = {k: v for k, v in row.items() if k != "actuator"}
        own = tomli_w.dumps(row.get("actuator", {})).splitlines()
        parts.append("[[recording]]\n" + tomli_w.dumps(plain) + "".join(f"actuator.{line}\n" for line in own))
    parts.append(tomli_w.dumps({"meta": table["meta"]}))
    return "\n".join(parts)


def _check_free(out: Path, plan: CampaignPlan) -> None:
    """Refuse to write over anything but an earlier campaign of the virtual bench."""
    if not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"{out}: is a file; give --out a folder")
    campaign = out / "campaign.toml"
    if campaign.exists():
        try:
            meta = tomllib.loads(campaign.read_text(encoding="utf-8")).get("meta", {})
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
            meta = {}
        if isinstance(meta, dict) and meta.get("origin") == ORIGIN:
            return
        raise InputError(f"{campaign}: is a campaign that the virtual bench did not write; "
                         "give --out another folder")
    for name in [*(r.file for r in plan.recordings), TRUTH]:
        if (out / name).exists():
            raise InputError(f"{out / name}: is already there and not from the virtual bench; "
                             "give --out another folder")


def in_no_campaign(folder: Path) -> tuple[str, ...]:
    """CSV files beside campaign.toml that it does not name, as recordings of a campaign that was there before."""
    table = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    named = {row["file"] for row in table["recording"]}
    return tuple(sorted(path.name for path in folder.glob("*.csv") if path.name not in named))


def write_folder(out: Path, plan: CampaignPlan, seed: int, table: dict[str, Any],
                 about: Callable[[list[dict[str, Any]]], dict[str, Any]] | None,
                 progress: Callable[[int, int, str], None] | None = None) -> list[dict[str, Any]]:
    """Write `plan`, carried out with `seed`, into the folder `out`; return what was true of each recording.

    `table`: what campaign.toml says. `about`: makes the content of truth.json from that list; without it the folder
    gets none. Files appear whole or not at all: everything is written to a folder inside `out` first and moved at
    the end, campaign.toml last. `progress(done, of, file)` is called after every recording. Raises InputError where
    `out` holds anything of the same names that the virtual bench did not write, or cannot be written to.
    """
    out = Path(out)
    if seed < 0:
        raise InputError(f"--seed is {seed}; give zero or a positive number")
    _check_free(out, plan)
    was_there = out.is_dir()
    try:
        out.mkdir(parents=True, exist_ok=True)
        # inside, not beside: `out` may be another file system
        work = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=out))
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        raise (BayesDEAError if full else InputError)(
            f"{out}: cannot be written to ({error.strerror}); give --out a folder that may be written") from None
    try:
        truths = []
        for done, simulated in enumerate(simulate(plan, seed), 1):
            _write_csv(work / simulated.plan.file, simulated.columns)
            truths.append(simulated.truth)
            if progress is not None:
                progress(done, len(plan.recordings), simulated.plan.file)
        if about is not None:
            write_text(work / TRUTH, json.dumps(about(truths), indent=1) + "\n")
        write_text(work / "campaign.toml", _toml(table))
        if about is None:
            (out / TRUTH).unlink(missing_ok=True)  # of the campaign that was here before
        for name in [*(r.file for r in plan.recordings), *([TRUTH] if about is not None else []), "campaign.toml"]:
            os.replace(work / name, out / name)
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if not was_there:
            with contextlib.suppress(OSError):  # stays when it holds something
                out.rmdir()
    return truths


def write_campaign(out: Path, plan: CampaignPlan, seed: int,
                   progress: Callable[[int, int, str], None] | None = None) -> Path:
    """Write `plan`, carried out with `seed`, into the folder `out`; return `out`.

    `truth.json` holds the true parameters, gains, offsets and contacts; no other part of the tool reads it. The rest
    as `write_folder`.
    """
    def about(truths: list[dict[str, Any]]) -> dict[str, Any]:
        truth = {"about": "what was true of this simulation, to check answers; never read by the tool",
                 "plan": plan.name, "seed": seed, "version": __version__,
                 "parameters": plan.material.parameters(), "recordings": truths}
        if plan.effects:
            truth["truth"] = truth_name(plan.effects)
            truth["effects"] = {n: {p: v if math.isfinite(v) else None for p, v in e.items()}
                                for n, e in plan.effects.items()}
        return truth

    write_folder(out, plan, seed, campaign_table(plan, seed), about, progress)
    return Path(out)

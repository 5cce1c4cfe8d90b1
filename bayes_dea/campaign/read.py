"""Reads campaigns: campaign.toml and the recordings it names, from one folder or several."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

from bayes_dea.campaign.build import campaign_from_recordings, recording_from_arrays
from bayes_dea.campaign.columns import read_columns
from bayes_dea.campaign.document import Document, Entry, read_document
from bayes_dea.campaign.paths import check_root, find_toml, resolve_file
from bayes_dea.campaign.schema import Campaign, Recording, Sensor
from bayes_dea.campaign.scratch import Scratch, ScratchSettings
from bayes_dea.errors import InputError

#: reading is parsing and hashing outside the interpreter's lock; more threads cost memory and win nothing
_THREADS = 2
#: called with (recordings read, of how many in this folder, name)
Report = Callable[[float, float, str], None]


@dataclass(frozen=True)
class _Loaded:
    """One recording as read, with what the campaign keeps about its file."""

    recording: Recording
    where: Callable[[int], str]
    input: Mapping[str, Any]
    warnings: tuple[str, ...]


def load_campaign(paths: Path | str | Sequence[Path | str], data_root: Path | str | None = None,
                  free_kinds: bool = False, report: Report | None = None,
                  scratch: ScratchSettings | None = None) -> Campaign:
    """Reads and checks a campaign.

    `paths` is a folder holding campaign.toml, the .toml file itself, or several of them, which become one
    campaign with a specimen each. A recording's file is looked up in the campaign's folder, then in
    `data_root`.
    `free_kinds` accepts every kind that comes with mapped columns (for a model of the user's own). `report` is called
    with (done, of, name) after each recording of a folder. `scratch` says how much of the columns is held in memory and
    where the others are kept; they are read in pieces and lie in mapped files, of which nothing is left afterwards.

    Columns come as read-only float64 arrays (n,) in SI units. Raises InputError for everything that is wrong
    with the input, naming file, row and remedy, BayesDEAError where the folder of the scratch files is full.
    """
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise InputError("No campaign was given. Give a folder that holds campaign.toml.")
    tomls = [find_toml(p) for p in given]
    seen: dict[Path, Path] = {}
    for toml in tomls:
        if toml.resolve() in seen:
            raise InputError(f"{toml}: this campaign was given twice. Give it once.")
        seen[toml.resolve()] = toml
    root = check_root(data_root)
    documents = [read_document(toml, free_kinds) for toml in tomls]
    room = Scratch(scratch)
    loaded = [_load_all(document, root, report, room) for document in documents]
    prefixes = _prefixes(documents)
    if len(documents) == 1:
        return _campaign(loaded[0], [], documents, prefixes)
    merged, notes = _merge(documents, prefixes, loaded)
    return _campaign(merged, notes, documents, prefixes)


def _campaign(loaded: Sequence[_Loaded], notes: list[str], documents: Sequence[Document],
              prefixes: Sequence[str]) -> Campaign:
    first, several = documents[0], len(documents) > 1
    sensors, sensor_notes = _merge_sensors(documents)
    meta = {d.name: dict(d.meta) for d in documents if d.meta} if several else first.meta
    inputs = [_input(f"{prefix}/{d.path.name}" if several else d.path.name, d.path)
              for d, prefix in zip(documents, prefixes, strict=True)]
    return campaign_from_recordings(
        [entry.recording for entry in loaded], sensors, first.actuator,
        name=" + ".join(dict.fromkeys(d.name for d in documents)),
        folders=[d.path.resolve().parent for d in documents],
        ambient=first.ambient, share=first.share, meta=meta, conventions=first.conventions,
        inputs=inputs + _unique([entry.input for entry in loaded]),
        warnings=notes + sensor_notes + [w for entry in loaded for w in entry.warnings],
        where=[entry.where for entry in loaded])


def _unique(inputs: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    return list({(i["file"], i["sha256"]): i for i in inputs}.values())


# -- one folder ---------------------------------------------------------------------------------------------


def _load_all(document: Document, root: Path | None, report: Report | None, room: Scratch) -> list[_Loaded]:
    folder = document.path.parent
    files: list[Path] = []
    seen: dict[tuple[Path, str], str] = {}
    for i, entry in enumerate(document.entries, start=1):
        path = resolve_file(entry.file, folder, root, f"{document.path.name}, recording {i}")
        files.append(path)
        key = (path, repr(entry.format))
        if key in seen:
            raise InputError(f'{document.path.name}, recording {i}: "{entry.file}" is there twice. A '
                             'recording counted twice makes the answer look surer than it is; take one out.')
        seen[key] = entry.name
    out: list[_Loaded] = []
    with ThreadPoolExecutor(_THREADS) as pool:
        for loaded in pool.map(_load, document.entries, files, repeat(room)):
            out.append(loaded)
            if report is not None:
                report(len(out), len(files), loaded.recording.name)
    return out


def _load(entry: Entry, path: Path, room: Scratch) -> _Loaded:
    try:
        read = read_columns(path, entry.kind, entry.format, entry.name, room)
        info = _input(entry.file, path)
    except PermissionError as exc:
        raise InputError(f"{path}: may not be read (permission denied). Change its permissions.") from exc
    for values in read.columns.values():
        values.flags.writeable = False  # nobody else holds them: a copy would take the room twice
    recording = recording_from_arrays(
        entry.name, entry.kind, read.columns, entry.role, entry.actuator, specimen=entry.specimen or "A",
        hold=entry.hold, zeroed=entry.zeroed, rested=entry.rested, rest_before_s=entry.rest_before_s,
        path=path, where=read.where)
    return _Loaded(recording, read.where, info, read.warnings)


def _input(name: str, path: Path) -> dict[str, Any]:
    with path.open("rb") as handle:
        digest = hashlib.file_digest(handle, "sha256").hexdigest()
    return {"file": name, "size": path.stat().st_size, "sha256": digest}


# -- several folders ----------------------------------------------------------------------------------------


def _merge(documents: Sequence[Document], prefixes: Sequence[str],
           loaded: Sequence[Sequence[_Loaded]]) -> tuple[list[_Loaded], list[str]]:
    """All recordings, with specimens and names of their own; notes say what was renamed."""
    _refuse_differing_conventions(documents)
    notes: list[str] = []
    taken: set[str] = set()
    names = [entry.recording.name for entries in loaded for entry in entries]
    merged: list[_Loaded] = []
    for document, prefix, entries in zip(documents, prefixes, loaded, strict=True):
        labels: dict[str, str] = {}
        for specimen in dict.fromkeys(entry.recording.specimen for entry in entries):
            reserved = taken | {e.recording.specimen for e in entries} - {specimen}
            label = specimen if specimen not in taken else _free_label(reserved | set(labels.values()))
            labels[specimen] = label
            if label != specimen:
                notes.append(f'{document.path.parent.name}: its specimen "{specimen}" is called "{label}" '
                             'here; every folder is taken to be a specimen of its own.')
        taken |= set(labels.values())
        for entry in entries:
            r = entry.recording
            name = f"{prefix}/{r.name}" if names.count(r.name) > 1 else r.name
            file = {**entry.input, "file": f"{prefix}/{entry.input['file']}"}
            merged.append(replace(entry, recording=replace(r, name=name, specimen=labels[r.specimen]), input=file))
    return merged, notes


def _free_label(taken: set[str]) -> str:
    letters = [chr(ord("A") + i) for i in range(26)]
    names = letters + [f"{a}{b}" for a in letters for b in letters]
    return next(n for n in names if n not in taken)


def _prefixes(documents: Sequence[Document]) -> list[str]:
    """A name of its own for every folder."""
    prefixes: list[str] = []
    for d in documents:
        base = d.path.resolve().parent.name or d.name
        name, k = base, 2
        while name in prefixes:
            name, k = f"{base}_{k}", k + 1
        prefixes.append(name)
    return prefixes


def _refuse_differing_conventions(documents: Sequence[Document]) -> None:
    first = documents[0]
    for d in documents[1:]:
        # hold is carried by every recording, so folders may differ in it
        differing = [k for k in first.conventions if k != "hold" and d.conventions[k] != first.conventions[k]]
        if differing:
            raise InputError(f"{d.path}: its convention {differing[0]} = \"{d.conventions[differing[0]]}\" "
                             f"differs from that of {first.path} "
                             f'("{first.conventions[differing[0]]}"). Folders that are read as one campaign '
                             "need the same.")
        if d.share != first.share:
            raise InputError(f"{d.path}: its [share] differs from that of {first.path}. Write the same in "
                             "both.")


def _merge_sensors(documents: Sequence[Document]) -> tuple[dict[str, Sensor], list[str]]:
    """The sensors of all folders; where two state different numbers, the larger, with a note."""
    sensors: dict[str, Sensor] = {}
    notes: list[str] = []
    for d in documents:
        for channel, sensor in d.sensors.items():
            if channel not in sensors or sensors[channel] == sensor:
                sensors[channel] = sensor
                continue
            old, new = asdict(sensors[channel]), asdict(sensor)
            sensors[channel] = Sensor(**{k: max((v for v in (old[k], new[k]) if v is not None), default=None)
                                         for k in old})
            notes.append(f"{d.path.parent.name}: [sensor.{channel}] differs from that of another folder; the "
                         "larger numbers are used for all.")
    return sensors, notes

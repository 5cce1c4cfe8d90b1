"""campaign.toml as checked settings: nothing of the recordings' files is opened here."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bayes_dea.campaign.format_map import FormatMap, parse_format
from bayes_dea.campaign.schema import HOLDS, KINDS, ROLES, VOLTAGE_KINDS, Actuator, Sensor
from bayes_dea.campaign.settings import (
    boolean,
    check_keys,
    choice,
    number,
    parse_actuator,
    parse_ambient,
    parse_conventions,
    parse_sensors,
    table,
    text,
)
from bayes_dea.campaign.units import suffix
from bayes_dea.campaign.vocabulary import KNOWN_COLUMNS, RECORDING_KEYS, TOP_KEYS, did_you_mean, near
from bayes_dea.errors import InputError
from bayes_dea.toml_text import parse_toml


@dataclass(frozen=True)
class Entry:
    """One `[[recording]]` of campaign.toml."""

    file: str
    name: str
    kind: str
    role: str
    format: FormatMap
    actuator: Actuator
    specimen: str | None  # None where the file says nothing
    hold: str
    zeroed: bool
    rested: bool
    rest_before_s: float | None


@dataclass(frozen=True)
class Document:
    """One campaign.toml, checked."""

    path: Path
    name: str
    actuator: Actuator
    sensors: Mapping[str, Sensor]
    ambient: Mapping[str, float]
    share: tuple[str, ...] | None
    meta: Mapping[str, Any]
    conventions: Mapping[str, str]
    entries: tuple[Entry, ...]


def read_document(path: Path, free_kinds: bool = False) -> Document:
    """Reads and checks campaign.toml.

    `free_kinds` accepts every `kind` that comes with mapped columns (a model of the user's own); without it,
    one that is nearly a built-in kind is taken for a slip. Raises InputError for TOML that cannot be read
    (with its line), unknown keys and words (naming the nearest) and values that cannot be.
    """
    label = path.name
    try:
        raw = path.read_bytes()
    except OSError as exc:
        raise InputError(f"{path}: cannot be read ({exc.strerror or exc}). Change its permissions, or copy it anew."
                         ) from exc
    try:
        content = parse_toml(raw.decode("utf-8-sig"), str(path))
    except UnicodeDecodeError as exc:
        line = raw[: exc.start].count(b"\n") + 1
        raise InputError(f"{path}, line {line}: the file is not UTF-8. Save it as UTF-8.") from exc
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"line (\d+)", str(exc))
        line_text = f", line {found.group(1)}" if found else ""
        raise InputError(f"{path}{line_text}: this is no valid TOML ({exc}). Correct that line; texts stand "
                         "in quotation marks, names of tables in brackets.") from exc
    check_keys(content, TOP_KEYS, label)
    actuator = parse_actuator(content.get("actuator", {}), f"{label}, [actuator]")
    base = parse_format(content.get("format", {}), f"{label}, [format]")
    conventions = parse_conventions(content.get("conventions", {}), label, content.get("hold"))
    recordings = content.get("recording")
    if not isinstance(recordings, list) or not recordings:
        raise InputError(f"{label}: there is no recording. Add one: [[recording]] (two brackets) with file, "
                         "kind and role.")
    entries = tuple(_entry(r, i, label, actuator, base, conventions["hold"], free_kinds)
                    for i, r in enumerate(recordings, start=1))
    if conventions["memory"] == "continued":
        entries = _continued(entries, recordings)
    own = {name.rsplit("_", 1)[0]: suffix(name) or "" for e in entries for name in e.format.columns
           if name not in KNOWN_COLUMNS}
    return Document(
        path=path,
        name=text(content["name"], f"{label}: name") if "name" in content else path.resolve().parent.name,
        actuator=actuator,
        sensors=parse_sensors(content.get("sensor", {}), label, own),
        ambient=parse_ambient(content.get("ambient", {}), label),
        share=_share(content.get("share"), label),
        meta=dict(table(content.get("meta", {}), f"{label}, [meta]")),
        conventions=conventions,
        entries=entries)


def _share(given: object, label: str) -> tuple[str, ...] | None:
    if given is None:
        return None
    content = table(given, f"{label}, [share]")
    check_keys(content, ("parameters",), f"{label}, [share]")
    names = content.get("parameters")
    if names is None:
        return None
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise InputError(f'{label}, [share]: parameters must be a list of names, e.g. ["Y_Pa", "tau_1_s"].')
    return tuple(dict.fromkeys(names))


def _continued(entries: tuple[Entry, ...], given: list[Mapping[str, Any]]) -> tuple[Entry, ...]:
    """Every recording that can carries on from the last such one of its specimen, unless it says itself.

    Of mechanical ones nobody recorded what the specimen did in between, out of contact: they begin rested.
    """
    seen: set[str | None] = set()
    out = []
    for entry, table_ in zip(entries, given, strict=True):
        if entry.kind in KINDS and entry.kind not in VOLTAGE_KINDS:
            out.append(entry)
            continue
        first = entry.specimen not in seen
        seen.add(entry.specimen)
        out.append(entry if first or "rested" in table_ else replace(entry, rested=False))
    return tuple(out)


def _entry(given: object, number_: int, label: str, actuator: Actuator, base: FormatMap, hold: str,
           free_kinds: bool) -> Entry:
    where = f"{label}, recording {number_}"
    content = table(given, where)
    check_keys(content, RECORDING_KEYS, where)
    if "file" not in content:
        raise InputError(f'{where}: file is missing. Add file = "....csv".')
    file = text(content["file"], f"{where}: file")
    where = f"{label}, recording {number_} ({file})"
    if "kind" not in content:
        raise InputError(f"{where}: kind is missing. Add one of: {', '.join(KINDS)}.")
    fmt = parse_format(content["format"], f"{where}, [format]", base) if "format" in content else base
    kind = _kind(text(content["kind"], f"{where}: kind"), fmt, where, free_kinds)
    rest = content.get("rest_before_s")
    rested = boolean(content.get("rested", True), f"{where}: rested")
    if rest is not None:
        rest = number(rest, f"{where}: rest_before_s", least=0.0)
        if rested:
            raise InputError(f"{where}: rest_before_s goes with rested = false (a rested recording remembers "
                             "nothing). Add rested = false, or take rest_before_s out.")
    if "meta" in content:
        table(content["meta"], f"{where}: meta")
    name = file
    if "name" in content:
        name = text(content["name"], f"{where}: name")
    elif fmt.dataset is not None:
        name = f"{file}:{fmt.dataset}"
    return Entry(
        file=file, name=name, kind=kind,
        role=choice(content.get("role", "identify"), ROLES, f"{where}: role"),
        format=fmt,
        actuator=parse_actuator(content.get("actuator", {}), f"{where}: actuator", actuator),
        specimen=text(content["specimen"], f"{where}: specimen") if "specimen" in content else None,
        hold=choice(content["hold"], HOLDS, f"{where}: hold") if "hold" in content else hold,
        zeroed=boolean(content.get("zeroed", False), f"{where}: zeroed"),
        rested=rested, rest_before_s=rest)


def _kind(kind: str, fmt: FormatMap, where: str, free_kinds: bool) -> str:
    """A built-in kind, or a free one with mapped columns (a model of the user's own)."""
    if kind in KINDS:
        return kind
    if fmt.columns and (free_kinds or near(kind, KINDS, 0.7) is None):
        return kind
    raise InputError(f'{where}: unknown kind "{kind}". {did_you_mean(kind, KINDS)}')

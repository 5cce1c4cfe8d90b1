"""campaign.toml of a proposal: what is known as settings, why in comments, what is open as commented lines."""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.importing.propose import FREE_KIND, Proposal, ProposedRecording, TableReport

_WIDTH = 110
_GEOMETRY = (
    ("name", '"..."', ""),
    ("layers", "399", ""),
    ("layer_thickness_m", "25e-6", "at rest"),
    ("relative_permittivity", "2.8", ""),
    ("electrode_area_m2", "7.56e-5", "active area"),
    ("total_area_m2", "1.145e-4", "with the passive rim"),
    ("stack_height_m", "10.26e-3", ""),
    ("max_voltage_V", "1200", "limits, optional"),
    ("max_frequency_Hz", "100", ""),
)
_CHANNELS = {"displacement_m": ("displacement", "m"), "force_N": ("force", "N"), "position_m": ("position", "m")}


def toml_text(
    proposal: Proposal, files: Mapping[Path, str], call: str, tables: Mapping[str, Any] | None = None
) -> str:
    """The text of campaign.toml.

    `files` says under which name a file stands in it, `call` how the campaign is then read, `tables` holds [actuator],
    [sensor] and the like of a file of the user's (already checked).
    """
    usable = [r for r in proposal.recordings if r.usable]
    real = [r for r in usable if r.kind != FREE_KIND]
    shared = _shared_format(proposal.recordings)
    lines = _comment(
        [
            "Proposed by bayes-dea import from the files themselves; every choice has its reason beside it.",
            f"Then: {call}" if call else "No model of bayes-dea reads these recordings: none is of an actuator.",
        ]
    )
    if proposal.open:
        lines += _comment(["UNDECIDED: what is commented out below waits for you."])
    lines += ["", *_actuator(tables or {}, bool(real)), *_sensors(tables or {}, proposal.recordings)]
    for key in ("ambient", "share", "meta", "conventions"):
        if tables and key in tables:
            lines += ["", *_table(key, tables[key])]
    if shared is not None:
        lines += ["", "[format]", *(f"{k} = {v}" for k, v in _format_lines(shared))]
    for report in proposal.reports:
        lines += _report(report, files, shared, bool(real))
    for path, why in proposal.skipped:
        lines += ["", *_comment([f"{path.name}: left out; {why}"])]
    return "\n".join(lines) + "\n"


def _comment(texts: Iterable[str], indent: str = "") -> list[str]:
    out = []
    for text in texts:
        clean = re.sub(
            r"[\x00-\x08\x0a-\x1f\x7f\ud800-\udfff]", "?", text
        )  # TOML allows none of these, not even in a comment
        out += textwrap.wrap(
            clean,
            _WIDTH,
            initial_indent=f"# {indent}",
            subsequent_indent=f"#   {indent}",
            break_long_words=False,
            break_on_hyphens=False,
        ) or ["#"]
    return out


def _actuator(tables: Mapping[str, Any], needed: bool) -> list[str]:
    if "actuator" in tables:
        return _table("actuator", tables["actuator"])
    lines = ["[actuator]"]
    if needed:
        lines += _comment(["Geometry is in no recording: fill in what your actuator's data sheet says (SI units)."])
    return lines + [f"# {key} = {value}" + (f"  # {what}" if what else "") for key, value, what in _GEOMETRY]


def _sensors(tables: Mapping[str, Any], recordings: Sequence[ProposedRecording]) -> list[str]:
    if "sensor" in tables:
        return [
            line
            for channel, values in tables["sensor"].items()
            for line in ["", *_table(f"sensor.{channel}", values)]
        ]
    lines: list[str] = []
    for own, (channel, unit) in _CHANNELS.items():
        seen = [r.noise[own] for r in recordings if own in r.noise]
        if not seen:
            continue
        scatter = max(s for s, _ in seen)
        step = min((q for _, q in seen if q > 0), default=0.0)
        lines += [
            "",
            f"[sensor.{channel}]",
            f"# fluctuation_{unit} = ...  # from its data sheet, one standard deviation; "
            f"neighbouring samples scatter by {scatter:.2g}",
            f"# accuracy_{unit} = ...  # from its data sheet, limits of the systematic error",
            f"# resolution_{unit} = ...  # smallest step in the files: {step:.2g}",
        ]
    return lines


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    import tomli_w

    return (
        tomli_w.dumps({"x": dict(values)})
        .replace("[x]", f"[{name}]", 1)
        .replace("[x.", f"[{name}.")
        .rstrip("\n")
        .split("\n")
    )


def _shared_format(recordings: Sequence[ProposedRecording]) -> FormatMap | None:
    """The format of all recordings where it is one and the same but for the rows."""
    formats = [replace(r.format, rows=None) for r in recordings]
    if len(formats) < 2 or not all(f == formats[0] for f in formats) or not _format_lines(formats[0]):
        return None
    if any(r.kind == FREE_KIND for r in recordings):
        return None
    return formats[0]


def _report(report: TableReport, files: Mapping[Path, str], shared: FormatMap | None, real: bool) -> list[str]:
    lines = ["", *_comment([f"--- {report.table.label} ---"]), *_comment(report.reasons, "- ")]
    lines += _comment([f"ASSUMED: {text}" for text in report.assumed])
    lines += _comment([f"UNDECIDED: {text}" for text in report.open])
    if report.remark:
        lines += _comment([f"{report.remark}."])
        if report.recordings:
            lines += _comment([f'Kept as kind "{FREE_KIND}", which load_campaign reads in Python; no model does.'])
    for recording in report.recordings:
        body = _recording(recording, files[recording.path], shared)
        active = recording.usable and not (recording.kind == FREE_KIND and real)
        if not active and recording.usable:
            lines += _comment(
                ["Commented out, because the recordings of an actuator here are for the built-in models."]
            )
        lines += body if active else [f"# {line}" for line in body]
        lines.append("")
    if not report.recordings and report.open:
        lines += [f"# [[recording]]\n# file = {_value(files[report.table.path])}"]
    while lines and not lines[-1]:
        lines.pop()
    return lines


def _recording(r: ProposedRecording, file: str, shared: FormatMap | None) -> list[str]:
    lines = ["[[recording]]", f"file = {_value(file)}"]
    if r.name is not None:
        lines.append(f"name = {_value(r.name)}")
    rate = f"{r.rate_Hz:.6g} samples a second{'' if r.even else ', unevenly'}" if r.rate_Hz else "no times"
    lines.append(f"kind = {_value(r.kind)}  # {r.rows} rows, {rate}, {r.duration_s:.6g} s")
    lines.append('role = "identify"  # "validate": never fitted, only predicted; set one or two aside')
    if r.hold is not None:
        lines.append(f"hold = {_value(r.hold)}")
    if not r.rested:
        lines += [
            "rested = false  # goes on where the recording above ended",
            f"rest_before_s = {_number(r.rest_before_s or 0.0)}",
        ]
    own = replace(r.format, rows=None)
    if shared is None:
        lines += [f"format.{key} = {value}" for key, value in _format_lines(own, r.kind == FREE_KIND)]
    if r.format.rows is not None:
        lines.append(f"format.rows = [{r.format.rows[0]}, {r.format.rows[1]}]")
    return lines


def _format_lines(fmt: FormatMap, every: bool = False) -> list[tuple[str, str]]:
    """Keys and values of a format map that differ from the project's own CSV; `every` column for a free kind."""
    plain = FormatMap()
    lines: list[tuple[str, str]] = []
    for key in ("type", "delimiter", "decimal", "encoding", "skip_rows", "dataset"):
        value = getattr(fmt, key)
        if value != getattr(plain, key):
            lines.append((key, _value("tab" if value == "\t" else value)))
    if fmt.header != plain.header:
        lines.append(("header", "false" if fmt.header == 0 else str(fmt.header)))
    for own, column in fmt.columns.items():
        text = _value(own) if every and column == ColumnMap(name=own) else column_text(own, column)
        if text is not None:
            lines.append((f"columns.{_key(own)}", text))
    return lines


def column_text(own: str, column: ColumnMap) -> str | None:
    """A column as it stands in [format]; None where it has our name and unit already."""
    parts: dict[str, Any] = {}
    plain = ColumnMap()
    for key in ("name", "index", "unit", "sign", "scale", "offset", "rate_Hz", "time_format"):
        value = getattr(column, key)
        if value != getattr(plain, key):
            parts[key] = value
    if parts == {"name": own}:
        return None if own in _known() else _value(own)
    if set(parts) == {"name"}:
        return _value(parts["name"])
    return "{ " + ", ".join(f"{k} = {_value(v)}" for k, v in parts.items()) + " }"


def _known() -> tuple[str, ...]:
    from bayes_dea.campaign.vocabulary import KNOWN_COLUMNS

    return KNOWN_COLUMNS


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def _value(value: object) -> str:
    if isinstance(value, float):
        return _number(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _number(value: float) -> str:
    return repr(int(value)) if float(value).is_integer() and abs(value) < 1e9 else repr(float(value))


def names_of_files(paths: Sequence[Path], out: Path) -> tuple[dict[Path, str], Path | None]:
    """Name of every file in the campaign, and the data root that is needed (None where all lie in `out`)."""
    resolved = {p: p.resolve() for p in paths}
    folder = out.resolve()
    outside = [r.parent for r in resolved.values() if not r.is_relative_to(folder)]
    root = Path(os.path.commonpath(outside)) if outside else None
    names = {}
    for given, path in resolved.items():
        base = folder if path.is_relative_to(folder) or root is None else root
        names[given] = path.relative_to(base).as_posix()
    return names, root

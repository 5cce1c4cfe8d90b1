"""What a line from the device says: a sample, a header, an answer, a remark, or nothing that can be trusted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ..campaign.units import conversion
from ..errors import InputError

COLUMNS = ("time_s", "voltage_V", "displacement_m")
_LONGEST = 400


@dataclass(frozen=True)
class Column:
    """Where one of our columns stands on a line (from 0), and value = factor (raw - offset) + shift."""

    index: int
    factor: float = 1.0
    offset: float = 0.0
    shift: float = 0.0


@dataclass(frozen=True)
class LineFormat:
    """How samples are written. The default is that of CONTRACT 6; `fields` is how many a line has.

    delimiter: one character, or "whitespace" for any amount of it, as in `[format]`. start, stop, zero, volts, ask:
    words for the device; empty where it has none. `volts` holds {volts}.
    """

    columns: Mapping[str, Column]
    fields: int
    delimiter: str = ","
    decimal: str = "."
    checksum: bool = True
    comment: str = "#"
    start: str = "START"
    stop: str = "STOP"
    zero: str = "ZERO"
    volts: str = "V {volts:.2f}"
    play: str = "PLAY {name}"
    ask: str = "?"


def own_format() -> LineFormat:
    """The line of CONTRACT 6."""
    return LineFormat({name: Column(i) for i, name in enumerate(COLUMNS)}, len(COLUMNS))


def checksum(text: bytes) -> int:
    """XOR of all bytes, by halving: a loop over bytes in Python costs more than the rest of the line."""
    size = len(text)
    value = int.from_bytes(text, "little")
    while size > 1:
        half = (size + 1) // 2
        value = (value >> (8 * half)) ^ (value & ((1 << (8 * half)) - 1))
        size = half
    return value


def parse_sample(line: bytes, form: LineFormat) -> tuple[float, float, float] | str:
    """(time in s, voltage in V, displacement in m) of one line without its end, or why it cannot be trusted."""
    if len(line) > _LONGEST:
        return "too long"
    body = line
    if form.checksum:
        if line[-3:-2] != b"*":
            return "cut: no checksum"
        body = line[:-3]
        try:
            said = int(line[-2:], 16)
        except ValueError:
            return "checksum is no number"
        if said != checksum(body):
            return "wrong checksum"
    try:
        parts = body.decode("ascii").split(None if form.delimiter == "whitespace" else form.delimiter)
        if len(parts) != form.fields:
            return f"{len(parts)} columns instead of {form.fields}"
        if form.decimal != ".":
            parts = [p.replace(form.decimal, ".") for p in parts]
        values = []
        for name in COLUMNS:
            c = form.columns[name]
            text = parts[c.index].strip()
            # an empty cell between two delimiters is how many loggers write that there was no reading
            number = math.nan if not text and name == COLUMNS[2] else float(text)
            values.append(c.factor * (number - c.offset) + c.shift)
    except (UnicodeDecodeError, ValueError):
        return "garbled"
    t, v, y = values
    if not (math.isfinite(t) and math.isfinite(v)):  # a reading may be missing, a time not
        return "not finite"
    return t, v, y


def header_columns(line: str) -> tuple[str, ...] | None:
    """Columns that a header of CONTRACT 6 names; None where the line is none."""
    if not line.startswith("# bayes-dea-bench 1 "):
        return None
    return tuple(line[len("# bayes-dea-bench 1 ") :].strip().split(","))


def format_of_header(columns: tuple[str, ...]) -> LineFormat:
    """Format for a header's columns, in whatever order. Raises InputError where one that is needed is missing."""
    missing = [c for c in COLUMNS if c not in columns]
    if missing:
        raise InputError(f"the device's header names {', '.join(columns)}; {', '.join(missing)} is missing. Map its "
                         "columns with [device] in the campaign's TOML file.")
    return LineFormat({c: Column(columns.index(c)) for c in COLUMNS}, len(columns))


_WORDS = ("start", "stop", "zero", "volts", "play", "ask")
_KEYS = ("order", "delimiter", "decimal", "checksum", "comment", "columns", *_WORDS)


def parse_device(given: Mapping[str, object], where: str) -> LineFormat:
    """A format from a `[device]` table: `order` names what stands on a line, `columns` maps it to ours.

    As in `[format]`: columns.voltage_V = {name = "HV", unit = "kV", sign = -1, offset = 0.1}, or a name alone. Raises
    InputError for what is unknown or missing.
    """
    from ..campaign.format_map import parse_format
    from ..campaign.settings import check_keys

    check_keys(given, _KEYS, where)
    order = given.get("order")
    if not isinstance(order, list) or not all(isinstance(n, str) for n in order):
        raise InputError(f'{where}: order is missing; name what stands on a line, as order = ["t", "HV", "laser"]')
    mapped = parse_format({k: given[k] for k in ("delimiter", "decimal", "columns") if k in given}, where)
    columns = {}
    for name in COLUMNS:
        m = mapped.columns.get(name)
        source = name if m is None else m.name
        if m is not None and m.index is not None:
            index = m.index - 1
            if index >= len(order):
                raise InputError(f"{where}: columns.{name}: index = {m.index}, but order names {len(order)} columns on "
                                 "a line; name all that stand there, or correct index")
        elif source in order:
            index = order.index(source)
        else:
            raise InputError(f'{where}: nothing gives {name}; write columns.{name} = {{ name = "...", unit = "..." }} '
                             f"with a name from one of order ({', '.join(order)})")
        if m is None:
            columns[name] = Column(index)
            continue
        if m.offset == "first":
            raise InputError(f'{where}: columns.{name}: offset = "first" is for files; use --zero, or give a number')
        unit = conversion(m.unit, name, where) if m.unit else None
        factor = m.sign * m.scale * (unit.slope if unit else 1.0)
        columns[name] = Column(index, factor, float(m.offset), m.sign * (unit.shift if unit else 0.0))
    words = {}
    for key in ("comment", *_WORDS):
        value = given.get(key, "#" if key == "comment" else "")
        if not isinstance(value, str):
            raise InputError(f"{where}: {key} must be a text in quotation marks")
        if key != "comment" and not value.isascii():
            raise InputError(f"{where}: {key} = {value!r} cannot be sent: a word for the device is plain ASCII")
        words[key] = value
    kind = given.get("checksum", "none")
    if kind not in ("none", "xor"):
        raise InputError(f'{where}: checksum = {kind!r} is not known; "none" or "xor" (two hex digits after *)')
    return LineFormat(columns, len(order), mapped.delimiter, mapped.decimal, kind == "xor", **words)

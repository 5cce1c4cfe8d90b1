"""Delimiter, decimal sign and the row where the numbers of a text file begin."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

from bayes_dea.campaign.csv_source import to_float
from bayes_dea.campaign.format_map import FormatMap
from bayes_dea.errors import InputError

#: tried in this order; of two that read equally many columns the first wins
_CANDIDATES = (
    (";", ","),
    (";", "."),
    ("\t", "."),
    ("\t", ","),
    (",", "."),
    ("|", "."),
    ("whitespace", "."),
    ("whitespace", ","),
)
_DELIMITER_NAMES = {",": "commas", ";": "semicolons", "|": "bars", "\t": "tabs", "whitespace": "white space"}
_BODY_ROWS = 200

_ISO = re.compile(r"^\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?$")
_CLOCK = re.compile(r"^\d{1,3}:\d\d(:\d\d)?([.,]\d+)?$")
_PATTERNS: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"^\d{1,2}\.\d{1,2}\.\d{4}[ T]\d{1,2}:\d\d:\d\d$"), "%d.%m.%Y %H:%M:%S"),
    (re.compile(r"^\d{1,2}\.\d{1,2}\.\d{4}[ T]\d{1,2}:\d\d:\d\d\.\d{1,6}$"), "%d.%m.%Y %H:%M:%S.%f"),
    (re.compile(r"^\d{1,2}\.\d{1,2}\.\d{4}[ T]\d{1,2}:\d\d:\d\d,\d{1,6}$"), "%d.%m.%Y %H:%M:%S,%f"),
    (re.compile(r"^\d{4}/\d{1,2}/\d{1,2} \d{1,2}:\d\d:\d\d$"), "%Y/%m/%d %H:%M:%S"),
    (re.compile(r"^\d{4}/\d{1,2}/\d{1,2} \d{1,2}:\d\d:\d\d\.\d{1,6}$"), "%Y/%m/%d %H:%M:%S.%f"),
    (re.compile(r"^\d{1,2}/\d{1,2}/\d{4} \d{1,2}:\d\d:\d\d$"), "%m/%d/%Y %H:%M:%S"),
    (re.compile(r"^\d{1,2}/\d{1,2}/\d{4} \d{1,2}:\d\d:\d\d\.\d{1,6}$"), "%m/%d/%Y %H:%M:%S.%f"),
    (re.compile(r"^\d{1,2}:\d\d:\d\d [AaPp][Mm]$"), "%I:%M:%S %p"),
    (re.compile(r"^\d{1,2}:\d\d:\d\d\.\d{1,6} [AaPp][Mm]$"), "%I:%M:%S.%f %p"),
)


@dataclass(frozen=True)
class Layout:
    """How the rows of numbers are written: kind of every column ("number", "text", "empty" or a time_format)."""

    delimiter: str
    decimal: str
    first: int  # line (from 0) of the first row of numbers
    kinds: tuple[str, ...]

    @property
    def described(self) -> str:
        """In words."""
        sign = "comma" if self.decimal == "," else "point"
        return f"cells separated by {_DELIMITER_NAMES.get(self.delimiter, self.delimiter)}, decimal {sign}"


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line, stripped."""
    if delimiter == "whitespace":
        return line.split()
    row = next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


def time_format(texts: Sequence[str]) -> str | None:
    """The `time_format` that reads all of some cells, None where they are no times."""
    cells = [t for t in texts if t]
    if len(cells) < 3:
        return None
    if all(_ISO.match(c) for c in cells):
        return "iso"
    if all(_CLOCK.match(c) for c in cells):
        return "clock"
    for pattern, text in _PATTERNS:
        if all(pattern.match(c) for c in cells):
            if text.startswith("%m/%d") and any(int(c.split("/")[0]) > 12 for c in cells):
                return "%d/%m" + text[5:]
            return text
    return None


def find_layout(lines: Sequence[str]) -> Layout | None:
    """The layout of a text, None where it holds no table of numbers.

    Raises InputError for commas that separate and stand for the decimal point at once.
    """
    filled = [i for i, line in enumerate(lines) if line.strip()]
    body = [lines[i] for i in filled[max(len(filled) // 3, len(filled) - _BODY_ROWS) :]]
    if len(body) < 2:
        return None
    best: tuple[float, str, str, tuple[str, ...]] | None = None
    for delimiter, decimal in _CANDIDATES:
        scored = _score(body, delimiter, decimal)
        if scored is not None and (best is None or scored[0] > best[0] + 1e-9):
            best = (scored[0], delimiter, decimal, scored[1])
    if best is None:
        return None
    _, delimiter, decimal, kinds = best
    first = _first_row(lines, filled, delimiter, decimal, kinds)
    if first is None:
        return None
    if delimiter == ",":
        _refuse_two_commas(lines, filled, first, kinds)
    return Layout(delimiter, decimal, first, kinds)


def _score(body: Sequence[str], delimiter: str, decimal: str) -> tuple[float, tuple[str, ...]] | None:
    try:
        rows = [cells_of(line, delimiter) for line in body]
    except csv.Error:
        return None
    widths = [len(r) for r in rows]
    width = max(set(widths), key=widths.count)
    fitting = [r for r in rows if len(r) == width]
    if len(fitting) < 0.9 * len(rows):
        return None
    kinds = tuple(_column_kind([r[i] for r in fitting], decimal) for i in range(width))
    numbers = sum(k == "number" for k in kinds)
    texts = sum(k == "text" for k in kinds)
    times = width - numbers - texts - sum(k == "empty" for k in kinds)
    if numbers == 0:
        return None
    # a decimal sign that is nowhere to be seen is no evidence for it
    seen = any(decimal in c for r in fitting[:50] for c, k in zip(r, kinds, strict=True) if k == "number")
    return (numbers + times - 0.3 * texts) * len(fitting) / len(rows) + (0.01 if seen else 0.0), kinds


def _column_kind(cells: Sequence[str], decimal: str) -> str:
    filled = [c for c in cells if c]
    if len(filled) < 0.1 * len(cells):
        return "empty"
    good = sum(to_float(c, decimal) is not None for c in filled)
    if good >= 0.9 * len(filled):
        return "number"
    return time_format(filled) or "text"


def _fits(cells: Sequence[str], decimal: str, kinds: Sequence[str]) -> bool:
    if len(cells) < max(i for i, k in enumerate(kinds) if k != "empty") + 1:
        return False
    filled = 0
    for cell, kind in zip(cells, kinds, strict=False):
        if kind == "number":
            if to_float(cell, decimal) is None:
                return False
            filled += bool(cell)
        elif kind not in ("text", "empty") and cell and (":" not in cell or not any(ch.isdigit() for ch in cell)):
            return False  # a heading above a column of times
    return filled > 0


def _first_row(
    lines: Sequence[str], filled: Sequence[int], delimiter: str, decimal: str, kinds: Sequence[str]
) -> int | None:
    good = [_fits(cells_of(lines[i], delimiter), decimal, kinds) for i in filled]
    for k, i in enumerate(filled):
        following = good[k : k + 5]
        if len(following) >= 2 and all(following):
            return i
    return None


def _refuse_two_commas(lines: Sequence[str], filled: Sequence[int], first: int, kinds: Sequence[str]) -> None:
    above = [i for i in filled if i < first]
    rows = [cells_of(lines[i], ",") for i in filled if i >= first][:50]
    whole = all(re.fullmatch(r"-?\d+", c) for r in rows for c in r if c)
    if above and whole and len(kinds) >= 4 and len(cells_of(lines[above[-1]], ",")) * 2 == len(kinds):
        raise InputError(
            "commas separate the cells and stand for the decimal point at once, so that no program can "
            "tell them apart. Export it again with semicolons, or with decimal points."
        )


def rows_format(layout: Layout, encoding: str, skip_rows: int, header: int) -> FormatMap:
    """The format map of a text file without its columns."""
    return FormatMap(
        delimiter=layout.delimiter, decimal=layout.decimal, encoding=encoding, skip_rows=skip_rows, header=header
    )

"""From a file's columns to ours: which are wanted, and sign, factor, unit and offset of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.scratch import Scratch, beside, pieces
from bayes_dea.campaign.tables import Source, Table, open_source
from bayes_dea.campaign.units import conversion
from bayes_dea.campaign.vocabulary import COLUMNS, KNOWN_COLUMNS, did_you_mean, near
from bayes_dea.errors import InputError


@dataclass(frozen=True)
class Read:
    """Columns of one recording in SI units, and where its elements stand in the file."""

    columns: dict[str, NDArray[np.float64]]
    where: Callable[[int], str]
    warnings: tuple[str, ...]


def read_columns(path: Path, kind: str, fmt: FormatMap, label: str, scratch: Scratch | None = None) -> Read:
    """Reads what a recording of `kind` needs from `path` through `fmt`, in SI units.

    A built-in kind takes its own columns (mapped or by our names) and every further mapped one that is no
    column of another kind. A free kind takes the mapped ones. Raises InputError as the readers do.
    """
    source = open_source(path, fmt, label, scratch)
    wanted, warnings = _wanted(source, kind, fmt, label)
    from_file = {own: c for own, c in wanted.items() if c.rate_Hz is None}
    if not from_file:
        raise InputError(f"{label}: columns.time_s alone is no recording. Map the other columns in [format].")
    table = cut(source.read(list(from_file.values())), fmt.rows, label)
    columns: dict[str, NDArray[np.float64]] = {}
    for own, column in wanted.items():
        if column.rate_Hz is not None:
            columns[own] = _clock(table.columns[0], column.rate_Hz)
        else:
            raw = table.columns[list(from_file).index(own)]
            columns[own] = to_si(raw, column, own, label, in_place=True)
    return Read(columns, table.where, tuple(warnings) + table.warnings)


def cut(table: Table, rows: tuple[int, int] | None, label: str) -> Table:
    """The rows (first, last), counted from 1, of a table. Raises InputError where it has fewer."""
    if rows is None:
        return table
    first, last = rows
    size = table.columns[0].size
    if last > size:
        raise InputError(f"{label}: [format] rows asks for row {last} after the header, but the file has {size}. "
                         "Correct rows, or copy the file again if it was cut.")
    return Table(tuple(_rows(c, first - 1, last) for c in table.columns), lambda i: table.where(i + first - 1),
                 table.warnings)


def _rows(column: NDArray[np.float64], start: int, stop: int) -> NDArray[np.float64]:
    """Rows of a column as a column of their own: a view would keep the whole file."""
    out = beside(column, n=stop - start)
    for part in pieces(out.size):
        out[part] = column[start + part.start:start + part.stop]
    return out


def _clock(column: NDArray[np.float64], rate_Hz: float) -> NDArray[np.float64]:
    """Times (n,) of the rows of a column that was sampled at a rate."""
    out = beside(column)
    for part in pieces(out.size):
        out[part] = np.arange(part.start, part.stop, dtype=np.float64) / rate_Hz
    return out


def to_si(raw: NDArray[np.float64], column: ColumnMap, own: str, label: str,
          in_place: bool = False) -> NDArray[np.float64]:
    """sign * unit(scale * (raw - offset)); with `in_place` in the array that was given, which is then ours.

    A column taken as it stands comes back unchanged, bit for bit.
    """
    offset = column.offset
    if offset == "first":
        offset = _first_finite(raw)
    slope, shift = column.scale * column.sign, 0.0
    if column.unit is not None:
        unit = conversion(column.unit, own, f"{label}, [format] columns.{own}")
        slope, shift = slope * unit.slope, column.sign * unit.shift
    if not offset and slope == 1.0 and not shift:
        return raw
    # dividing by a whole number keeps 12.3 mm at 0.0123 m to the last digit
    inverse = round(1.0 / slope)
    divides = bool(inverse) and abs(slope * inverse - 1.0) < 1e-12
    out = raw if in_place else raw.copy()
    for part in pieces(out.size):
        piece = out[part]
        if offset:
            piece -= float(offset)
        if slope != 1.0 and divides:
            piece /= inverse
        elif slope != 1.0:
            piece *= slope
        if shift:
            piece += shift
    return out


def _first_finite(values: NDArray[np.float64]) -> float:
    for part in pieces(values.size):
        finite = np.flatnonzero(np.isfinite(values[part]))
        if finite.size:
            return float(values[part][finite[0]])
    return 0.0


def _wanted(source: Source, kind: str, fmt: FormatMap,
            label: str) -> tuple[dict[str, ColumnMap], list[str]]:
    """Our name -> where it comes from, required columns first."""
    warnings: list[str] = []
    mapped = fmt.columns
    if kind not in COLUMNS:
        missing = [own for own, c in mapped.items() if c.rate_Hz is None and not source.has(c)]
        if missing:
            raise source.missing(missing[0], mapped[missing[0]])
        if "time_s" not in mapped:
            raise InputError(f'{label}: a recording of the free kind "{kind}" needs its columns named in '
                             '[format], time_s among them, e.g. columns.time_s = "t".')
        return {"time_s": mapped["time_s"], **mapped}, warnings
    spec = COLUMNS[kind]
    wanted: dict[str, ColumnMap] = {}
    for own in spec.required:
        column = mapped.get(own, ColumnMap(name=own))
        if column.rate_Hz is None and not source.has(column):
            raise _missing(source, own, column, mapped)
        wanted[own] = column
    extra = [own for own in mapped if own not in KNOWN_COLUMNS]
    for own in (*spec.optional, *extra):
        column = mapped.get(own, ColumnMap(name=own))
        if column.rate_Hz is not None or source.has(column):
            wanted[own] = column
        elif own in mapped:
            warnings.append(f"{label}: column {own} is mapped to {column.describe()}, which this file does "
                            "not have; it was read without it. Correct columns in its [format] if it should "
                            "be there.")
        else:
            guess = near(own, source.names, 0.85)
            used = {c.name for c in mapped.values()} | set(KNOWN_COLUMNS)
            if guess is not None and guess not in used:
                warnings.append(f'{label}: column "{guess}" was not read; if it is {own}, rename it or map '
                                'it in [format].')
    return wanted, warnings


def _missing(source: Source, own: str, column: ColumnMap, mapped: Mapping[str, ColumnMap]) -> InputError:
    error = source.missing(own, column)
    extra = [name for name in mapped if name not in KNOWN_COLUMNS]
    if own not in mapped and near(own, extra, 0.5) is not None:
        return InputError(f"{error} (The [format] maps {', '.join(extra)}: {did_you_mean(own, extra, 0.5)})")
    return error

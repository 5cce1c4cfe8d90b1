"""One file -> its columns as they stand in it, whatever its type."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.scratch import Scratch
from bayes_dea.campaign.units import Affine, conversion
from bayes_dea.campaign.vocabulary import did_you_mean, near
from bayes_dea.errors import InputError

_SUFFIXES = {".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".hdf": "hdf5", ".he5": "hdf5",
             ".parquet": "parquet", ".pq": "parquet"}


@dataclass(frozen=True)
class Table:
    """Columns read from a file, float64, in its own units; nan where a cell is a gap.

    `where(i)` says in the user's terms where element i (from 0) stands ("row 12").
    """

    columns: tuple[NDArray[np.float64], ...]
    where: Callable[[int], str]
    warnings: tuple[str, ...] = ()


class Source(Protocol):
    """A file that was opened: the names of its columns, and a way to read some of them."""

    names: tuple[str, ...]

    def has(self, column: ColumnMap) -> bool:
        """Whether the column can be read from this file."""
        ...

    def missing(self, own: str, column: ColumnMap) -> InputError:
        """The error for a column that is not there; `own` is what we call it."""
        ...

    def read(self, columns: Sequence[ColumnMap]) -> Table:
        """The columns, in the order asked for."""
        ...


def file_type(path: Path, fmt: FormatMap) -> str:
    """One of csv, mat, hdf5, parquet: what the map says, else the file's first bytes, else its ending."""
    if fmt.type is not None:
        return fmt.type
    with path.open("rb") as handle:
        head = handle.read(128)
    if head.startswith(b"PAR1"):
        return "parquet"
    if head.startswith(b"MATLAB 5.0") or head.startswith(b"MATLAB 7.3"):
        return "mat"
    if head.startswith(b"\x89HDF"):
        return "mat" if path.suffix.lower() == ".mat" else "hdf5"
    return _SUFFIXES.get(path.suffix.lower(), "csv")


def open_source(path: Path, fmt: FormatMap, label: str, scratch: Scratch | None = None) -> Source:
    """Opens a recording's file. `label` is what messages call it; `scratch` the room for columns that are long.

    Raises InputError for a file that is empty, cut or of another type than it says.
    """
    if path.stat().st_size == 0:
        raise InputError(f"{label}: the file is empty. Record it again, or take it out of campaign.toml.")
    kind = file_type(path, fmt)
    if kind == "csv":
        from bayes_dea.campaign.csv_source import CsvSource

        return CsvSource(path, fmt, label, scratch)
    if kind == "parquet":
        from bayes_dea.campaign.parquet_source import ParquetSource

        return ParquetSource(path, fmt, label, scratch)
    from bayes_dea.campaign.array_source import open_arrays

    return open_arrays(path, fmt, label, kind, scratch)


def missing_column(label: str, own: str, column: ColumnMap, names: Sequence[str],
                   hint: str = "") -> InputError:
    """The error for a column that a file does not have: names the nearest and all that were found."""
    if column.name is None:
        return InputError(f"{label}: there is no column {column.index} (for {own}); the file has "
                          f"{len(names)} columns: {', '.join(names[:30])}. Correct columns.{own}.index.")
    found = did_you_mean(column.name, names).replace("Known:", "Columns found:")
    remedy = hint or (f"Rename it in the file, or say what it is called there: [format] columns.{own} = "
                      f"{_entry(own, near(column.name, names))} in campaign.toml.")
    called = f'column "{column.name}"' + (f" (for {own})" if column.name != own else "")
    return InputError(f"{label}: {called} is missing. {found} {remedy}")


def ambiguous_column(label: str, fmt: FormatMap, column: ColumnMap, called: str, places: Sequence[int]) -> InputError:
    """The error for a name that several columns of a file have, at these places (from 1). called: as it is printed."""
    own = next((k for k, c in fmt.columns.items() if c is column), called)
    return InputError(f'{label}: {"two" if len(places) == 2 else len(places)} columns are called "{called}", numbers '
                      f"{', '.join(map(str, places[:-1]))} and {places[-1]}. Say which in its [format]: columns.{own} "
                      f"= {{ index = {places[0]} }}.")


def _entry(own: str, name: str | None) -> str:
    """What to write for a column in [format]: its name there, and its unit where the name says another than ours."""
    if name is None:
        return '"..."'
    quoted = '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'
    said = re.search(r"[\[(/_]\s*([A-Za-z\u00b0\u00b5\u03bc%]+)\s*[\])]?$", name)
    if said is not None:
        try:
            factor = conversion(said[1], own)
        except InputError:
            return quoted
        if factor != Affine():
            return f'{{ name = {quoted}, unit = "{said[1]}" }}'
    return quoted


def text_times(texts: Iterable[object], column: ColumnMap, label: str, what: str) -> NDArray[np.float64]:
    """A column of texts as seconds, through its `time_format`. Raises InputError naming the first that is no time."""
    from bayes_dea.campaign.clock import BadTimeError, seconds

    plain = ("" if t is None else t.decode("utf-8", "replace") if isinstance(t, bytes) else str(t) for t in texts)
    try:
        return seconds(plain, column.time_format or "iso")
    except BadTimeError as exc:
        raise InputError(f'{label}, {what} {exc.index + 1}: "{exc.text[:40]}" of {column.describe()} is no time of the '
                         f'format "{column.time_format}". Correct time_format in its [format].') from exc

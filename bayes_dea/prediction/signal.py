"""Reading what is to be played: a command, or a wanted stroke, from a file or from arrays."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..campaign.checks import check_columns
from ..campaign.format_map import ColumnMap, FormatMap
from ..campaign.paths import check_root, resolve_file
from ..campaign.tables import open_source
from ..errors import InputError
from ..models.electrostatics import filled_input

#: what a --signal may hold beside time_s, in the order in which it is looked for
INPUTS = ("voltage_V", "position_m")


@dataclass(frozen=True)
class Signal:
    """A column over time: time_s (n,) s, rising; values (n,) without gaps, in the unit that `column` ends with."""

    label: str
    column: str
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    inputs: tuple[Mapping[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()


def find_file(given: Path | str, option: str, data_root: Path | str | None) -> Path:
    """The file itself, or the one of that name inside the data root. Raises InputError where there is none."""
    path = Path(given).expanduser()
    root = check_root(data_root)
    if path.is_dir():
        raise InputError(f"{option} {given}: is a folder; give a CSV file")
    if path.is_file():
        return path
    if root is not None and not path.is_absolute():
        return resolve_file(str(given), root, None, option)
    hint = "" if root is not None else "; if it lies elsewhere, give that folder with --data-root DIR"
    raise InputError(f"{option} {given}: there is no such file{hint}")


def without_campaign(text: str) -> str:
    """A message of the campaign's reader without its remedies that need a campaign.toml, which a command has not."""
    text = text.replace(", or take it out of campaign.toml", "")
    every = re.split(r"(?<=[.?!)]) (?=[A-Z])", text)
    kept = [s for s in every if "[format]" not in s and "campaign.toml" not in s]
    if len(kept) == len(every):
        return text
    return (f"{' '.join(kept)} Write it as plain CSV: a header with our names, commas between cells, decimal points, "
            "SI units; or as Parquet, .mat or HDF5 of that ending.")


def read_signal(
    given: Path | str | Mapping[str, ArrayLike],
    wanted: tuple[str, ...] = INPUTS,
    option: str = "--signal",
    data_root: Path | str | None = None,
) -> Signal:
    """The first column of `wanted` that `given` holds, over time_s.

    given: a CSV, Parquet, .mat or HDF5 file with columns of our names, or arrays by these names. Further columns are
    left alone. A gap in a command is filled with what was commanded before; a gap in a wanted stroke is an error.
    Raises InputError naming file and row.
    """
    if isinstance(given, Mapping):
        found = next((c for c in wanted if c in given), None)
        label = option.lstrip("-")
        if found is None or "time_s" not in given:
            raise InputError(f"{option}: needs time_s and {' or '.join(wanted)}; it has {', '.join(map(str, given))}")
        columns = {c: np.array(given[c], dtype=np.float64) for c in ("time_s", found)}
        where: Callable[[int], str] = lambda i: f"row {i + 1}"  # noqa: E731
        inputs: tuple[Mapping[str, Any], ...] = ()
        notes: list[str] = []
    else:
        path = find_file(given, option, data_root)
        label = path.name
        try:
            source = open_source(path, FormatMap(), label)
            found = next((c for c in wanted if source.has(ColumnMap(name=c))), None)
            if found is None:
                # rows with decimal commas are wider than such a header, and the reader makes up names for the rest
                marked = any(mark in name for name in source.names for mark in ";\t|")
                remedy = ("Separate its cells by commas, with decimal points in numbers" if marked else
                          "Rename its columns; values are in SI units")
                raise InputError(
                    f"{label}: needs the columns time_s and {' or '.join(wanted)} for {option}; it has "
                    f"{', '.join(source.names[:30])}. {remedy}"
                )
            if not source.has(ColumnMap(name="time_s")):
                raise source.missing("time_s", ColumnMap(name="time_s"))
            table = source.read([ColumnMap(name="time_s"), ColumnMap(name=found)])
        except InputError as error:
            raise InputError(without_campaign(str(error))) from error
        columns = dict(zip(("time_s", found), table.columns, strict=True))
        where, notes = table.where, list(table.warnings)
        with path.open("rb") as handle:
            digest = hashlib.file_digest(handle, "sha256").hexdigest()
        inputs = ({"file": str(given), "size": path.stat().st_size, "sha256": digest},)
    check_columns(label, "signal", columns, where)
    values = columns[found]
    gaps = np.flatnonzero(np.isnan(values))
    if gaps.size and found not in INPUTS:
        raise InputError(f"{label}, {where(int(gaps[0]))}: {found} is missing; a wanted stroke has no gaps. Fill it in")
    if gaps.size:
        notes.append(
            f"{label}: {found} has {gaps.size} gap{'s' if gaps.size > 1 else ''}, the first at {where(int(gaps[0]))}; "
            "filled with the value before."
        )
    return Signal(label, found, columns["time_s"], filled_input(values), inputs, tuple(notes))

"""Arrays by name: .mat of both kinds, HDF5 and Parquet; structs, nameless matrices, units as attributes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from bayes_dea.campaign.array_source import open_arrays
from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.parquet_source import ParquetSource
from bayes_dea.errors import InputError
from bayes_dea.importing.facts import find_rate
from bayes_dea.importing.layout import time_format
from bayes_dea.importing.tables import RawColumn, RawTable, Unread
from bayes_dea.importing.unread import find_unread
from bayes_dea.importing.words import parse_unit, read_name

_UNIT_KEYS = ("unit", "units", "Unit", "Units", "UNIT")
_NUMBER = re.compile(r"\(\d+\)$")  # cells of texts are read as tt(1)/VariableUnits beside tt/Time
_MOST_COLUMNS = 64
_FEW = 3


def sniff_arrays(path: Path, kind: str) -> list[RawTable]:
    """Tables of a .mat or HDF5 file: one for every struct or group whose arrays have one length.

    Raises InputError for a file that cannot be read, and for MATLAB's own table objects, which only MATLAB can open.
    """
    source = open_arrays(path, FormatMap(), path.name, kind)
    attributes = _hdf5_attributes(path)
    facts: dict[str, str] = {k: v for (_, k), v in attributes.items() if k not in _UNIT_KEYS}
    groups: dict[tuple[str, int], list[RawColumn]] = {}
    opaque = False
    for name, load in source.leaves.items():
        try:
            values = np.asarray(load())
        except InputError:
            continue
        opaque = opaque or values.dtype.kind == "V"
        _leaf(name, values, attributes, facts, groups)
    groups = _one_channel_groups(groups)
    if not groups and (opaque or any("#subsystem#" in n or n == "None" for n in source.leaves)):
        raise InputError(
            f"{path.name}: holds a MATLAB object (timetable, table or class), which only MATLAB can read. Save "
            "it as a struct: s = table2struct(timetable2table(tt), 'ToScalar', true); save('file.mat', 's')."
        )
    tables = []
    parents = [p for p, _ in groups]
    for (parent, length), columns in groups.items():
        known = {k: v for k, v in facts.items() if parent.startswith(_NUMBER.sub("", k.rpartition("/")[0]))}
        rate = find_rate({k.rpartition("/")[2]: v for k, v in known.items()})
        fmt = FormatMap(dataset=parent or None)
        fitted = tuple(_with_cell_units(columns, known))
        part = parent + (f" ({length} long)" if parents.count(parent) > 1 else "")
        said = f"arrays of {length} elements" + (f' in "{parent}"' if parent else "")
        tables.append(
            RawTable(
                path,
                fmt,
                fitted,
                MappingProxyType(known),
                (said,),
                rate[0] if rate else None,
                rate[1] if rate else "",
                part,
            )
        )
    return tables


def _leaf(
    name: str,
    values: np.ndarray[Any, Any],
    attributes: Mapping[tuple[str, str], str],
    facts: dict[str, str],
    groups: dict[tuple[str, int], list[RawColumn]],
) -> None:
    """One array of the file: a fact, a column, or the columns of a matrix."""
    parent, _, last = name.rpartition("/")
    values = np.squeeze(values)
    if values.dtype.kind in "US" and values.size >= _FEW and values.ndim == 1:
        texts = [v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in values]
        written = time_format([t.strip() for t in texts[:200]])
        if written is not None:
            from bayes_dea.campaign.clock import seconds

            column = RawColumn(last, ColumnMap(name=last, time_format=written), seconds(texts, written), clock=True)
            groups.setdefault((parent, values.size), []).append(column)
            return
    if values.dtype.kind in "USO":
        facts[name] = "\t".join(str(v) for v in values.ravel()[:20])
    elif (
        values.dtype.kind == "u"
        and values.dtype.itemsize == 2
        and values.size <= 64
        and values.ndim <= 1
        and values.size
    ):
        facts[name] = "".join(chr(int(c)) for c in values.ravel())  # MATLAB 7.3 writes text as 16 bit numbers
    elif values.dtype.kind not in "fiub" or values.size == 0:
        return
    elif values.size == 1:
        facts[name] = f"{float(values.ravel()[0]):.12g}"
    elif values.ndim == 1 and values.size >= _FEW:
        unit = next((attributes[name, k] for k in _UNIT_KEYS if (name, k) in attributes), None)
        groups.setdefault((parent, values.size), []).append(
            RawColumn(
                last, ColumnMap(name=last), values.astype(np.float64), unit, "attribute of the file" if unit else ""
            )
        )
    elif values.ndim >= 2 and values.shape[0] >= _FEW:
        values = values.reshape(values.shape[0], -1)  # tensors row by row, as the reader takes them
        if values.shape[1] > min(values.shape[0], _MOST_COLUMNS):
            return
        for i in range(values.shape[1]):
            groups.setdefault((parent, values.shape[0]), []).append(
                RawColumn(
                    f"{last} column {i + 1}", ColumnMap(name=last, index=i + 1), values[:, i].astype(np.float64)
                )
            )


def _one_channel_groups(groups: dict[tuple[str, int], list[RawColumn]]) -> dict[tuple[str, int], list[RawColumn]]:
    """Groups that hold one array each, all of one length, are the channels of one recording."""
    if len(groups) < 2 or any(len(c) != 1 for c in groups.values()) or len({n for _, n in groups}) != 1:
        return groups
    if len({c[0].label for c in groups.values()}) != 1:
        return groups
    merged = [
        replace(
            c[0],
            label=parent.rpartition("/")[2] or c[0].label,
            source=ColumnMap(name=f"{parent}/{c[0].source.name}" if parent else c[0].source.name),
        )
        for (parent, _), c in groups.items()
    ]
    labels = [c.label for c in merged]
    # runs that hold the same array each are recordings of their own, channels have names of their own
    if any(label.endswith(")") or label.isdigit() for label in labels):
        return groups
    return {("", next(iter(groups))[1]): merged}


def _hdf5_attributes(path: Path) -> dict[tuple[str, str], str]:
    """(name, attribute) -> text, of every group and dataset; attributes of a group under its path."""
    import h5py

    found: dict[tuple[str, str], str] = {}
    if not h5py.is_hdf5(path):
        return found

    def take(name: str, item: Any) -> None:
        if name.startswith("#"):
            return
        for key, value in item.attrs.items():
            if key.startswith("MATLAB_"):
                continue
            array = np.ravel(np.asarray(value))
            if array.dtype.kind in "SUO" or array.size == 1:
                text = "\t".join(v.decode("utf-8", "replace") if isinstance(v, bytes) else str(v) for v in array)
                found[name, key if key in _UNIT_KEYS or not name else f"{name}/{key}"] = text

    with h5py.File(path, "r") as file:
        take("", file)
        file.visititems(take)
    return found


def _with_cell_units(columns: list[RawColumn], facts: Mapping[str, str]) -> list[RawColumn]:
    """Units out of MATLAB's VariableUnits, whose order is lost: each goes where only one quantity fits."""
    if any(c.unit for c in columns):
        return columns
    units = [
        (text, parse_unit(part)) for key, text in facts.items() if "unit" in key.lower() for part in text.split("\t")
    ]
    out = list(columns)
    for text, parsed in units:
        if parsed is None:
            continue
        fitting = [i for i, c in enumerate(columns) if _can_have(c, parsed[1])]
        same = [p for _, p in units if p is not None and p[1] == parsed[1]]
        if len(fitting) == 1 and len(same) == 1:
            i = fitting[0]
            out[i] = replace(columns[i], unit=text, unit_from="list of units in the file")
    return out


def _can_have(column: RawColumn, dimension: str) -> bool:
    from bayes_dea.importing.words import DIMENSIONS

    quantity = read_name(column.label).quantity
    return quantity is not None and dimension in DIMENSIONS.get(quantity, ())


def sniff_parquet(path: Path) -> list[RawTable]:
    """The table of a Parquet file; units from the fields' metadata. Raises InputError for a damaged file."""
    import pyarrow as pa
    from pyarrow import parquet

    source = ParquetSource(path, FormatMap(), path.name)
    schema = parquet.read_schema(path)
    twice = next((n for n in schema.names if schema.names.count(n) > 1), None)
    if twice is not None:
        places = [str(i) for i, n in enumerate(schema.names, 1) if n == twice]
        raise InputError(
            f'{path.name}: columns {" and ".join(places)} are both called "{twice}", which Parquet does not tell '
            "apart. Give each a name of its own."
        )
    facts = {
        k.decode("utf-8", "replace"): v.decode("utf-8", "replace")
        for k, v in (schema.metadata or {}).items()
        if k not in (b"pandas", b"ARROW:schema")
    }
    columns: list[RawColumn] = []
    unread: list[Unread] = []
    for number, field in enumerate(schema, 1):
        metadata = {
            k.decode("utf-8", "replace"): v.decode("utf-8", "replace") for k, v in (field.metadata or {}).items()
        }
        unit = next((metadata[k] for k in _UNIT_KEYS if k in metadata), None)
        column = ColumnMap(name=field.name)
        clock = pa.types.is_timestamp(field.type) or pa.types.is_duration(field.type) or pa.types.is_time(field.type)
        if pa.types.is_string(field.type) or pa.types.is_large_string(field.type):
            texts = parquet.read_table(path, columns=[field.name]).column(0)
            written = time_format([str(t) for t in texts.slice(0, 200).to_pylist() if t])
            if written is None:
                cells = [(row, (t or "").strip()) for row, t in enumerate(texts.to_pylist(), 1)]
                unread += filter(None, [find_unread(number, field.name, unit, cells, ".")])
                continue
            column, clock = replace(column, time_format=written), True
        try:
            values = source.read([column]).columns[0]
        except InputError:
            continue  # lists and the like are no columns of a recording
        columns.append(
            RawColumn(
                field.name, column, values, None if clock else unit, "metadata of the field" if unit else "", clock
            )
        )
    if not columns:
        return []
    rate = find_rate(facts)
    return [
        RawTable(
            path,
            FormatMap(),
            tuple(columns),
            MappingProxyType(facts),
            ("Parquet, columns by name",),
            rate[0] if rate else None,
            rate[1] if rate else "",
            unread=tuple(unread),
        )
    ]

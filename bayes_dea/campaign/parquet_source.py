"""Parquet recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.tables import Table, missing_column, text_times
from bayes_dea.errors import InputError


class ParquetSource:
    """A Parquet file; columns by name, or by index counted from 1."""

    def __init__(self, path: Path, fmt: FormatMap, label: str) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        self.path, self.fmt, self.label = path, fmt, label
        try:
            self.names = tuple(parquet.read_schema(path).names)
        except (pa.ArrowException, OSError) as exc:
            raise InputError(f"{label}: cannot be read as Parquet; the file was cut or is of another type. "
                             "Copy it again from the recorder.") from exc

    def has(self, column: ColumnMap) -> bool:
        """Whether the file has that column."""
        if column.name is None:
            return column.index is not None and column.index <= len(self.names)
        return column.name in self.names

    def missing(self, own: str, column: ColumnMap) -> InputError:
        """The error for a column that is not there; `own` is what we call it."""
        return missing_column(self.label, own, column, self.names)

    def read(self, columns: Sequence[ColumnMap]) -> Table:
        """The columns as float64; nulls are gaps, timestamps and durations seconds since the first row.

        Raises InputError for missing columns and for text that is no time.
        """
        import pyarrow as pa
        from pyarrow import parquet

        for c in columns:
            if not self.has(c):
                raise self.missing(c.name or "", c)
        wanted = [c.name if c.name is not None else self.names[(c.index or 1) - 1] for c in columns]
        try:
            table = parquet.read_table(self.path, columns=list(dict.fromkeys(wanted)))
        except (pa.ArrowException, OSError) as exc:
            raise InputError(f"{self.label}: cannot be read as Parquet; the file was cut or damaged. Copy it "
                             "again from the recorder.") from exc
        arrays = []
        for name, column in zip(wanted, columns, strict=True):
            kind = table.schema.field(name).type
            if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
                arrays.append(_moments(table.column(name)))
                continue
            if column.time_format is not None and (pa.types.is_string(kind) or pa.types.is_large_string(kind)):
                arrays.append(text_times(table.column(name).to_pylist(), column, self.label, "row"))
                continue
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
                    or pa.types.is_decimal(kind)):
                raise InputError(f'{self.label}, column "{name}": holds {kind}, not numbers. Write it as '
                                 'numbers (time in seconds).')
            arrays.append(np.array(table.column(name).cast(pa.float64()).to_numpy(), dtype=np.float64))
        return Table(tuple(arrays), lambda i: f"row {i + 1}")


def _moments(column: Any) -> NDArray[np.float64]:
    """Timestamps, times of day and durations as seconds since the first one; nan where there is none."""
    import pyarrow as pa

    unit = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
    width = pa.int32() if pa.types.is_time32(column.type) else pa.int64()
    ticks = column.cast(width).combine_chunks()
    gaps = np.asarray(ticks.is_null())
    values = np.asarray(ticks.fill_null(0), dtype=np.int64)
    known = np.flatnonzero(~gaps)
    first = values[known[0]] if known.size else 0
    return np.where(gaps, np.nan, (values - first) / unit)  # differences first: nanoseconds since 1970 need 60 bits

"""Parquet recordings."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.tables import Table, missing_column
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
        """The columns as float64; nulls are gaps. Raises InputError for missing columns and for text."""
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
        for name in wanted:
            kind = table.schema.field(name).type
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
                    or pa.types.is_decimal(kind)):
                raise InputError(f'{self.label}, column "{name}": holds {kind}, not numbers. Write it as '
                                 'numbers (time in seconds).')
            arrays.append(np.array(table.column(name).cast(pa.float64()).to_numpy(), dtype=np.float64))
        return Table(tuple(arrays), lambda i: f"row {i + 1}")

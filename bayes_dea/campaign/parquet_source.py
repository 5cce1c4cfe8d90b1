"""Parquet recordings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.scratch import PIECE, Gathering, Scratch
from bayes_dea.campaign.tables import Table, ambiguous_column, missing_column, text_times
from bayes_dea.errors import InputError


class ParquetSource:
    """A Parquet file; columns by name, or by index counted from 1."""

    def __init__(self, path: Path, fmt: FormatMap, label: str, scratch: Scratch | None = None) -> None:
        import pyarrow as pa
        from pyarrow import parquet

        self.path, self.fmt, self.label = path, fmt, label
        self._scratch = scratch or Scratch()
        try:
            schema = parquet.read_schema(path)
        except (pa.ArrowException, OSError) as exc:
            raise InputError(f"{label}: cannot be read as Parquet; the file was cut or is of another type. "
                             "Copy it again from the recorder.") from exc
        self.names = tuple(schema.names)
        self._types = tuple(schema.types)

    def has(self, column: ColumnMap) -> bool:
        """Whether the file has that column."""
        if column.name is None:
            return column.index is not None and column.index <= len(self.names)
        return column.name in self.names

    def missing(self, own: str, column: ColumnMap) -> InputError:
        """The error for a column that is not there; `own` is what we call it."""
        return missing_column(self.label, own, column, self.names)

    def position(self, column: ColumnMap) -> int:
        """Position (from 0) of a column. Raises InputError where it is missing or ambiguous."""
        if not self.has(column):
            raise self.missing(column.name or "", column)
        if column.name is None:
            return (column.index or 1) - 1
        places = [i + 1 for i, n in enumerate(self.names) if n == column.name]
        if len(places) > 1:
            raise ambiguous_column(self.label, self.fmt, column, column.name, places)
        return places[0] - 1

    def read(self, columns: Sequence[ColumnMap]) -> Table:
        """The columns as float64; nulls are gaps, timestamps and durations seconds since the first row.

        Raises InputError for columns that are missing or ambiguous and for text that is no time.
        """
        wanted = [self.position(c) for c in columns]
        with Gathering(len(columns), self._scratch) as gathered:
            numbers = {}
            for i, (position, column) in enumerate(zip(wanted, columns, strict=True)):
                if not self._is_text_time(position, column):
                    numbers[i] = _converter(self._types[position], self.names[position], self.label)
            times = {i: self._times(wanted[i], columns[i]) for i in range(len(columns)) if i not in numbers}
            rows = 0
            for pieces, count in self._batches(wanted):
                end = rows + count
                gathered.add([numbers[i](piece) if i in numbers else times[i][rows:end]
                              for i, piece in enumerate(pieces)])
                rows = end
            arrays = gathered.columns()
        return Table(tuple(arrays), lambda i: f"row {i + 1}")

    def _is_text_time(self, position: int, column: ColumnMap) -> bool:
        import pyarrow as pa

        kind = self._types[position]
        return column.time_format is not None and (pa.types.is_string(kind) or pa.types.is_large_string(kind))

    def _times(self, position: int, column: ColumnMap) -> NDArray[np.float64]:
        texts = (text for (piece,), _ in self._batches([position]) for text in piece.to_pylist())
        return text_times(texts, column, self.label, "row")

    def _batches(self, positions: Sequence[int]) -> Iterator[tuple[list[Any], int]]:
        """Columns and number of rows, in pieces; a buffer keeps a group of rows from being read whole.

        Arrow takes columns by name, and all of a name: of these the one that is meant is taken by its place.
        """
        import pyarrow as pa
        from pyarrow import parquet

        try:
            with parquet.ParquetFile(self.path, buffer_size=1 << 20) as file:
                names = list(dict.fromkeys(self.names[p] for p in positions))
                for batch in file.iter_batches(PIECE, columns=names, use_threads=False):
                    yield [batch.column(_place(batch, self.names, p)) for p in positions], batch.num_rows
        except MemoryError:  # which Arrow's is, too
            raise
        except (pa.ArrowException, OSError) as exc:
            raise InputError(f"{self.label}: cannot be read as Parquet; the file was cut or damaged. Copy it "
                             "again from the recorder.") from exc


def _place(batch: Any, names: Sequence[str], position: int) -> int:
    """Where in a piece the column stands that has this position in the file."""
    alike = [i for i, name in enumerate(batch.schema.names) if name == names[position]]
    return alike[names[:position].count(names[position])]


def _converter(kind: Any, name: str, label: str) -> Callable[[Any], NDArray[np.float64]]:
    """What makes float64 of the pieces of a column of some type, in their order. Raises InputError for no numbers."""
    import pyarrow as pa

    if pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind):
        return _Moments()
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
            or pa.types.is_decimal(kind)):
        raise InputError(f'{label}, column "{name}": holds {kind}, not numbers. Write it as numbers (time in seconds).')
    return lambda piece: np.asarray(piece.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)


class _Moments:
    """Timestamps, times of day and durations as seconds since the first one; nan where there is none."""

    def __init__(self) -> None:
        self.first: int | None = None

    def __call__(self, column: Any) -> NDArray[np.float64]:
        import pyarrow as pa

        unit = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[column.type.unit]
        width = pa.int32() if pa.types.is_time32(column.type) else pa.int64()
        ticks = column.cast(width)
        gaps = np.asarray(ticks.is_null())
        values = np.asarray(ticks.fill_null(0), dtype=np.int64)
        known = np.flatnonzero(~gaps)
        if self.first is None and known.size:
            self.first = int(values[known[0]])
        # differences first: nanoseconds since 1970 need 60 bits
        return np.where(gaps, np.nan, (values - (self.first or 0)) / unit)

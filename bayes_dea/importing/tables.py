"""What a look into a file yields: named columns of numbers, and the words around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RawColumn:
    """One column of numbers as it stands in the file.

    `label` is what a person would call it, and no other column of its table; `source` how a format map reaches it,
    `values` (n,) its numbers in the file's unit (time as text: seconds since the first row). `unit` is the text of a
    unit found beside the name. `heading` is the name alone where the label says the place as well.
    """

    label: str
    source: ColumnMap
    values: Array
    unit: str | None = None
    unit_from: str = ""
    clock: bool = False  # time as text or time stamp: already seconds
    heading: str | None = None

    @property
    def name(self) -> str:
        """The name as it stands in the file, perhaps above several columns."""
        return self.label if self.heading is None else self.heading


def distinct(columns: Sequence[RawColumn]) -> tuple[RawColumn, ...]:
    """The columns, where several have one label each with its place: "Voltage (V) in column 3"."""
    labels = [c.label for c in columns]
    return tuple(
        replace(c, label=f"{c.label} in {_place(c)}", heading=c.label) if labels.count(c.label) > 1 else c
        for c in columns
    )


def _place(column: RawColumn) -> str:
    return column.source.describe() if column.source.name is None else column.source.name


@dataclass(frozen=True)
class Unread:
    """A column named like a quantity whose figures cannot all be read as numbers: `row` and `cell` of the first that
    cannot, `remedy` says what to write instead.
    """

    number: int  # from 1
    label: str
    quantity: str
    row: int
    cell: str
    remedy: str


@dataclass(frozen=True)
class RawTable:
    """Columns of one length out of one file, and how the file is read.

    `facts` are words and numbers beside the columns (header block, attributes, scalars). `notes` say why the file is
    read as it is. `rate_Hz` is a sampling rate that the file states. `unread` are columns that are no text and yet not
    among `columns`.
    """

    path: Path
    format: FormatMap
    columns: tuple[RawColumn, ...]
    facts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()
    rate_Hz: float | None = None
    rate_from: str = ""
    part: str = ""  # which struct or group of the file
    unread: tuple[Unread, ...] = ()

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self.path.name}:{self.part}" if self.part else self.path.name

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.columns[0].values.size) if self.columns else 0

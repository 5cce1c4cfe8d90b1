"""What a look into a file yields: named columns of numbers, and the words around them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RawColumn:
    """One column of numbers as it stands in the file.

    `label` is what a person would call it, `source` how a format map reaches it, `values` (n,) its numbers in the
    file's unit (time as text: seconds since the first row). `unit` is the text of a unit found beside the name.
    """

    label: str
    source: ColumnMap
    values: Array
    unit: str | None = None
    unit_from: str = ""
    clock: bool = False  # time as text or time stamp: already seconds


@dataclass(frozen=True)
class RawTable:
    """Columns of one length out of one file, and how the file is read.

    `facts` are words and numbers beside the columns (header block, attributes, scalars). `notes` say why the file is
    read as it is. `rate_Hz` is a sampling rate that the file states.
    """

    path: Path
    format: FormatMap
    columns: tuple[RawColumn, ...]
    facts: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    notes: tuple[str, ...] = ()
    rate_Hz: float | None = None
    rate_from: str = ""
    part: str = ""  # which struct or group of the file

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self.path.name}:{self.part}" if self.part else self.path.name

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.columns[0].values.size) if self.columns else 0

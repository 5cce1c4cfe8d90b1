"""What `predict` gives back: columns, warnings, and the three files that it leaves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..results import write_atomic, write_json
from .bands import LEVELS, Bands

TABLE_FILE = "prediction.csv"
SUMMARY_FILE = "prediction.json"
PAGE_FILE = "report.html"
COMMAND_FILE = "command.csv"

#: rows written at once
_ROWS = 65_536

Array = NDArray[np.float64]
#: called with (phase, done, of, text)
Tell = Callable[[str, float, float, str], None]


@dataclass(frozen=True)
class Unmet:
    """An interval in which a wanted stroke is not reached. miss_m: largest |predicted - wanted| in it."""

    t_start_s: float
    t_end_s: float
    why: str
    miss_m: float


@dataclass(frozen=True)
class SignalPrediction:
    """The answer to a command. Arrays (n,) in SI units; `summary` is prediction.json.

    `bands.parameters`: quantiles of the displacement (or force) itself. `bands.reading`: quantiles of one reading of
    the sensor, with gain, offset and noise. `wanted` (n,) m where a stroke was asked for, and where it is `unmet`.
    """

    channel: str  # displacement or force
    unit: str
    input: str  # voltage_V or position_m
    time_s: Array = field(repr=False)
    values: Array = field(repr=False)  # of the input
    bands: Bands = field(repr=False)
    summary: dict[str, Any] = field(repr=False)
    wanted: Array | None = field(repr=False, default=None)
    unmet: tuple[Unmet, ...] = field(repr=False, default=())

    @property
    def mean(self) -> Array:
        """Posterior mean of the displacement (m) or force (N)."""
        return self.bands.mean

    @property
    def warnings(self) -> list[str]:
        """Texts a person can act on."""
        return list(self.summary["warnings"])

    @property
    def columns(self) -> dict[str, Array]:
        """Columns of prediction.csv by name."""
        c, u = self.channel, self.unit
        out = {"time_s": self.time_s, self.input: self.values}
        if self.wanted is not None:
            out[f"wanted_{c}_{u}"] = self.wanted
        out[f"{c}_mean_{u}"] = self.mean
        for level, row in zip(LEVELS, self.bands.parameters, strict=True):
            out[f"{c}_q{round(100 * level):02d}_{u}"] = row
        for level, row in zip(LEVELS, self.bands.reading if self.bands.reading is not None else (), strict=False):
            out[f"reading_q{round(100 * level):02d}_{u}"] = row
        return out

    def save(self, out: str | Path, report: bool = True, tell: Tell | None = None) -> Path:
        """Write prediction.csv, prediction.json, report.html and, where a stroke was wanted, command.csv.

        tell: called with (phase, done, of, text) as rows are written and pictures drawn.
        """
        folder = Path(out)
        say = tell or (lambda *_: None)
        columns = self.columns
        # a picometre, a nanonewton: finer digits are noise and cost half the file
        digits = {"m": 12, "N": 9}[self.unit]
        if self.wanted is not None:
            table = {"time_s": self.time_s, self.input: self.values}
            write_table(folder / COMMAND_FILE, table, lambda done, of: say("writing", done, of, COMMAND_FILE))
        table = {k: v if k in ("time_s", self.input) else np.round(v, digits) for k, v in columns.items()}
        write_table(folder / TABLE_FILE, table, lambda done, of: say("writing", done, of, TABLE_FILE))
        write_json(folder / SUMMARY_FILE, self.summary)
        if report:
            from ..report.prediction_page import PredictionView, write_prediction_page

            view = PredictionView(self.summary, columns, self.channel, self.unit, self.input)
            write_prediction_page(folder / PAGE_FILE, view, lambda *at: say("drawing the page", *at))
        return folder


def write_table(
    path: Path, columns: Mapping[str, Array], report: Callable[[int, int], None] = lambda done, of: None
) -> None:
    """Columns (n,) as CSV with a header, atomically; numbers with the shortest text that reads back the same.

    report: called with (rows written, of how many).
    """
    import pyarrow as pa
    from pyarrow import csv as pa_csv

    def write(temporary: Path) -> None:
        table = pa.table({k: pa.array(np.ascontiguousarray(v)) for k, v in columns.items()})
        options = pa_csv.WriteOptions(include_header=False, quoting_style="none")
        with temporary.open("wb") as sink:
            sink.write((",".join(columns) + "\n").encode())  # pyarrow would put the names in quotation marks
            for start in range(0, table.num_rows, _ROWS):
                pa_csv.write_csv(table.slice(start, _ROWS), sink, write_options=options)
                report(min(start + _ROWS, table.num_rows), table.num_rows)

    write_atomic(path, write)

"""The page of a prediction, drawn again from its files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..results import read_json
from .result import PAGE_FILE, SUMMARY_FILE, TABLE_FILE

#: called with (done, of, text)
Report = Callable[[float, float, str], None]


def redraw_prediction_page(folder: Path, report: Report | None = None) -> Path:
    """Draw report.html again from prediction.json and prediction.csv in a folder.

    Raises InputError where one of them is not there, or is none of ours.
    """
    from ..report.own_page import write_page
    from ..report.prediction_page import PredictionView, render

    table = folder / TABLE_FILE
    if not table.is_file():
        raise InputError(f"{table}: there is no such file; run predict again")
    try:
        summary = read_json(folder / SUMMARY_FILE)
        with table.open(encoding="utf-8") as lines:
            names = lines.readline().strip().split(",")
            values = np.loadtxt(lines, delimiter=",", ndmin=2)
        columns = dict(zip(names, values.T, strict=True))
        view = PredictionView(summary, columns, summary["channel"], summary["unit"], summary["input"])
        html = render(view, report)
    except (ValueError, KeyError) as error:
        raise InputError(f"{folder}: {SUMMARY_FILE} and {TABLE_FILE} are not a whole prediction ({error}); run predict "
                         "again") from error
    return write_page(folder / PAGE_FILE, "prediction", html)

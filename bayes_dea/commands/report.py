"""`bayes-dea report`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from .options import QuietOption, tell_of, writing
from .progress import progress

EXAMPLE = "Example: bayes-dea report out"


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of calibrate, diagnose, compare, next, "
                                            "live, paper or predict.")],
    static: Annotated[bool, typer.Option("--static", help="Pictures alone, no script: small enough to keep in a "
                                         "repository.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Draw report.html again from the JSON and data in a folder.

    Where several verbs wrote into it, report.html shows the last one's result, and the
    pages of the others stand beside it (calibration.html, diagnosis.html, ...).
    """
    from ..errors import InputError
    from ..prediction.redraw import redraw_prediction_page
    from ..report.comparison_page import write_comparison_page
    from ..report.diagnosis_page import write_diagnosis_page
    from ..report.live_page import write_live_page
    from ..report.next_page import write_next_page
    from ..report.own_page import REPORT_FILE, shown
    from ..report.page import write_report
    from ..report.paper_page import write_paper_page
    from ..store import load_posterior

    pages: dict[str, Callable[[Callable[[float, float, str], None]], Path]] = {
        "calibration.json": lambda say: write_report(folder, interactive=not static, report=say),
        "diagnosis.json": lambda say: write_diagnosis_page(folder, say),
        "comparison.json": lambda say: write_comparison_page(folder, say),
        "next.json": lambda say: write_next_page(folder, say),
        "paper.json": lambda say: write_paper_page(folder, say),
        "prediction.json": lambda say: redraw_prediction_page(folder, say),
        "live.json": lambda say: write_live_page(folder, say),
    }
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the --out of an earlier run")
    kinds = [name for name in pages if (folder / name).is_file()]
    if not kinds:
        raise InputError(f"{folder}: holds no result to draw ({', '.join(pages)}); give the --out of an earlier run")
    # that of the last verb is drawn last: each page puts the one before it aside, under its own name
    last = f"{shown(folder / REPORT_FILE)}.json"
    kinds.sort(key=lambda name: (name == last, (folder / name).stat().st_mtime_ns))
    with progress(quiet) as say:
        def drawn(done: float, of: float, text: str) -> None:
            say("drawing the page", done, of, text)

        drawn(0, 1, "")
        if "calibration.json" in kinds:
            load_posterior(folder)
        with writing(folder):
            page = [pages[kind](drawn) for kind in kinds][-1]
    if not quiet:
        tell_of(page)

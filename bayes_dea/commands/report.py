"""`bayes-dea report`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from .options import QuietOption, writing
from .progress import progress

EXAMPLE = "Example: bayes-dea report out"


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of calibrate, diagnose, compare, next, "
                                            "live, paper or predict.")],
    static: Annotated[bool, typer.Option("--static", help="Pictures alone, no script: small enough to keep in a "
                                         "repository.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Draw report.html again from the JSON and data in a folder."""
    from ..errors import InputError
    from ..prediction.redraw import redraw_prediction_page
    from ..report.comparison_page import write_comparison_page
    from ..report.diagnosis_page import write_diagnosis_page
    from ..report.live_page import write_live_page
    from ..report.next_page import write_next_page
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
    kind = next((name for name in pages if (folder / name).is_file()), None)
    if kind is None:
        raise InputError(f"{folder}: holds no result to draw ({', '.join(pages)}); give the --out of an earlier run")
    with progress(quiet) as say:
        def drawn(done: float, of: float, text: str) -> None:
            say("drawing the page", done, of, text)

        drawn(0, 1, "")
        if kind == "calibration.json":
            load_posterior(folder)
        with writing(folder):
            page = pages[kind](drawn)
    if not quiet:
        typer.echo(f"Report: {page}")

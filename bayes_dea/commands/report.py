"""`bayes-dea report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import QuietOption, writing
from .progress import progress

EXAMPLE = "Example: bayes-dea report out"


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of calibrate, diagnose, compare or next.")],
    static: Annotated[bool, typer.Option("--static", help="Pictures alone, no script: small enough to keep in a "
                                         "repository.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Draw report.html again from the JSON and data in a folder."""
    from ..report.comparison_page import write_comparison_page
    from ..report.diagnosis_page import write_diagnosis_page
    from ..report.next_page import write_next_page
    from ..report.page import write_report
    from ..store import load_posterior

    calibrated = (folder / "calibration.json").is_file()
    diagnosis = (folder / "diagnosis.json").is_file() and not calibrated
    comparison = (folder / "comparison.json").is_file() and not calibrated and not diagnosis
    proposals = (folder / "next.json").is_file() and not calibrated and not diagnosis and not comparison
    with progress(quiet) as say:
        def drawn(done: float, of: float, text: str) -> None:
            say("drawing the page", done, of, text)

        drawn(0, 1, "")
        if not (diagnosis or comparison or proposals):
            load_posterior(folder)
        with writing(folder):
            if diagnosis:
                page = write_diagnosis_page(folder, drawn)
            elif comparison:
                page = write_comparison_page(folder)
            elif proposals:
                page = write_next_page(folder)
            else:
                page = write_report(folder, interactive=not static, report=drawn)
    if not quiet:
        typer.echo(f"Report: {page}")

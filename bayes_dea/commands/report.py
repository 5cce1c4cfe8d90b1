"""`bayes-dea report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import QuietOption

EXAMPLE = "Example: bayes-dea report out"


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a calibration or a diagnosis.")],
    static: Annotated[bool, typer.Option("--static", help="Pictures alone, no script: small enough to keep in a "
                                         "repository.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Draw report.html again from the JSON and data in a folder."""
    from ..report.diagnosis_page import write_diagnosis_page
    from ..report.page import write_report
    from ..store import load_posterior

    if (folder / "diagnosis.json").is_file() and not (folder / "calibration.json").is_file():
        page = write_diagnosis_page(folder)
    else:
        load_posterior(folder)
        page = write_report(folder, interactive=not static)
    if not quiet:
        typer.echo(f"Report: {page}")

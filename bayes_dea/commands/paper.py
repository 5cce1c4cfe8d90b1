"""`bayes-dea paper`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import (
    AnewOption,
    JsonOption,
    OutOption,
    QuietOption,
    ResumeOption,
    SeedOption,
    WorkersOption,
    conclude,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea paper --out paper"


def paper(
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    sections: Annotated[str, typer.Option(metavar="NAME,NAME,...", help="Parts of the paper, e.g. static,creep; by "
                                          "default all.")] = "",
    resume: ResumeOption = False,
    anew: AnewOption = False,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Redo the reference paper: its tables, figures and conclusions beside ours.

    No raw recording of it is public. Recordings are reconstructed from the printed
    parameters, and played through the paper's procedures and through ours. Leaves
    paper.json and report.html in --out, which reads like a companion to the paper.

    Each part is kept as it is finished; interrupted, the same command goes on to the
    same numbers. Three to five minutes on two processors, a part on each.
    """
    from ..errors import InputError
    from ..paper.run import PaperSettings, chosen, redo_paper
    from ..paper.store import PAPER_FILE, REPORT_FILE, save_paper, terminal_summary
    from ..run_state import finished

    if resume and anew:
        raise InputError("--resume and --anew: give one of them")
    settings = PaperSettings(threads(workers), tuple(n.strip() for n in sections.split(",") if n.strip()))
    chosen(settings.sections)  # a wrong name is said before a folder is made
    with progress(quiet) as report, writing(out):
        result = redo_paper(out, seed, settings, report, anew)
        result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
        report("drawing the page", 0, 1, str(out))
        save_paper(result, out, lambda *at: report("drawing the page", *at))
        finished(out)
    conclude(quiet, json_output, out / PAPER_FILE, terminal_summary(result.summary), out / REPORT_FILE)

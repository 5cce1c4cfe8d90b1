"""`bayes-dea diagnose`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import (
    JsonOption,
    OutOption,
    QuietOption,
    SeedOption,
    WorkersOption,
    conclude,
    folder,
    overrides,
    threads,
    writable,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea diagnose quickstart --model hooke+gm3 --out out"


def diagnose(
    campaign: Annotated[list[Path], typer.Argument(metavar="CAMPAIGN", help="Folder with campaign.toml; several: "
                                                   "one campaign, a specimen each.")],
    model: Annotated[str, typer.Option(metavar="SPEC", help="Structure to be doubted, e.g. hooke+gm3; effects that "
                                       "are known to be there are joined with +.")],
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    prior: Annotated[list[str] | None, typer.Option(metavar="TEXT", help="Override a prior, as in calibrate.")] = None,
    priors: Annotated[Path | None, typer.Option(metavar="FILE", help="File with priors that replace the default "
                                                "ones.")] = None,
    data_root: Annotated[Path | None, folder(help="Folder where recordings may lie besides the campaign.")] = None,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where model and recordings differ, and which physics was left out.

    Names the physics (or says "none" or "unknown"), models it, and proves the gain on
    the recordings with role "validate". Leaves diagnosis.json and report.html in --out.
    """
    from ..campaign import load_campaign
    from ..mismatch.diagnosis import DiagnosisSettings
    from ..mismatch.diagnosis import diagnose as run
    from ..mismatch.store import DIAGNOSIS_FILE, REPORT_FILE, save_diagnosis, terminal_summary
    from ..models.model import build_model

    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        given = overrides(prior, priors)
        structure = build_model(model, given)
        loaded = load_campaign(campaign, data_root)
        writable(out)
        result = run(loaded, structure, seed, DiagnosisSettings(workers=threads(workers)), report=report, priors=given)
        result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
        report("writing the report", 0, 1, str(out))
        save_diagnosis(result, out)
    conclude(quiet, json_output, out / DIAGNOSIS_FILE, terminal_summary(result.summary), out / REPORT_FILE)

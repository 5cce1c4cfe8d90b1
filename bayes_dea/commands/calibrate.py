"""`bayes-dea calibrate`."""

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
    begin,
    conclude,
    count,
    folder,
    overrides,
    seconds,
    threads,
    writable,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea calibrate quickstart --model hooke+gm3 --out out"


def calibrate(
    campaign: Annotated[list[Path], typer.Argument(metavar="CAMPAIGN", help="Folder with campaign.toml; several: "
                                                   "one campaign, a specimen each.")],
    model: Annotated[str, typer.Option(metavar="SPEC", help="Structure: static law + network, e.g. hooke+gm3, "
                                       "yeoh+gkv2, hooke+gkm3, pz3, ss3.")],
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    prior: Annotated[list[str] | None, typer.Option(metavar="TEXT", help="Override a prior: 'Y_Pa=lognormal(1.2e6, "
                                                    "0.3)', or fix: 'Y_Pa=1.2e6'. May be given several times.")] = None,
    priors: Annotated[Path | None, typer.Option(metavar="FILE", help="File with priors that replace the default "
                                                "ones (see priors/README.md).")] = None,
    data_root: Annotated[Path | None, folder(help="Folder where recordings may lie besides the campaign.")] = None,
    walkers: Annotated[int, count(help="Walkers of each ensemble.", min=8)] = 32,
    max_steps: Annotated[int, count(help="Steps after which sampling stops, converged or not.", min=200)] = 20_000,
    max_seconds: Annotated[float | None, seconds(help="The same in seconds of sampling.", min=0.0)] = None,
    checkpoint_seconds: Annotated[float, seconds(help="Sampling that an interrupted run may lose.", min=0.0)] = 10.0,
    resume: ResumeOption = False,
    anew: AnewOption = False,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Fit a model to the recordings with role "identify" and predict all of them.

    Leaves calibration.json, posterior.nc (ArviZ) and report.html in --out.

    Interrupted, the same command with --resume goes on to the same numbers.
    """
    import warnings
    from dataclasses import replace

    from ..calibration import CalibrationSettings
    from ..calibration import calibrate as run
    from ..campaign import load_campaign
    from ..errors import NotConvergedWarning
    from ..models.model import build_model
    from ..report.summary import terminal_summary
    from ..run_state import checkpoint_for, finished
    from ..store import CALIBRATION_FILE, REPORT_FILE

    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        structure = build_model(model, overrides(prior, priors))
        loaded = load_campaign(campaign, data_root, report=lambda *at: report("reading recordings", *at))
        settings = CalibrationSettings(walkers=walkers, workers=threads(workers))
        settings = replace(settings, sampler=replace(settings.sampler, max_steps=max_steps, max_seconds=max_seconds,
                                                     checkpoint_seconds=checkpoint_seconds))
        writable(out)
        checkpoint = checkpoint_for(out, {"model": structure.name, "seed": seed, "walkers": walkers,
                                          "priors": {p.name: str(p.prior) for p in structure.parameters},
                                          "inputs": [i["sha256"] for i in loaded.inputs]})
        begin(checkpoint, resume, anew)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotConvergedWarning)  # the summary says so
            result = run(loaded, structure, seed, settings, report=report, checkpoint=checkpoint)
        result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
        report("writing the report", 0, 1, str(out))
        result.save(out)
        finished(out, keep=None if result.converged else checkpoint)
    conclude(quiet, json_output, out / CALIBRATION_FILE, terminal_summary(result.summary), out / REPORT_FILE)

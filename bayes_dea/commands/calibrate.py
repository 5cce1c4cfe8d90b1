"""`bayes-dea calibrate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from .options import (
    MEMORY_MB,
    AnewOption,
    CampaignArgument,
    DataRootOption,
    JsonOption,
    MemoryOption,
    ModelOption,
    OutOption,
    PriorOption,
    PriorsOption,
    QuietOption,
    ResumeOption,
    ScratchOption,
    SeedOption,
    WorkersOption,
    begin,
    conclude,
    count,
    overrides,
    room,
    seconds,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea calibrate quickstart --model hooke+gm3 --out out"


def calibrate(
    campaign: CampaignArgument,
    model: ModelOption,
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    prior: PriorOption = None,
    priors: PriorsOption = None,
    data_root: DataRootOption = None,
    memory: MemoryOption = MEMORY_MB,
    scratch: ScratchOption = None,
    walkers: Annotated[int, count(help="Walkers of each ensemble; three a parameter at least.", min=8)] = 32,
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
    from ..store import CALIBRATION_FILE, REPORT_FILE, save_calibration

    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        structure = build_model(model, overrides(prior, priors))
        loaded = load_campaign(campaign, data_root, report=lambda *at: report("reading recordings", *at),
                               scratch=room(memory, scratch))
        settings = CalibrationSettings(walkers=walkers, workers=threads(workers))
        settings = replace(settings, sampler=replace(settings.sampler, max_steps=max_steps, max_seconds=max_seconds,
                                                     checkpoint_seconds=checkpoint_seconds))
        with writing(out):
            checkpoint = checkpoint_for(out, {"model": structure.name, "seed": seed, "walkers": walkers,
                                              "priors": {p.name: repr(p.prior) for p in structure.parameters},
                                              "inputs": [i["sha256"] for i in loaded.inputs]})
            begin(checkpoint, resume, anew)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NotConvergedWarning)  # the summary says so
                result = run(loaded, structure, seed, settings, report=report, checkpoint=checkpoint)
            result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
            report("writing results", 0, 1, str(out))
            save_calibration(result, out, report=False, tell=lambda *at: report("writing results", *at))
            from ..report.page import write_report  # matplotlib, after the work

            write_report(out, report=lambda *at: report("drawing the page", *at))
            finished(out, own=[checkpoint] if result.converged else [])  # a longer run goes on from it
    conclude(quiet, json_output, out / CALIBRATION_FILE, terminal_summary(result.summary), out / REPORT_FILE)

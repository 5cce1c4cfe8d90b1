"""`bayes-dea compare`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import (
    MEMORY_MB,
    AnewOption,
    CampaignArgument,
    DataRootOption,
    JsonOption,
    MemoryOption,
    OutOption,
    PriorOption,
    PriorsOption,
    QuietOption,
    ResumeOption,
    ScratchOption,
    SeedOption,
    WorkersOption,
    conclude,
    named,
    overrides,
    prior_words,
    room,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea compare quickstart --models hooke+gm1..6,hooke+gkm3,yeoh+gm3 --out out"


def compare(
    campaign: CampaignArgument,
    models: Annotated[str, typer.Option(metavar="SPEC,SPEC,...", help="Structures, e.g. hooke+gm3,hooke+gkm3,pz3. "
                                        "hooke+gm1..6 stands for six of them, hooke+gm for all that there are; "
                                        "'all': every static law and network.")],
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    prior: PriorOption = None,
    priors: PriorsOption = None,
    data_root: DataRootOption = None,
    memory: MemoryOption = MEMORY_MB,
    scratch: ScratchOption = None,
    resume: ResumeOption = False,
    anew: AnewOption = False,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find which model structure the recordings support, by evidence and by prediction.

    Evidence: how probable each structure makes the recordings. Prediction: how well it
    foretells recordings that were left out. Names that are one and the same function
    are recognised and ranked once. Leaves comparison.json and report.html in --out.

    Interrupted, the same command with --resume goes on to the same numbers.
    """
    from ..campaign import load_campaign
    from ..comparison.names import expand
    from ..comparison.run import ComparisonSettings, built_models
    from ..comparison.run import compare as run
    from ..comparison.store import COMPARISON_FILE, REPORT_FILE, terminal_summary
    from ..errors import InputError
    from ..report.comparison_page import write_comparison_page
    from ..results import write_json
    from ..run_state import Checkpoints, finished

    if resume and anew:
        raise InputError("--resume and --anew: give one of them")
    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        given = overrides(prior, priors)
        built = built_models(expand(models), given)  # a wrong name is said before minutes of reading
        loaded = load_campaign(campaign, data_root, report=lambda *at: report("reading recordings", *at),
                               scratch=room(memory, scratch))
        settings = ComparisonSettings(workers=threads(workers))
        with writing(out):
            checkpoints = Checkpoints(out)
            again = named(campaign, data_root)
            if all(set(given) <= {p.name for p in m.parameters} for m in built.values()):
                again += prior_words(prior, priors)
            result = run(loaded, models, seed, settings, given, report, checkpoints, anew, again)
            result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
            report("drawing the page", 0, 1, str(out))
            write_json(out / COMPARISON_FILE, result.summary)
            write_comparison_page(out, lambda *at: report("drawing the page", *at))
            finished(out, checkpoints.own)
    conclude(quiet, json_output, out / COMPARISON_FILE, terminal_summary(result.summary), out / REPORT_FILE)

"""`bayes-dea next`."""

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
    count,
    name,
    number,
    overrides,
    room,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea next quickstart --from out --plan 3 --out next"


def next_(
    campaign: CampaignArgument,
    purpose: Annotated[str, typer.Option("--for", metavar="WHAT", help="parameters: of --model; models: which of "
                                         "--models is right; diagnosis: which explanation that a diagnosis left.")]
    = "parameters",
    model: Annotated[str | None, name(help="Structure, e.g. hooke+gm3.")] = None,
    models: Annotated[str | None, typer.Option(metavar="SPEC,SPEC,...", help="Structures to tell apart.")] = None,
    source: Annotated[Path | None, typer.Option("--from", metavar="DIR", help="The --out of an earlier calibrate, "
                                                "compare or diagnose of this campaign: nothing is fitted again that "
                                                "it holds.")] = None,
    plan: Annotated[int, count(help="Experiments in a row, each chosen after those before it.", min=1, max=20)] = 1,
    costs: Annotated[Path | None, typer.Option(metavar="FILE", help="What bench time costs (TOML); next/costs.toml in "
                                               "--out is one to begin with.")] = None,
    max_voltage: Annotated[float | None, number(help="Largest voltage to propose (V), below the actuator's.")] = None,
    max_frequency: Annotated[float | None, number(help="Largest frequency to propose (Hz).")] = None,
    files: Annotated[int, count(help="Proposals that get a command file, beside the best of each kind.", min=1,
                                max=1000)] = 10,
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
    """Rank the experiments that could be done next by what they teach per bench hour.

    Protocols of the menu with their settings optimised, within the limits of the
    actuator, each with its expected information gain, its error and its cost. Between
    models or explanations those come first that tell at least half of what the best one
    tells. Leaves next.json, report.html and a command file of each proposal under next/
    in --out.

    Interrupted, the same command with --resume goes on to the same numbers.
    """
    from ..campaign import load_campaign
    from ..design.propose import ProposalSettings, check_request
    from ..design.propose import propose as run
    from ..design.store import NEXT_FILE, REPORT_FILE, terminal_summary
    from ..errors import InputError
    from ..experiments.costs import Costs, read_costs
    from ..report.next_page import write_next_page
    from ..run_state import Checkpoints, finished

    if resume and anew:
        raise InputError("--resume and --anew: give one of them")
    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        given = overrides(prior, priors)
        settings = ProposalSettings(
            workers=threads(workers), plan=plan, files=files, max_voltage_V=max_voltage,
            max_frequency_Hz=max_frequency, costs=Costs() if costs is None else read_costs(costs),
        )  # fmt: skip
        # what cannot be asked is said before minutes of reading
        check_request(purpose, model, models, source, settings)
        if source is not None and source.resolve() == out.resolve():
            raise InputError(f"--out {out}: is the folder that --from reads, whose report.html would be lost; choose "
                             "another folder")
        loaded = load_campaign(campaign, data_root, report=lambda *at: report("reading recordings", *at),
                               scratch=room(memory, scratch))
        with writing(out):
            checkpoints = Checkpoints(out)
            result = run(loaded, purpose, model, models, source, seed, settings, given, report, checkpoints, anew)
            result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
            report("drawing the page", 0, 1, str(out))
            result.save(out, report=False)
            write_next_page(out, lambda *at: report("drawing the page", *at))
            finished(out, checkpoints.own)
    conclude(quiet, json_output, out / NEXT_FILE, terminal_summary(result.summary), out / REPORT_FILE)

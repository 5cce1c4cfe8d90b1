"""`bayes-dea diagnose`."""

from __future__ import annotations

import sys
from pathlib import Path

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
    named,
    one_of_them,
    overrides,
    room,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea diagnose quickstart --model hooke+gm3 --out out"


def diagnose(
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
    resume: ResumeOption = False,
    anew: AnewOption = False,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find where model and recordings differ, and which physics was left out.

    Names the physics (or says "none" or "unknown"), models it, and proves the gain on
    the recordings with role "validate". Leaves diagnosis.json and report.html in --out.

    Interrupted, the same command with --resume goes on to the same numbers.
    """
    from ..campaign import load_campaign
    from ..mismatch.diagnosis import DiagnosisSettings
    from ..mismatch.diagnosis import diagnose as run
    from ..mismatch.go_on import calibrate_command
    from ..mismatch.search.hypotheses import parted
    from ..mismatch.store import DIAGNOSIS_FILE, REPORT_FILE, save_diagnosis, terminal_summary
    from ..models.model import build_model
    from ..run_state import checkpoint_for, finished

    one_of_them(resume, anew)
    with progress(quiet) as report:
        report("reading recordings", 0, 1, "")
        given = overrides(prior, priors)
        own, further = parted(model, given)
        structure = build_model(model, own)
        loaded = load_campaign(campaign, data_root, report=lambda *at: report("reading recordings", *at),
                               scratch=room(memory, scratch))
        with writing(out):
            settings = DiagnosisSettings(workers=threads(workers))
            identity = {"verb": "diagnose", "model": structure.name, "seed": seed,
                        "priors": {p.name: repr(p.prior) for p in structure.parameters},
                        "given": {name: str(value) for name, value in given.items()},
                        "inputs": [i["sha256"] for i in loaded.inputs]}
            checkpoint = checkpoint_for(out, identity).with_suffix(".jsonl")
            begin(checkpoint, resume, anew)
            result = run(loaded, structure, seed, settings, report=report, priors=further, checkpoint=checkpoint)
            result.summary["meta"] = dict(loaded.meta)
            result.summary["next_command"] = calibrate_command(result.summary, named(campaign, data_root), priors)
            result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
            report("drawing the page", 0, 1, str(out))
            save_diagnosis(result, out, lambda *at: report("drawing the page", *at))
            finished(out, own=[checkpoint])
    conclude(quiet, json_output, out / DIAGNOSIS_FILE, terminal_summary(result.summary), out / REPORT_FILE)

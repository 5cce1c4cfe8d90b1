"""`bayes-dea predict`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import (
    JsonOption,
    QuietOption,
    SeedOption,
    WorkersOption,
    conclude,
    count,
    folder,
    name,
    threads,
    writing,
)
from .progress import progress

EXAMPLE = "Example: bayes-dea predict out --signal command.csv --out out/prediction"


def predict(
    calibration: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a calibration.")],
    signal: Annotated[Path | None, typer.Option(metavar="FILE", help="Command: time_s and voltage_V (or "
                                                "position_m: the force is predicted).")] = None,
    wanted: Annotated[Path | None, typer.Option(metavar="FILE", help="Wanted stroke: time_s and displacement_m; "
                                                "the command for it is found.")] = None,
    out: Annotated[Path | None, folder(help="Folder for the results; by default DIR/prediction.")] = None,
    draws: Annotated[int | None, count(help="Posterior draws for the bands; by default 200.", min=1)] = None,
    specimen: Annotated[str | None, name(help="Which one, where several were calibrated.")] = None,
    zeroed: Annotated[bool, typer.Option("--zeroed", help="The sensor will be zeroed just before: the band of "
                                         "readings is narrower.")] = False,
    data_root: Annotated[Path | None, folder(help="Folder where FILE may lie as well.")] = None,
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """The answer to a command, with bands; or the command for a wanted stroke.

    Leaves prediction.csv (bands at every row), prediction.json and report.html
    in --out. With --wanted also command.csv, which keeps to max_voltage_V and
    max_frequency_Hz of the actuator and is itself a valid --signal.
    """
    from ..errors import InputError
    from ..prediction.answer import predict as answer
    from ..prediction.command import command_for
    from ..prediction.result import COMMAND_FILE, PAGE_FILE, SUMMARY_FILE
    from ..report.prediction_page import terminal_summary

    if (signal is None) == (wanted is None):
        raise InputError("give either --signal FILE (a command) or --wanted FILE (a stroke), one of the two")
    target = out or calibration / "prediction"
    if target.resolve() == calibration.resolve():
        raise InputError(f"--out {target}: is the calibration's own folder, whose report.html would be lost; choose "
                         "another")
    with progress(quiet) as report:
        options = {"draws": draws, "seed": seed, "specimen": specimen, "zeroed": zeroed, "data_root": data_root,
                   "workers": threads(workers), "report": report}
        given = signal if signal is not None else wanted
        assert given is not None
        result = (answer if signal is not None else command_for)(calibration, given, **options)  # type: ignore[arg-type]
        result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
        report("writing", 0, 1, str(target))
        with writing(target):
            result.save(target, tell=report)
    text = terminal_summary(result.summary)
    if wanted is not None:
        text += f"\n\nCommand: {target / COMMAND_FILE}"
    conclude(quiet, json_output, target / SUMMARY_FILE, text, target / PAGE_FILE)

"""`bayes-dea export`."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Annotated

import typer

from .options import JsonOption, QuietOption, count, folder, name, number, writing
from .options import seconds as duration

EXAMPLE = "Example: bayes-dea export out --to matlab --sample-time 0.001"


def export(
    calibration: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of a calibration.")],
    to: Annotated[str, typer.Option(metavar="FORMAT", help="matlab (model.mat), control (model.npz) or csv "
                                    "(model.csv).")],
    out: Annotated[Path | None, folder(help="Folder for the file; by default DIR itself.")] = None,
    sample_time: Annotated[float | None, duration(help="Sample time of the discrete system; by default that of the "
                                                  "recordings.")] = None,
    draws: Annotated[int | None, count(help="Posterior draws to export; by default 100.", min=0)] = None,
    hold: Annotated[str | None, name(help="Input between samples: end, start, or zoh (as c2d); by default as in the "
                                     "campaign.")] = None,
    at_voltage: Annotated[float | None, number(help="Small changes of V around this voltage (V) instead of V^2; for "
                                               "laws that are not linear.")] = None,
    specimen: Annotated[str | None, name(help="Which one, where several were calibrated.")] = None,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """The calibrated model as state space: MAP, mean and posterior draws.

    Continuous and discrete; the input is u = V^2, the output the displacement
    in m. In Python: bd.load_state_space('out/model.npz'). In MATLAB:

    m = load('model.mat'); sys = ss(m.map.A, m.map.B, m.map.C, m.map.D)
    """
    from ..export.write import SUMMARY_FILE, export_state_space
    from ..prediction.calibrated import open_calibration
    from ..results import read_json

    source = open_calibration(calibration)
    target = out or calibration
    with writing(target):
        path = export_state_space(source, to, target, sample_time_s=sample_time, draws=draws, hold=hold,
                                  specimen=specimen, at_voltage_V=at_voltage)
    if json_output:
        typer.echo((target / SUMMARY_FILE).read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        said = read_json(target / SUMMARY_FILE)
        typer.echo("\n".join(textwrap.wrap(f"{said['states']} states, MAP, mean and {said['draws']} draws; Ts = "
                                           f"{said['Ts']:g} s. {said['comment']}", 80)))
        for text in said["warnings"]:
            typer.echo("\n".join(textwrap.wrap(text, 80, initial_indent="- ", subsequent_indent="  ")))
        typer.echo(f"\nWritten: {path}")

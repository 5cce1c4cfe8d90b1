"""`bayes-dea live`."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from .options import (
    AnewOption,
    JsonOption,
    ModelOption,
    OutOption,
    PriorOption,
    PriorsOption,
    QuietOption,
    ResumeOption,
    SeedOption,
    WorkersOption,
    conclude,
    count,
    number,
    overrides,
    seconds,
    threads,
    writing,
)
from .progress import plain_terminal

EXAMPLE = "Example: bayes-dea live --port /dev/ttyUSB0 --campaign quickstart --model hooke+gm3 --play demo --out live"


def live(
    port: Annotated[str, typer.Option(metavar="PORT", help="Serial port, or any URL of pyserial: socket://HOST:PORT.")],
    campaign: Annotated[Path, typer.Option(metavar="FILE", help="campaign.toml, or its folder: geometry, sensor, "
                                           "limits.")],
    model: ModelOption,
    out: OutOption = Path("live"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    play: Annotated[str | None, typer.Option(metavar="NAME", help="Let the device play one of its programmes.")] = None,
    command: Annotated[Path | None, typer.Option(metavar="FILE", help="Stream this command (time_s, voltage_V), within "
                                                 "the limit of the actuator.")] = None,
    adaptive: Annotated[bool, typer.Option("--adaptive", help="Choose experiments itself, one after the other, until "
                                           "--until is reached or --budget is spent.")] = False,
    budget: Annotated[str | None, typer.Option(metavar="TIME", help="Bench time of an adaptive run: 600s, 10min, "
                                               "1h.")] = None,
    until: Annotated[list[str] | None, typer.Option(metavar="NAME=SD", help="Precision at which an adaptive run ends: "
                                                    "k_1_Pa=5% or in the parameter's unit; several by commas or "
                                                    "repeated.")] = None,
    max_voltage: Annotated[float | None, number(help="Largest voltage to command (V), below the actuator's.")] = None,
    duration: Annotated[float | None, seconds(help="End after so many seconds of the device's time; else at the end of "
                                              "what is played, or at Ctrl-C.", min=0.0)] = None,
    zero: Annotated[bool, typer.Option("--zero", help="Set the sensor to zero first; the actuator rests.")] = False,
    start: Annotated[Path | None, typer.Option("--from", metavar="DIR", help="Begin with the posterior in DIR instead "
                                               "of the prior.")] = None,
    # no brackets: the help takes them for markup
    device: Annotated[Path | None, typer.Option(metavar="FILE", help="TOML file with a table named device, for a "
                                                "device of another make.")] = None,
    baud: Annotated[int, count(help="Baud rate of a serial port.", min=50)] = 460_800,
    block: Annotated[float, seconds(help="Length of a block; each is one update.", min=0.05)] = 0.5,
    particles: Annotated[int, count(help="Draws that carry the posterior.", min=200)] = 2000,
    prior: PriorOption = None,
    priors: PriorsOption = None,
    serve: Annotated[str | None, typer.Option(metavar="[HOST:]PORT", help="Show the run in a browser too.")] = None,
    resume: ResumeOption = False,
    anew: AnewOption = False,
    json_output: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Follow a bench on a serial line and update the posterior as samples come.

    Leaves live.json, posterior.nc, report.html and the samples as a campaign in --out. Stopped in any way, even by a
    cut cable or kill -9, the same command goes on; a finished run goes on with --resume. --anew moves what is there
    into a folder of its own inside --out.
    """
    from ..live.adaptive import check_adaptive
    from ..live.journal import set_aside
    from ..live.learner import LearnerSettings
    from ..live.run import LIVE_FILE, LiveSettings, View
    from ..live.run import follow_bench as run
    from ..live.sequential import SequentialSettings
    from ..live.summary import words

    if play is not None and command is not None:
        raise InputError("--play and --command: give one of them")
    chosen = None
    if adaptive:
        chosen = check_adaptive(budget, until, {"--play": play, "--command": command, "--duration": duration})
    elif budget is not None or until:
        raise InputError("--budget and --until belong to --adaptive")
    if resume and anew:
        raise InputError("--resume and --anew: give one of them")
    settings = LiveSettings(duration, baud, zero=zero, play=play, command=command, device=device, start=start,
                            learner=LearnerSettings(block, sequential=SequentialSettings(particles),
                                                    workers=threads(workers)),
                            adaptive=chosen, max_voltage_V=max_voltage)
    with writing(out), contextlib.ExitStack() as stack:
        if anew:
            set_aside(out)
        shows = []
        if not quiet and sys.stderr.isatty() and not plain_terminal():
            from ..live.display import display

            shows.append(stack.enter_context(display(model)))
        if serve is not None:
            from ..live.page import serve_page

            address, show = stack.enter_context(serve_page(serve, model))
            shows.append(show)
            typer.echo(f"Page: {address}", err=True)

        def show_all(view: View) -> None:
            for each in shows:
                each(view)

        before = _written(out / LIVE_FILE)
        try:
            summary = run(port, campaign, model, out, seed, settings, overrides(prior, priors), resume,
                          show_all if shows else None)
        except BaseException:  # Ctrl-C is how many a run ends: what it came to is to be seen too
            if _written(out / LIVE_FILE) != before:
                with contextlib.suppress(Exception):  # what ended the run is what has to be read
                    _draw(out)
            raise
        page = _draw(out)
    conclude(quiet, json_output, out / LIVE_FILE, words(summary), page)


def _written(path: Path) -> int:
    return path.stat().st_mtime_ns if path.exists() else 0


def _draw(out: Path) -> Path:
    from ..report.live_page import write_live_page  # matplotlib, after the work

    return write_live_page(out)

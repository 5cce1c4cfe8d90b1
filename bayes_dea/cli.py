"""The command line: every verb in the same way. Heavy imports happen inside the verbs, so that --help answers at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import __version__
from .errors import BayesDEAError

if TYPE_CHECKING:
    from .priors import Parameter, Prior

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=True,
                  help="Bayesian calibration of dielectric elastomer actuators from bench recordings.")

SeedOption = Annotated[int, typer.Option(help="Seed of every random number; the same seed gives the same numbers.", min=0)]
OutOption = Annotated[Path, typer.Option(help="Folder for the results; made if it is not there.")]
WorkersOption = Annotated[int, typer.Option(help="Threads for reading and predicting; 0: one per processor.", min=0)]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


def _version(show: bool) -> None:
    if show:
        typer.echo(f"bayes-dea {__version__}")
        raise typer.Exit


@app.callback()
def _root(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                help="Print the version and leave.")] = False) -> None:
    pass


@app.command(epilog="Example: bayes-dea calibrate quickstart --model hooke+gm3 --out out")
def calibrate(
    campaign: Annotated[list[Path], typer.Argument(help="Folder with campaign.toml; several: one campaign, a specimen each.")],
    model: Annotated[str, typer.Option(help="Structure: static law + network, e.g. hooke+gm3, yeoh+gkv2, hooke+gkm3, pz3, ss3.")],
    out: OutOption = Path("out"),
    seed: SeedOption = 1,
    workers: WorkersOption = 0,
    prior: Annotated[list[str] | None, typer.Option(help="Override a prior: 'Y_Pa=lognormal(1.2e6, 0.3)', or fix: 'Y_Pa=1.2e6'. "
                                                         "May be given several times.")] = None,
    priors: Annotated[Path | None, typer.Option(help="File with priors that replace the default ones (see priors/README.md).")] = None,
    data_root: Annotated[Path | None, typer.Option(help="Folder where recordings may lie besides the campaign's own.")] = None,
    walkers: Annotated[int, typer.Option(help="Walkers of each ensemble.", min=8)] = 32,
    max_steps: Annotated[int, typer.Option(help="Steps after which sampling stops even if it has not converged.", min=200)] = 20_000,
    max_seconds: Annotated[float | None, typer.Option(help="The same in seconds of sampling.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print calibration.json instead of the summary.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Fit a model to the recordings with role "identify" and predict all of them, with bands.

    Leaves calibration.json, posterior.nc (ArviZ) and report.html in --out. Interrupted, it continues where it was
    when called again in the same way.
    """
    from dataclasses import replace

    from .calibrate import CalibrationSettings
    from .calibrate import calibrate as run
    from .campaign import load_campaign
    from .models.model import build_model
    from .report.summary import terminal_summary
    from .run_state import checkpoint_for, finished
    from .store import CALIBRATION_FILE, REPORT_FILE

    with _progress(quiet or json_output) as report:
        report("reading recordings", 0, 1, "")
        structure = build_model(model, _overrides(prior, priors))
        loaded = load_campaign(campaign, data_root)
        settings = CalibrationSettings(walkers=walkers, workers=workers or os.cpu_count() or 1)
        settings = replace(settings, sampler=replace(settings.sampler, max_steps=max_steps, max_seconds=max_seconds))
        _writable(out)
        checkpoint = checkpoint_for(out, {"model": structure.name, "seed": seed, "walkers": walkers,
                                          "priors": {p.name: str(p.prior) for p in structure.parameters},
                                          "inputs": [i["sha256"] for i in loaded.inputs]})
        result = run(loaded, structure, seed, settings, report=report, checkpoint=checkpoint)
        report("writing the report", 0, 1, str(out))
        result.save(out)
        finished(out)
    if json_output:
        typer.echo((out / CALIBRATION_FILE).read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        typer.echo(terminal_summary(result.summary))
        typer.echo(f"\nReport: {out / REPORT_FILE}")


@app.command(epilog="Example: bayes-dea bench --preset quickstart --out quickstart")
def bench(
    out: OutOption = Path("campaign"),
    preset: Annotated[str, typer.Option(help="quickstart, paper, mechanical, small, or a plan file (.toml).")] = "quickstart",
    seed: SeedOption = 1,
    material: Annotated[str | None, typer.Option(help="baseline, or drawn: a specimen of its own by seed.")] = None,
    noise_scale: Annotated[float | None, typer.Option(help="True noise over the stated fluctuation.")] = None,
    noise_correlation: Annotated[float | None, typer.Option(help="Correlation of neighbouring samples' noise.")] = None,
    dropouts: Annotated[float | None, typer.Option(help="Probability of a laser drop-out, per sample.")] = None,
    mains_m: Annotated[float | None, typer.Option(help="Amplitude of 50 Hz on the displacement, in m.")] = None,
    gaps: Annotated[int | None, typer.Option(help="Stretches without a reading in each recording.")] = None,
    clock_unevenness: Annotated[float | None, typer.Option(help="Unevenness of the time stamps, in parts of a step.")] = None,
    quiet: QuietOption = False,
) -> None:
    """Write a campaign of the virtual bench: the reference actuator, simulated, with sensors that err."""
    from .bench.run import run_bench

    with _progress(quiet) as report:
        folder = run_bench(out, preset, seed, material=material, noise_scale=noise_scale,
                           noise_correlation=noise_correlation, dropouts=dropouts, mains_m=mains_m, gaps=gaps,
                           clock_unevenness=clock_unevenness,
                           progress=lambda done, of, name: report("simulating", done, of, name))
    if not quiet:
        typer.echo(f"Campaign (simulated): {folder}")


@app.command(epilog="Example: bayes-dea report out")
def report(folder: Annotated[Path, typer.Argument(help="The --out of an earlier calibration.")], quiet: QuietOption = False) -> None:
    """Draw report.html again from the JSON and posterior.nc in a folder."""
    from .report.page import write_report
    from .store import load_posterior

    load_posterior(folder)
    page = write_report(folder)
    if not quiet:
        typer.echo(f"Report: {page}")


def _overrides(prior: list[str] | None, file: Path | None) -> dict[str, Parameter | Prior]:
    from .priors import parse_override, read_prior_file

    out: dict[str, Any] = dict(read_prior_file(file)) if file is not None else {}
    for text in prior or []:
        name, value = parse_override(text)
        out[name] = value
    return out


def _writable(folder: Path) -> None:
    """Make the folder now: an error after minutes of sampling would come too late."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BayesDEAError(f"{folder}: cannot be made: {error.strerror or error}") from error
    if not os.access(folder, os.W_OK):
        raise BayesDEAError(f"{folder}: cannot be written to; choose another --out")


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Any]:
    """A callback (phase, done, of, text) that draws on a terminal and does nothing in a pipe."""
    if quiet or not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    bar = Progress(TextColumn("{task.description:<20}"), BarColumn(20), TimeElapsedColumn(), TimeRemainingColumn(),
                   TextColumn("{task.fields[text]}"), console=Console(stderr=True), transient=True)
    tasks: dict[str, Any] = {}

    def update(phase: str, done: float, of: float, text: str) -> None:
        if phase not in tasks:
            for task in tasks.values():
                bar.update(task, completed=1, total=1, visible=False)
            tasks[phase] = bar.add_task(phase, total=None, text="")
        bar.update(tasks[phase], completed=done, total=of if done > 0 else None, text=text[:60])

    with bar:
        yield update


class _Terminated(BaseException):
    """SIGTERM, turned into an exception so that files are left whole."""


def _on_terminate(*_: object) -> None:
    raise _Terminated


def main() -> None:
    """Entry point: errors become one line and an exit status (CONTRACT 2)."""
    with contextlib.suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, _on_terminate)
    try:
        app(standalone_mode=False)
    except typer.Exit as leave:
        sys.exit(leave.exit_code)
    except BayesDEAError as error:
        print(f"bayes-dea: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        print("bayes-dea: interrupted; call it again in the same way to continue", file=sys.stderr)
        sys.exit(130)
    except _Terminated:
        print("bayes-dea: terminated; call it again in the same way to continue", file=sys.stderr)
        sys.exit(143)
    except MemoryError:
        print("bayes-dea: out of memory; calibrate fewer or shorter recordings at once", file=sys.stderr)
        sys.exit(1)
    except BrokenPipeError:
        sys.exit(1)
    except Exception as error:
        status = _usage_error(error)
        sys.exit(status)


def _usage_error(error: Exception) -> int:
    """Print an error of the command line's own parser; anything else is ours and shows where it happened."""
    show = getattr(error, "show", None)
    if callable(show) and hasattr(error, "exit_code"):
        show()
        return int(error.exit_code)
    if isinstance(error, OSError):
        print(f"bayes-dea: {error}", file=sys.stderr)
        return 1
    import traceback

    traceback.print_exc()
    print("bayes-dea: this is a defect of bayes-dea, not of your input; please report it with the lines above",
          file=sys.stderr)
    return 1


if __name__ == "__main__":
    main()

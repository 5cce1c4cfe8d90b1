"""The command line: every verb in the same way. Heavy imports happen inside the verbs: --help answers at once."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import __version__
from .errors import BayesDEAError, InputError

if TYPE_CHECKING:
    from .priors import Parameter, Prior

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=True,
                  help="Bayesian calibration of dielectric elastomer actuators from bench recordings.")

# short words for what an option takes, so that --help fits 80 columns
_count = partial(typer.Option, metavar="N")
_number = partial(typer.Option, metavar="X")
_seconds = partial(typer.Option, metavar="SECONDS")
_folder = partial(typer.Option, metavar="DIR")
_name = partial(typer.Option, metavar="NAME")

SeedOption = Annotated[int, _count(help="Seed of every random number; the same seed, the same numbers.", min=0)]
OutOption = Annotated[Path, _folder(help="Folder for the results; made if it is not there.")]
WorkersOption = Annotated[int, _count(help="Threads for reading and predicting; 0: one per processor.", min=0)]
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
    data_root: Annotated[Path | None, _folder(help="Folder where recordings may lie besides the campaign.")] = None,
    walkers: Annotated[int, _count(help="Walkers of each ensemble.", min=8)] = 32,
    max_steps: Annotated[int, _count(help="Steps after which sampling stops, converged or not.", min=200)] = 20_000,
    max_seconds: Annotated[float | None, _seconds(help="The same in seconds of sampling.", min=0.0)] = None,
    checkpoint_seconds: Annotated[float, _seconds(help="Sampling that an interrupted run may lose.", min=0.0)] = 10.0,
    json_output: Annotated[bool, typer.Option("--json", help="Print calibration.json instead of the summary.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Fit a model to the recordings with role "identify" and predict all of them.

    Leaves calibration.json, posterior.nc (ArviZ) and report.html in --out.

    Interrupted, it continues where it was when called again in the same way.
    """
    import warnings
    from dataclasses import replace

    from .calibration import CalibrationSettings
    from .calibration import calibrate as run
    from .campaign import load_campaign
    from .errors import NotConvergedWarning
    from .models.model import build_model
    from .report.summary import terminal_summary
    from .run_state import checkpoint_for, finished
    from .store import CALIBRATION_FILE, REPORT_FILE

    with _progress(quiet or json_output) as report:
        report("reading recordings", 0, 1, "")
        structure = build_model(model, _overrides(prior, priors))
        loaded = load_campaign(campaign, data_root)
        settings = CalibrationSettings(walkers=walkers, workers=workers or os.cpu_count() or 1)
        settings = replace(settings, sampler=replace(settings.sampler, max_steps=max_steps, max_seconds=max_seconds,
                                                     checkpoint_seconds=checkpoint_seconds))
        _writable(out)
        checkpoint = checkpoint_for(out, {"model": structure.name, "seed": seed, "walkers": walkers,
                                          "priors": {p.name: str(p.prior) for p in structure.parameters},
                                          "inputs": [i["sha256"] for i in loaded.inputs]})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotConvergedWarning)  # the summary says so
            result = run(loaded, structure, seed, settings, report=report, checkpoint=checkpoint)
        result.summary["command"] = ["bayes-dea", *sys.argv[1:]]
        report("writing the report", 0, 1, str(out))
        result.save(out)
        finished(out, keep=None if result.converged else checkpoint)
    if json_output:
        typer.echo((out / CALIBRATION_FILE).read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        typer.echo(terminal_summary(result.summary))
        typer.echo(f"\nReport: {out / REPORT_FILE}")


@app.command(epilog="Example: bayes-dea bench --preset quickstart --out quickstart")
def bench(
    out: OutOption = Path("campaign"),
    preset: Annotated[str, _name(help="quickstart, paper, mechanical, small, or a plan file (.toml).")] = "quickstart",
    seed: SeedOption = 1,
    material: Annotated[str | None, _name(help="baseline, or drawn: a specimen of its own by seed.")] = None,
    noise_scale: Annotated[float | None, _number(help="True noise over the stated fluctuation.")] = None,
    noise_correlation: Annotated[float | None, _number(help="Correlation of neighbouring samples' noise.")] = None,
    dropouts: Annotated[float | None, _number(help="Probability of a laser drop-out, per sample.")] = None,
    mains_m: Annotated[float | None, _number(help="Amplitude of 50 Hz on the displacement, in m.")] = None,
    gaps: Annotated[int | None, _count(help="Stretches without a reading in each recording.")] = None,
    clock_unevenness: Annotated[float | None, _number(help="Unevenness of the time stamps, in steps.")] = None,
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
def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The --out of an earlier calibration.")],
    quiet: QuietOption = False,
) -> None:
    """Draw report.html again from the JSON and posterior.nc in a folder."""
    from .report.page import write_report
    from .store import load_posterior

    load_posterior(folder)
    page = write_report(folder)
    if not quiet:
        typer.echo(f"Report: {page}")


def _overrides(prior: list[str] | None, file: Path | None) -> dict[str, Parameter | Prior]:
    from .priors import parse_override, read_prior_file

    if file is not None and file.is_dir():
        raise InputError(f"--priors {file}: is a folder; give a prior file (TOML, see priors/README.md)")
    out: dict[str, Any] = dict(read_prior_file(file)) if file is not None else {}
    for text in prior or []:
        name, value = parse_override(text)
        out[name] = value
    return out


def _writable(folder: Path) -> None:
    """Make the folder now: an error after minutes of sampling would come too late."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: there is a file of that name; choose another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BayesDEAError(f"{folder}: cannot be made: {error.strerror or error}") from error
    if not os.access(folder, os.W_OK):
        raise BayesDEAError(f"{folder}: cannot be written to; choose another --out")


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Any]:
    """A callback (phase, done, of, text) that draws on a terminal and not in a pipe.

    It is also where a run is interrupted: a signal that arrives while the sampler is at work is held back until the
    next call, between two whole steps.
    """
    if quiet or not sys.stderr.isatty():
        yield _interruptible(lambda *_: None)
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
        yield _interruptible(update)


class _Interrupted(BaseException):
    """SIGINT or SIGTERM as an exception, so that files are left whole. (typer swallows KeyboardInterrupt.)"""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_status = 128 + number


class _Signals:
    """Signals as exceptions: at once, or at the next `release` while `held`; a second one always at once."""

    def __init__(self) -> None:
        self.held = False
        self.pending: _Interrupted | None = None

    def install(self) -> None:
        sys.unraisablehook = self._unraisable
        with contextlib.suppress(ValueError, AttributeError):  # not in the main thread; no SIGALRM
            for number in (signal.SIGTERM, signal.SIGINT):
                if signal.getsignal(number) != signal.SIG_IGN:  # a shell's background jobs ignore SIGINT
                    signal.signal(number, self._arrived)
            signal.signal(signal.SIGALRM, lambda *_: self.release())

    def _unraisable(self, what: sys.UnraisableHookArgs) -> None:
        """Python drops what is raised in the callback of a destructor: ours is raised again a moment later."""
        if isinstance(what.exc_value, _Interrupted):
            signal.setitimer(signal.ITIMER_REAL, 0.02)
        else:
            sys.__unraisablehook__(what)

    def _arrived(self, number: int, _frame: object) -> None:
        first, self.pending = self.pending is None, _Interrupted(number)
        if not (self.held and first):
            raise self.pending

    def release(self) -> None:
        """Raise what was held back or dropped."""
        error, self.pending = self.pending, None
        if error is not None:
            raise error


_signals = _Signals()


def _interruptible(report: Any) -> Any:
    # emcee prints a traceback for every exception inside the density, also for those of signals
    def update(phase: str, done: float, of: float, text: str) -> None:
        _signals.held = phase.startswith("sampling")
        _signals.release()
        report(phase, done, of, text)

    return update


def main() -> None:
    """Entry point: errors become one line and an exit status (CONTRACT 2)."""
    _signals.install()
    sys.exit(_run())


def _run() -> int:
    try:
        status = app(standalone_mode=False, prog_name="bayes-dea")
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except typer.Exit as leave:
        return leave.exit_code
    except BayesDEAError as error:
        return _say(str(error), error.exit_status)
    except _Interrupted as stop:
        what = "terminated" if stop.exit_status == 143 else "interrupted"
        return _say(f"{what}; call it again in the same way to continue", stop.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        return _say("interrupted; call it again in the same way to continue", 130)
    except MemoryError:
        return _say("out of memory; calibrate fewer or shorter recordings at once", 1)
    except BrokenPipeError:
        # whoever read our output has left; the interpreter would complain when it flushes
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _say(str(error), 1)
    except Exception as error:
        if hasattr(error, "format_message") and hasattr(error, "exit_code"):
            return _usage_error(error)
        import traceback

        traceback.print_exc()
        return _say("this is a defect of bayes-dea, not of your input; please report it with the lines above", 1)


def _say(message: str, status: int) -> int:
    print(f"bayes-dea: {message}", file=sys.stderr)
    return status


def _usage_error(error: Any) -> int:
    """An error of the command line's own parser, as one line; a bare `bayes-dea` gets the help."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "bayes-dea"
    message = error.format_message().strip()
    if not message or "\n" in message:
        error.show()
        return int(error.exit_code)
    message = message.rstrip(".") + "." if message[-1] not in "?!)" else message
    return _say(f"{message} See '{command} --help'.", int(error.exit_code))


if __name__ == "__main__":
    main()

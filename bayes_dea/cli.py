"""The command line: every verb in the same way. Heavy imports happen inside the verbs: --help answers at once."""

from __future__ import annotations

import contextlib
import inspect
import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer

from . import __version__
from .commands import bench, calibrate, compare, diagnose, export, import_, live, next_, paper, predict, report
from .commands.progress import Interrupted, no_colours, plain_terminal, signals
from .errors import BayesDEAError

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=True,
                  help="Bayesian calibration of dielectric elastomer actuators from bench recordings.")

#: verb by name, in the order of the help
VERBS: dict[str, tuple[Callable[..., None], str]] = {
    "calibrate": (calibrate.calibrate, calibrate.EXAMPLE),
    "compare": (compare.compare, compare.EXAMPLE),
    "diagnose": (diagnose.diagnose, diagnose.EXAMPLE),
    "next": (next_.next_, next_.EXAMPLE),
    "live": (live.live, live.EXAMPLE),
    "bench": (bench.bench, bench.EXAMPLE),
    "paper": (paper.paper, paper.EXAMPLE),
    "predict": (predict.predict, predict.EXAMPLE),
    "export": (export.export, export.EXAMPLE),
    "import": (import_.import_, import_.EXAMPLE),
    "report": (report.report, report.EXAMPLE),
}


def _help(function: Callable[..., None]) -> str:
    """The docstring, a line a paragraph: the terminal breaks it where its own width ends."""
    paragraphs = (inspect.getdoc(function) or "").split("\n\n")
    return "\n\n".join(" ".join(p.split()) for p in paragraphs)


for _verb, (_function, _example) in VERBS.items():
    app.command(_verb, epilog=_example, help=_help(_function))(_function)


def _version(show: bool) -> None:
    if show:
        typer.echo(f"bayes-dea {__version__}")
        raise typer.Exit


@app.callback()
def _root(version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                                help="Print the version and leave.")] = False,
          no_color: Annotated[bool, typer.Option("--no-color", help="No escape codes on a terminal; anywhere in a "
                                                 "command. So do NO_COLOR and TERM=dumb.")] = False) -> None:
    pass


def main() -> None:
    """Entry point: errors become one line and an exit status (CONTRACT 2)."""
    signals.install()
    try:
        status = _run()
    except Interrupted as again:  # a second one while the first was being told
        status = again.exit_status
    signals.ignore()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    # all is written: taking down everything that was imported takes a second, and files that were open when a signal
    # came would complain once more
    os._exit(status)


def _run() -> int:
    try:
        if "--no-color" in sys.argv:
            sys.argv = [a for a in sys.argv if a != "--no-color"]
            no_colours()
        elif plain_terminal():
            no_colours()
        with signals.come_first():
            status = app(standalone_mode=False, prog_name="bayes-dea")
        sys.stdout.flush()
        return status if isinstance(status, int) else 0
    except typer.Exit as leave:
        return leave.exit_code
    except BayesDEAError as error:
        return _say(str(error), error.exit_status)
    except Interrupted as stop:
        status = _stopped("terminated" if stop.exit_status == 143 else "interrupted", stop.exit_status)
        for note in getattr(stop, "__notes__", ()):
            _say(note, status)
        return status
    except (KeyboardInterrupt, typer.Abort):
        return _stopped("interrupted", 130)
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


def _stopped(how: str, status: int) -> int:
    verb = next((a for a in sys.argv[1:] if a in VERBS), "")
    resumable = verb and "resume" in inspect.signature(VERBS[verb][0]).parameters
    return _say(f"{how}; {'the same command with --resume continues' if resumable else 'nothing is half written'}",
                status)


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

"""Progress on a terminal, silence in a pipe, and signals that stop a run between two whole steps."""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Any]:
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


class Interrupted(BaseException):
    """SIGINT or SIGTERM as an exception, so that files are left whole. (typer swallows KeyboardInterrupt.)"""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_status = 128 + number


class Signals:
    """Signals as exceptions: at once, or at the next `release` while `held`; a second one always at once."""

    def __init__(self) -> None:
        self.held = False
        self.pending: Interrupted | None = None

    def install(self) -> None:
        sys.unraisablehook = self._unraisable
        with contextlib.suppress(ValueError, AttributeError):  # not in the main thread; no SIGALRM
            for number in (signal.SIGTERM, signal.SIGINT):
                if signal.getsignal(number) != signal.SIG_IGN:  # a shell's background jobs ignore SIGINT
                    signal.signal(number, self._arrived)
            signal.signal(signal.SIGALRM, lambda *_: self.release())

    def _unraisable(self, what: sys.UnraisableHookArgs) -> None:
        """Python drops what is raised in the callback of a destructor: ours is raised again a moment later."""
        if isinstance(what.exc_value, Interrupted):
            signal.setitimer(signal.ITIMER_REAL, 0.02)
        else:
            sys.__unraisablehook__(what)

    def _arrived(self, number: int, _frame: object) -> None:
        first, self.pending = self.pending is None, Interrupted(number)
        if not (self.held and first):
            raise self.pending

    def release(self) -> None:
        """Raise what was held back or dropped."""
        error, self.pending = self.pending, None
        if error is not None:
            raise error


signals = Signals()


def _interruptible(report: Any) -> Any:
    # emcee prints a traceback for every exception inside the density, also for those of signals
    def update(phase: str, done: float, of: float, text: str) -> None:
        signals.held = phase.startswith("sampling")
        signals.release()
        report(phase, done, of, text)

    return update

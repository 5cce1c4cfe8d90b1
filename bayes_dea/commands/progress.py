"""Progress on a terminal, silence in a pipe, and signals as exceptions."""

from __future__ import annotations

import contextlib
import datetime
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

#: called with (phase, done, of, text); what is done is a number of whatever the phase counts
Report = Callable[[str, float, float, str], None]
_SECONDS_BETWEEN_LINES = 5.0


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Report]:
    """A callback (phase, done, of, text) that draws on a terminal and not in a pipe.

    On a terminal without colours (TERM=dumb, NO_COLOR, --no-color) it writes a plain line now and then.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda *_: None
    elif plain_terminal():
        yield _Lines()
    else:
        with _bar() as update:
            yield update


def plain_terminal() -> bool:
    """Whether the terminal takes no colours or is asked to show none (https://no-color.org)."""
    return bool(os.environ.get("NO_COLOR")) or os.environ.get("TERM", "") in ("", "dumb")


def no_colours() -> None:
    """From here on, no escape codes: not in help texts, not in progress."""
    os.environ.pop("FORCE_COLOR", None)
    os.environ["NO_COLOR"] = "1"
    os.environ["TERM"] = "dumb"  # NO_COLOR alone leaves bold and dim


class _Lines:
    """Progress as lines: one when a phase begins, others while it lasts."""

    def __init__(self) -> None:
        self.phase = ""
        self.began = self.last = self.done = 0.0

    def __call__(self, phase: str, done: float, of: float, text: str) -> None:
        now = time.monotonic()
        again = phase == self.phase and done == 0 < self.done
        self.done = done
        if again:  # the phase begins once more
            self.began = now
        elif phase != self.phase:
            self.phase, self.began, self.last = phase, now, now
            print(f"{phase} ...", file=sys.stderr, flush=True)
        if done > 0 and now - self.last >= _SECONDS_BETWEEN_LINES:
            self.last = now
            left = (now - self.began) * max(of - done, 0.0) / done
            line = f"{phase}: {100 * min(done / of, 1.0):.0f} %, about {duration(left)} left"
            print(f"{line} ({text})"[:79] if text else line, file=sys.stderr, flush=True)


def duration(seconds: float) -> str:
    """`42 s`, `3 min 10 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextlib.contextmanager
def _bar() -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.table import Column
    from rich.text import Text

    class Left(TimeRemainingColumn):
        """Remaining time; after the first report of a phase, when there is no speed yet, as its elapsed time has it."""

        def render(self, task: Task) -> Text:
            if task.time_remaining is not None or not task.total or not task.completed:
                return super().render(task)
            left = (task.elapsed or 0.0) * (task.total - task.completed) / task.completed
            return Text(str(datetime.timedelta(seconds=round(left))), style="progress.remaining")

    # one line of a terminal of 80 columns; what does not fit is cut rather than wrapped
    bar = Progress(TextColumn("{task.description}", table_column=Column(width=21, no_wrap=True)), BarColumn(12),
                   TimeElapsedColumn(), Left(),
                   TextColumn("{task.fields[text]}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
                   console=Console(stderr=True), transient=True, expand=True)
    now: dict[str, Any] = {"phase": "", "done": 0.0}
    alone = threading.Lock()  # recordings are read and predicted in threads, each of which reports

    def update(phase: str, done: float, of: float, text: str) -> None:
        with alone:
            # a phase that begins once more is a line of its own: its elapsed time is not that of the one before
            if phase != now["phase"] or (done == 0 < now["done"]):
                if "task" in now:
                    bar.remove_task(now["task"])
                now["phase"], now["task"] = phase, bar.add_task(phase, total=None, text="")
            now["done"] = done
            bar.update(now["task"], completed=done, total=of if done > 0 else None, text=text)

    with bar:
        yield update


class Interrupted(BaseException):
    """SIGINT or SIGTERM as an exception, so that files are left whole. (typer swallows KeyboardInterrupt.)"""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.exit_status = 128 + number


#: functions that numba's C code calls as it loads a compiled one: an exception out of them ends in a SystemError
_DEAF = frozenset({"_numba_unpickle"})


class Signals:
    """SIGINT and SIGTERM raised as `Interrupted` where they arrive."""

    def __init__(self) -> None:
        self.dropped: Interrupted | None = None
        self.raised: Interrupted | None = None
        self.installed: list[int] = []

    def install(self) -> None:
        """From here on; not in a thread, and not for what the shell has told its background jobs to ignore."""
        sys.unraisablehook = self._unraisable
        with contextlib.suppress(ValueError, AttributeError):  # not in the main thread; no SIGALRM
            for number in (signal.SIGTERM, signal.SIGINT):
                if signal.getsignal(number) != signal.SIG_IGN:
                    signal.signal(number, self._arrived)
                    self.installed.append(number)
            signal.signal(signal.SIGALRM, self._again)

    def ignore(self) -> None:
        """The work is done and what is left is to leave: a traceback from there would help nobody."""
        for number in self.installed:
            signal.signal(number, signal.SIG_IGN)

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        self._raise(Interrupted(number), frame)

    def _unraisable(self, what: sys.UnraisableHookArgs) -> None:
        """Python drops what is raised in the callback of a destructor: ours is raised again a moment later."""
        if isinstance(what.exc_value, Interrupted):
            self._later(what.exc_value)
        else:
            sys.__unraisablehook__(what)

    def _again(self, _number: int, frame: FrameType | None) -> None:
        error, self.dropped = self.dropped, None
        if error is not None:
            self._raise(error, frame)

    def _raise(self, error: Interrupted, frame: FrameType | None) -> None:
        while frame is not None:
            # what is raised in there is lost for good: nobody may raise here, or C code called it that cannot carry it
            if frame.f_code is Signals._unraisable.__code__ or frame.f_code.co_name in _DEAF:
                self._later(error)
                return
            frame = frame.f_back
        self.raised = error
        raise error

    @contextlib.contextmanager
    def come_first(self) -> Iterator[None]:
        """An error inside that follows a signal is that signal's.

        C code that is imported just then may report a failed import instead of what was raised in it.
        """
        try:
            yield
        except Exception as error:
            if self.raised is None:
                raise
            raise self.raised from error

    def _later(self, error: Interrupted) -> None:
        self.dropped = error
        signal.setitimer(signal.ITIMER_REAL, 0.02)


signals = Signals()

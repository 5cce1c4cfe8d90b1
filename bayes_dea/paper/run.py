"""The paper, redone: its sections in processes of their own, each kept as it is finished."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import BayesDEAError, InputError
from ..results import write_text
from ..run_state import finished
from . import kept
from .section import Section

Report = Callable[[str, float, float, str], None]

#: sections in the paper's order: name of the module, what it does for who waits
SECTIONS: tuple[tuple[str, str], ...] = (
    ("static", "static laws"),
    ("relaxation", "relaxation"),
    ("creep", "creep"),
    ("optimisation", "optimised sets"),
    ("validation", "validation signals"),
    ("timing", "computation time"),
    ("misprints", "misprints"),
    ("left_out", "what was left out"),
)
#: measures time: runs when nothing else does
ALONE = "timing"
#: where the modules are
PACKAGE = "bayes_dea.paper.sections"
_PHASE = "redoing the paper"


@dataclass(frozen=True)
class PaperSettings:
    """workers: sections at a time. sections: names of those to redo, () for all of SECTIONS."""

    workers: int = 1
    sections: tuple[str, ...] = ()


@dataclass(frozen=True)
class Paper:
    """The redone paper. `summary` is paper.json; `sections` what each part hands on, in the paper's order."""

    summary: dict[str, Any]
    sections: tuple[Section, ...] = field(repr=False)

    def save(self, out: str | Path) -> Path:
        """Write paper.json and report.html into the folder that holds the sections; returns it."""
        from .store import save_paper

        return save_paper(self, Path(out))


def redo_paper(
    out: str | Path,
    seed: int = 1,
    settings: PaperSettings | None = None,
    report: Report | None = None,
    anew: bool = False,
) -> Paper:
    """Redo the reference paper's tables, figures and conclusions.

    Sections that the same version made with the same seed are taken from `out`/sections, unless `anew`; the numbers do
    not depend on how often a run was interrupted nor on the number of workers. Raises InputError for a section
    that there is not, BayesDEAError that names each section that failed, when all others are done and kept.
    """
    from .store import summarise

    s = settings or PaperSettings()
    folder = Path(out)
    say = report or (lambda *_: None)
    began = time.perf_counter()
    jobs = [_Job(name, title, folder, seed) for name, title in chosen(s.sections)]
    made: dict[str, Section] = {}
    for job in jobs:
        if anew:
            job.path.unlink(missing_ok=True)
        found = kept.recall(job.path, job.key)
        if found is not None:
            made[job.name] = found
    taken = [job.name for job in jobs if job.name in made]
    missing = [job for job in jobs if job.name not in made]
    crew = _Crew(say, len(taken), len(jobs))
    crew.work([j for j in missing if j.name != ALONE], max(s.workers, 1))
    crew.work([j for j in missing if j.name == ALONE], 1)
    if crew.failed:
        raise crew.complaint()
    for job in missing:
        read = kept.recall(job.path, job.key)
        if read is None:
            raise BayesDEAError(f"{job.path}: cannot be read back; the disk or another program changed it, run again")
        made[job.name] = read
    finished(folder / kept.FOLDER)
    sections = tuple(made[job.name] for job in jobs)
    summary = summarise(sections, seed, time.perf_counter() - began, taken)
    return Paper(summary, sections)


def chosen(names: Sequence[str]) -> list[tuple[str, str]]:
    """Sections by name, in the paper's order; all for (). Raises InputError for one that there is not."""
    known = [name for name, _ in SECTIONS]
    for name in names:
        if name not in known:
            raise InputError(f"section '{name}': there is no such; there are {', '.join(known)}")
    return [(n, t) for n, t in SECTIONS if not names or n in names]


class _Job:
    """One section to be made."""

    def __init__(self, name: str, title: str, folder: Path, seed: int) -> None:
        self.name, self.title, self.seed = name, title, seed
        self.module = f"{PACKAGE}.{name}"
        self.path = kept.path_of(folder, name)
        spec = importlib.util.find_spec(self.module)
        self.key = kept.key_of(name, seed, Path(spec.origin) if spec is not None and spec.origin else None)

    def task(self) -> str:
        """What the process is told."""
        return json.dumps({"name": self.name, "module": self.module, "seed": self.seed, "workers": 1,
                           "path": str(self.path.resolve()), "key": self.key}) + "\n"


class _Crew:
    """Processes at work, some at a time; tells how far they are and remembers who failed."""

    def __init__(self, say: Report, done: int, of: int) -> None:
        self.say, self.done, self.of = say, done, of
        self.share: dict[str, float] = {}
        self.failed: dict[str, dict[str, Any]] = {}

    def work(self, jobs: Sequence[_Job], at_once: int) -> None:
        """Run the jobs, `at_once` at a time; those that fail do not stop the others."""
        waiting = list(jobs)
        running: dict[str, _Job] = {}
        messages: queue.Queue[tuple[str, dict[str, Any]]] = queue.Queue()
        with contextlib.ExitStack() as processes:
            while waiting or running:
                while waiting and len(running) < at_once:
                    job = waiting.pop(0)
                    running[job.name] = job
                    self._at(job, "", 0.0)
                    processes.enter_context(_process(job, messages))
                name, message = _next(messages)
                if "at" in message:
                    text, done, of = message["at"]
                    self._at(running[name], text, min(done / of, 1.0) if of else 0.0)
                    continue
                job = running.pop(name)
                self.share.pop(name, None)
                if "error" in message:
                    self.failed[name] = message
                    self._keep_traceback(job, message)
                self.done += 1
                self.say(_PHASE, self._all(), self.of, f"{job.title}: {'failed' if name in self.failed else 'done'}")

    def complaint(self) -> BayesDEAError:
        """All failures in one error; the user's to mend only where every one of them is."""
        said = "; ".join(f"section '{n}' failed: {m['error']}" for n, m in self.failed.items())
        kind = InputError if all(m["status"] == InputError.exit_status for m in self.failed.values()) else BayesDEAError
        return kind(f"{said}; sections/NAME.error.txt has the details, and what is finished is kept for --resume")

    def _all(self) -> float:
        return self.done + sum(self.share.values())

    def _at(self, job: _Job, text: str, share: float) -> None:
        self.share[job.name] = share
        self.say(_PHASE, self._all(), self.of, f"{job.title}: {text}" if text else job.title)

    @staticmethod
    def _keep_traceback(job: _Job, message: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):  # a full disk may be why it failed
            job.path.parent.mkdir(parents=True, exist_ok=True)
            write_text(job.path.with_suffix(".error.txt"), message["traceback"])


def _next(messages: queue.Queue[tuple[str, dict[str, Any]]]) -> tuple[str, dict[str, Any]]:
    while True:
        with contextlib.suppress(queue.Empty):  # a wait without end would keep signals waiting on some systems
            return messages.get(timeout=0.5)


@contextlib.contextmanager
def _process(job: _Job, messages: queue.Queue[tuple[str, dict[str, Any]]]) -> Iterator[None]:
    """The process of a section for as long as the block lasts; what it tells goes into `messages`."""
    job.path.with_suffix(".error.txt").unlink(missing_ok=True)
    # one thread: sums in another order would change last digits, and sections run beside each other
    single = {k: "1" for k in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")}
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as complaints:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "bayes_dea.paper.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=complaints, text=True, encoding="utf-8", env=_environment(single), start_new_session=True,
        )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None

        def listen(stream: Any) -> None:
            ended = False
            for line in stream:
                message = json.loads(line)
                ended = ended or "at" not in message
                messages.put((job.name, message))
            if not ended:
                status = process.wait()
                with contextlib.suppress(ValueError):  # closed, as the whole run is being stopped
                    complaints.seek(0)
                    text = complaints.read()
                    messages.put((job.name, {"error": f"its process ended with status {status}", "status": 0,
                                             "traceback": text}))

        listener = threading.Thread(target=listen, args=(process.stdout,), daemon=True)
        listener.start()
        try:
            with contextlib.suppress(BrokenPipeError):  # it died at once, which the listener tells
                process.stdin.write(job.task())
                process.stdin.flush()
            yield
        finally:
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(timeout=5)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
            listener.join(timeout=5)
            with contextlib.suppress(OSError):
                process.stdin.close()
            process.stdout.close()


def _environment(changes: dict[str, str]) -> dict[str, str]:
    """This process's environment; modules are found where it finds them."""
    path = os.pathsep.join(p for p in sys.path if p)
    return {**os.environ, "PYTHONPATH": path, **changes}

"""One section in a process of its own: `python -m bayes_dea.paper.worker`, task in, lines of progress out.

Every section runs in this way, with one thread for linear algebra, so that its numbers do not depend on what runs
beside it or how many processors there are. The task is a line of JSON on standard input; when that is closed, because
whoever started it has ended, the process ends as well.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import threading
import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

#: progress is told at most this often (s)
_BETWEEN = 0.1


def main() -> None:
    """Read the task, run the section, write its file; then a line `done`, or one that says what went wrong."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to all; who started us decides
    out = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)  # what a library prints is no message of ours

    def tell(**message: Any) -> None:
        try:
            print(json.dumps(message), file=out)
        except OSError:
            os._exit(1)  # nobody listens any more

    task = json.loads(sys.stdin.readline())
    threading.Thread(target=_leave_with_parent, daemon=True).start()
    try:
        run(task, tell)
    except Exception as error:  # any: it is told, by name, to who started us
        from ..errors import BayesDEAError

        status = error.exit_status if isinstance(error, BayesDEAError) else 0
        tell(error=f"{type(error).__name__}: {error}" if not status else str(error), status=status,
             traceback=traceback.format_exc())
        os._exit(1)
    tell(done=True)
    os._exit(0)


def run(task: dict[str, Any], tell: Any) -> None:
    """Run the section that the task names and keep what it hands on."""
    from .kept import keep
    from .section import Task

    last = 0.0

    def report(text: str, done: int, of: int) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last >= _BETWEEN:
            last = now
            tell(at=[str(text), float(done), float(of)])

    module = importlib.import_module(task["module"])
    began = time.perf_counter()
    section = module.run(Task(task["seed"], task["workers"], report))
    section = replace(section, name=task["name"], seconds=time.perf_counter() - began)
    keep(Path(task["path"]), section, task["key"])


def _leave_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    main()

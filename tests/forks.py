"""Runs of the command line as forks of one warm process (forked_runs.py): what is imported is imported once."""

import json
import os
import subprocess
import sys
from pathlib import Path

from pace import HANGS_S

ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


class Forks:
    """A warm process; `warming` are the arguments of the run that warms it, `rests_s` see short_runs.py."""

    def __init__(self, said: Path, warming: list[object], rests_s: float = 0.0) -> None:
        self.said = said
        script = Path(__file__).with_name("forked_runs.py")
        self.server = subprocess.Popen([sys.executable, str(script), *map(str, warming)], stdin=subprocess.PIPE,
                                       stdout=subprocess.PIPE, text=True,
                                       env=ENVIRONMENT | {"SAMPLER_RESTS_S": str(rests_s)})

    def start(self, arguments):
        """Begin a run; returns its process id."""
        self.server.stdin.write(json.dumps([*map(str, arguments), str(self.said)]) + "\n")
        self.server.stdin.flush()
        return int(self.server.stdout.readline())

    def end(self):
        """Exit status of the run and what it printed."""
        return int(self.server.stdout.readline()), self.said.read_text(encoding="utf-8")

    def running(self, process):
        """Whether the run with that process id has not ended yet."""
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
        return True

    def close(self):
        """End the warm process."""
        self.server.stdin.close()
        self.server.wait(HANGS_S)
        self.server.stdout.close()

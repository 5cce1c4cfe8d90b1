"""Runs of the command line as forks of a process that is warm, so that a test can afford fifty.

Their search and their learning are short (short_runs.py). The arguments given are a run that is carried out once, to
import and compile everything. Then it reads a JSON list of arguments a line, answers with the process id once the run
has begun and with its exit status once it has ended. What a run prints goes to the file named by the last argument.
"""

import json
import os
import sys

from short_runs import rest, shorten, without_page

from bayes_dea import cli
from bayes_dea.commands.progress import signals


def run(arguments: list[str], said: str, ready: int) -> None:
    """One run, in the fork; leaves by SystemExit."""
    signals.install()
    out = os.open(said, os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(out, 1)
    os.dup2(out, 2)
    sys.argv = ["bayes-dea", *arguments]
    os.write(ready, b"x")
    os.close(ready)
    cli.main()


def serve() -> None:
    """A run for every line of standard input, one after another."""
    sys.argv = ["bayes-dea", *sys.argv[1:]]
    shorten()
    without_page()
    assert cli._run() == 0
    rest(float(os.environ.get("SAMPLER_RESTS_S", "0")))
    while line := sys.stdin.readline():
        *arguments, said = json.loads(line)
        begun, ready = os.pipe()
        child = os.fork()
        if child == 0:
            run(arguments, said, ready)
        os.close(ready)
        os.read(begun, 1)
        os.close(begun)
        print(child, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


if __name__ == "__main__":
    serve()

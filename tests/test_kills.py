"""Runs stopped at random moments: `--resume` ends at exactly the numbers of an undisturbed run (CONTRACT 2)."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from forks import ENVIRONMENT, Forks
from pace import HANGS_S
from tiny_campaign import tiny_campaign

import bayes_dea as bd

SHORT_RUNS = Path(__file__).with_name("short_runs.py")
KILLS = 50
#: as many where the whole has to be done in a quarter of an hour
FEWER = 2
#: share of these in processes of their own, from their first import on
FRESH = 0.25
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)
RESULTS = ["calibration.json", "posterior.nc", "report.html"]


class Fresh:
    """The same in processes of their own."""

    def start(self, arguments):
        self.process = subprocess.Popen([sys.executable, str(SHORT_RUNS), *map(str, arguments)],
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=ENVIRONMENT)
        return self.process.pid

    def running(self, _process):
        return self.process.poll() is None

    def end(self):
        said, _ = self.process.communicate(timeout=HANGS_S)
        return self.process.returncode, said


@pytest.fixture(scope="module")
def tiny(small_campaign, tmp_path_factory):
    return tiny_campaign(small_campaign, tmp_path_factory.mktemp("kills") / "tiny")


def arguments(campaign, out, seed=1):
    return ["calibrate", campaign, "--model", "hooke", "--max-steps", 240, "--out", out, "--seed", seed, "--workers", 1,
            "--checkpoint-seconds", 0, "--quiet"]


def timeless(folder):
    summary = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
    return {k: v for k, v in summary.items() if k not in ("seconds", "seconds_by", "command")}


def numbers(folder):
    data = bd.load_posterior(folder)
    return {(group, name): values.values for group in data.groups() for name, values in data[group].variables.items()}


def assert_whole(folder, seeds):
    """Whatever stands in the folder is whole, of the run before or of this one."""
    left = {p.name for p in folder.iterdir() if not p.name.startswith(".")}
    assert left == set(RESULTS)
    assert json.loads((folder / "calibration.json").read_text(encoding="utf-8"))["seed"] in seeds
    assert (folder / "report.html").read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert bd.load_posterior(folder).posterior.attrs["seed"] in seeds
    for checkpoint in folder.glob(".checkpoint-*.npz"):
        with np.load(checkpoint) as state:
            assert set(state.files) >= {"coords", "chain", "key"}


class Series:
    """Runs of one command, each stopped at a random moment until enough were; the last one of a folder is not."""

    def __init__(self, campaign, root, earlier, undisturbed, seconds):
        self.campaign, self.root, self.earlier = campaign, root, earlier
        self.expected, self.arrays, self.seconds = timeless(undisturbed), numbers(undisturbed), seconds
        self.lock = threading.Lock()
        self.log: list[str] = []

    def folder(self, name):
        """A folder that holds the results of an earlier run, with another seed."""
        return Path(shutil.copytree(self.earlier, self.root / name))

    def carry_out(self, name, runs, kills, seed):
        rng = np.random.default_rng(seed)
        done = ended = 0
        out = self.folder(f"{name}{ended}")
        # how long a run takes that begins, and one that goes on: as seen when one ended, a little more with every kill
        lasts = {False: self.seconds, True: self.seconds}
        while done < kills:
            number = SIGNALS[int(rng.integers(3))]
            goes_on = any(out.glob(".checkpoint-*.npz"))
            began = time.monotonic()
            process = runs.start([*arguments(self.campaign, out), "--resume"])
            until = time.monotonic() + float(rng.uniform(0.0, lasts[goes_on]))
            while time.monotonic() < until and runs.running(process):
                time.sleep(0.002)
            try:
                os.kill(process, number)
            except ProcessLookupError:
                number = None
            status, said = runs.end()
            lasted = time.monotonic() - began
            self.log.append(f"{name} {lasted:.2f} s, {number}: {status}")
            assert "Traceback" not in said or isinstance(runs, Fresh), said
            lasts[goes_on] *= 1.02
            if status == 0:
                lasts[goes_on] = lasted
                self.assert_same(out)
                ended += 1
                out = self.folder(f"{name}{ended}")
                continue
            assert number is not None, f"it ended with {status} by itself: {said}"
            # before Python has come to our first line a signal ends the process as it does any other
            allowed = {128 + number, -number} if isinstance(runs, Fresh) else {128 + number}
            assert status == (-signal.SIGKILL if number == signal.SIGKILL else status)
            assert number == signal.SIGKILL or status in allowed, said
            if status > 0 and not isinstance(runs, Fresh):
                assert said in (f"bayes-dea: {'terminated' if number == signal.SIGTERM else 'interrupted'}; the same "
                                "command with --resume continues\n", ""), said
            with self.lock:  # HDF5 is not made for threads
                assert_whole(out, {1, 2})
            done += 1
        runs.start([*arguments(self.campaign, out), "--resume"])
        status, said = runs.end()
        assert (status, said) == (0, "")
        self.assert_same(out)
        return done

    def assert_same(self, out):
        with self.lock:
            assert timeless(out) == self.expected
            arrays = numbers(out)
            assert arrays.keys() == self.arrays.keys()
            for key, values in self.arrays.items():
                same = (np.array_equal(arrays[key], values, equal_nan=True) if values.dtype.kind == "f"
                        else np.array_equal(arrays[key], values))
                assert same, key
            assert sorted(p.name for p in out.iterdir() if not p.name.startswith(".checkpoint-")) == RESULTS


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no signals and forks")
@pytest.mark.parametrize(("kills", "seed"), [(FEWER, 10), pytest.param(KILLS, 1, marks=pytest.mark.long)])
def test_random_kills(tiny, tmp_path, kills, seed):
    first = Forks(tmp_path / "said1", arguments(tiny, tmp_path / "warm1"))
    second = Forks(tmp_path / "said2", arguments(tiny, tmp_path / "earlier", seed=2))
    try:
        second.start(arguments(tiny, tmp_path / "warm2", seed=3))
        began = time.monotonic()
        first.start(arguments(tiny, tmp_path / "undisturbed"))
        assert first.end() == (0, "")
        assert second.end() == (0, "")
        series = Series(tiny, tmp_path, tmp_path / "earlier", tmp_path / "undisturbed", time.monotonic() - began)
        fresh = round(FRESH * kills)
        half = (kills - fresh) // 2
        rest = kills - fresh - half
        jobs = [("a", first, half, seed), ("b", second, rest, seed + 1), ("c", Fresh(), fresh, seed + 2)]
        with ThreadPoolExecutor(len(jobs)) as pool:
            done = sum(pool.map(lambda job: series.carry_out(*job), jobs))
    finally:
        first.close()
        second.close()
    assert done == kills, series.log
    print("\n".join(series.log))

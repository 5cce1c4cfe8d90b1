"""Runs of models that are no sum of lags, killed and interrupted: what comes out is what an undisturbed run brings."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from hearing import hears_ctrl_c
from pace import HANGS_S
from stream import TOML, device
from test_live_run import served
from threadpoolctl import threadpool_limits

from bayes_dea.bench.device.serve import PtyPort
from bayes_dea.live.follow import make_learner
from bayes_dea.live.journal import Journal
from bayes_dea.live.learner import LearnerSettings
from bayes_dea.live.sequential import SequentialSettings
from bayes_dea.live.setup import read_bench
from bayes_dea.models.model import build_model

MODEL = "hooke+gm1+series_resistance"


def rows_on_disk(out):
    """How many samples are there, told by the size of the file."""
    return sum(p.stat().st_size for p in out.glob("session_*.csv")) / 34


def replayed(out, toml):
    """The last numbers of a learner that takes what is on disk in one go, nothing in between."""
    one = make_learner(build_model(MODEL), read_bench(toml), 1, LearnerSettings(sequential=SequentialSettings(300)))
    evidence, last = 0.0, {}
    with threadpool_limits(1):
        for session, rows in Journal(out, read_bench(toml)).recover():
            one.feed(session, rows)
        while True:
            if not one.ready() and one._opening is not None:
                one._opening.join()
            if not one.ready():
                break
            evidence += one.update().log_evidence
        while (update := one.update(last=True)) is not None:
            evidence += update.log_evidence
            last = update.parameters
    return one, evidence, last


@pytest.mark.long
def test_killed_while_it_opens_and_interrupted_later_it_ends_at_the_same_numbers(tmp_path):
    toml, out = tmp_path / "campaign.toml", tmp_path / "out"
    toml.write_text(TOML)
    arguments = [sys.executable, "-m", "bayes_dea", "live", "--campaign", str(toml), "--model", MODEL, "--out",
                 str(out), "--particles", "300", "--quiet"]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}

    def until(run, rows):
        give_up = time.monotonic() + HANGS_S
        while rows_on_disk(out) < rows and run.poll() is None and time.monotonic() < give_up:
            time.sleep(0.05)
        assert run.poll() is None, "it ended before it was stopped"

    with served(device(), PtyPort(), 8.0) as name:
        arguments += ["--port", name]
        first = subprocess.Popen([*arguments, "--zero", "--play", "demo"], env=environment)
        until(first, 200 * 23)  # 20 s after the first voltage it opens
        first.send_signal(signal.SIGKILL)
        first.wait()
        assert rows_on_disk(out) > 200 * 20
        second = subprocess.Popen([*arguments, "--play", "demo"], env=environment, preexec_fn=hears_ctrl_c)
        until(second, 200 * 35)
        second.send_signal(signal.SIGINT)
        assert second.wait(timeout=HANGS_S) == 130
        written = json.loads((out / "live.json").read_text())
        assert written["learned_samples"] == written["samples"] > 200 * 30
        third = subprocess.run([*arguments, "--resume", "--duration", "5"], env=environment, check=False)
        assert third.returncode == 0
    written = json.loads((out / "live.json").read_text())
    one, evidence, last = replayed(out, toml)
    assert written["complete"]
    assert written["learned_samples"] == written["samples"] == one.samples
    assert written["log_evidence"] == pytest.approx(evidence, abs=1e-9)
    assert written["updates"][-1]["parameters"] == last
    assert written["approximation"] == one.approximation()

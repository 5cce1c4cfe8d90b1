"""diagnose, compare and next stopped at random moments: the same command ends at the numbers of an undisturbed run."""

import json
import os
import signal
import time

import numpy as np
import pytest
from forks import Forks
from tiny_campaign import tiny_campaign

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no signals and forks")

#: by what each verb is stopped in turn, and by what where the whole has to be done in a quarter of an hour
SIGNALS = (signal.SIGTERM, signal.SIGKILL, signal.SIGTERM, signal.SIGKILL)
FEWER = (signal.SIGKILL,)
VERBS = {
    "diagnose": (["--model", "hooke"], "diagnosis.json"),
    "compare": (["--models", "hooke,hooke+gm1"], "comparison.json"),
    "next": (["--model", "hooke", "--files", 1], "next.json"),
}
STOPPED = "bayes-dea: terminated; the same command with --resume continues\n"


@pytest.fixture(scope="module")
def tiny(small_campaign, tmp_path_factory):
    return tiny_campaign(small_campaign, tmp_path_factory.mktemp("kills") / "tiny")


def without_clock(value):
    if isinstance(value, dict):
        return {k: without_clock(v) for k, v in value.items() if k not in ("seconds", "seconds_by", "command")}
    return [without_clock(v) for v in value] if isinstance(value, list) else value


def timeless(folder, file):
    return without_clock(json.loads((folder / file).read_text(encoding="utf-8")))


def files(folder):
    """What a run leaves, without what is kept for another one, and what is in its tables."""
    found = [p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")]
    return {str(p.relative_to(folder)): p.read_bytes() if p.suffix in (".csv", ".toml") else b"" for p in found}


def with_earlier_results(folder, file):
    folder.mkdir()
    for name in (file, "report.html"):
        (folder / name).write_bytes(b"earlier")
    return folder


def assert_whole(folder, file):
    """Each result is that of before, or that of this run to its last byte."""
    if (folder / file).read_bytes() != b"earlier":
        timeless(folder, file)
    page = (folder / "report.html").read_bytes()
    assert page == b"earlier" or page.rstrip().endswith(b"</html>")


def wait(for_what, runs, process):
    while not for_what() and runs.running(process):
        time.sleep(0.002)


@pytest.mark.parametrize("signals", [FEWER, pytest.param(SIGNALS, marks=pytest.mark.long)], ids=len)
@pytest.mark.parametrize("verb", [v if v == "diagnose" else pytest.param(v, marks=pytest.mark.long) for v in VERBS])
def test_random_kills(tiny, tmp_path, verb, signals):
    options, file = VERBS[verb]

    def words(out):
        return [verb, tiny, *options, "--out", out, "--workers", 1, "--quiet", "--resume"]

    undisturbed = tmp_path / "undisturbed"
    runs = Forks(tmp_path / "said", words(tmp_path / "warm"))
    rng = np.random.default_rng(sum(map(ord, verb)))
    try:
        runs.start(words(undisturbed))
        began = time.monotonic()
        assert runs.end() == (0, "")
        lasts = time.monotonic() - began
        expected = timeless(undisturbed, file)
        out = with_earlier_results(tmp_path / "out0", file)
        stopped = tries = 0
        while stopped < len(signals):
            process = runs.start(words(out))
            if stopped == 0:  # once for sure when there is something to go on from
                wait(lambda into=out: any(into.glob(".checkpoint-*")), runs, process)
                until = time.monotonic() + float(rng.uniform(0.0, 0.3 * lasts))
            else:
                until = time.monotonic() + float(rng.uniform(0.0, lasts))
            wait(lambda at=until: time.monotonic() >= at, runs, process)
            if runs.running(process):
                os.kill(process, signals[stopped])
            status, said = runs.end()
            if status == 0:  # it was done before
                assert timeless(out, file) == expected
                lasts *= 0.9
                tries += 1
                assert tries < 20
                out = with_earlier_results(tmp_path / f"out{tries}", file)
                continue
            allowed = (-signal.SIGKILL, "") if signals[stopped] == signal.SIGKILL else (128 + signal.SIGTERM, STOPPED)
            assert (status, said) == allowed
            assert_whole(out, file)
            assert stopped or any(out.glob(".checkpoint-*"))
            stopped += 1
        runs.start(words(out))
        assert runs.end() == (0, "")
    finally:
        runs.close()
    assert timeless(out, file) == expected
    assert files(out) == files(undisturbed)
    assert not list(out.glob(".checkpoint-*")), "what was kept for going on is gone"

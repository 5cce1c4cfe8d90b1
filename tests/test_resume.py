"""Interrupted runs go on to the same numbers (CONTRACT 2), and what must not change the numbers does not."""

import contextlib
import json
import os
import re
import shutil
import signal
import sys
import time
import warnings
from dataclasses import replace

import numpy as np
import pytest
from forks import Forks
from pace import HANGS_S
from short_runs import short_settings, shorten
from tiny_campaign import tiny_campaign

import bayes_dea as bd
from bayes_dea import cli
from bayes_dea.commands.options import begin
from bayes_dea.fit.ensemble import EnsembleSettings
from bayes_dea.results import plain
from bayes_dea.run_state import Checkpoints, checkpoint_for, finished, further

EXIT = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGKILL: -signal.SIGKILL}


def timeless(summary):
    """calibration.json without what must differ between two runs."""
    return {k: v for k, v in plain(summary).items() if k not in ("seconds", "seconds_by", "command")}


def stamps(folder):
    return {p.name: p.stat().st_mtime_ns for p in folder.glob(".checkpoint-*.npz")}


def interrupt(runs, arguments, out, number):
    """Start a calibration, wait for a new checkpoint, send the signal; returns exit status and what was printed."""
    before = stamps(out) if out.is_dir() else {}
    process = runs.start(arguments)
    deadline = time.monotonic() + HANGS_S
    while time.monotonic() < deadline and stamps(out) == before:
        time.sleep(0.005)
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, number)
    status, said = runs.end()
    return (None if status == 0 else status), said  # it may be done before the signal comes


def interrupt_thrice(runs, arguments, out):
    """One run, interrupted by each signal in turn; False when it ended before the last of them reached it."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        status, said = interrupt(runs, arguments, out, number)
        if status is None:
            return False
        assert status == EXIT[number], said
        if number != signal.SIGKILL:
            (line,) = said.splitlines()
            assert line.endswith("the same command with --resume continues")
        left = [p.name for p in out.iterdir()]
        assert len([n for n in left if re.fullmatch(r"\.checkpoint-[0-9a-f]{20}\.npz", n)]) == 1
        assert "calibration.json" not in left, "results are written when there are some"
    return True


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no signals and forks")
@pytest.mark.long
def test_interrupted_and_killed_it_ends_with_the_same_numbers(voltage_campaign, tmp_path):
    """In the sampler, which rests a little after each checkpoint; test_kills.py does it at random, all along a run."""

    def arguments(out):
        return ["calibrate", voltage_campaign, "--model", "hooke+gm1", "--out", out, "--workers", 1, "--quiet",
                "--checkpoint-seconds", 0]

    undisturbed = tmp_path / "undisturbed"
    runs = Forks(tmp_path / "said", arguments(undisturbed), rests_s=0.2)
    try:
        for attempt in range(4):
            out = tmp_path / f"out{attempt}"
            if interrupt_thrice(runs, arguments(out), out):
                break
        else:
            pytest.skip("too busy here to interrupt a run of seconds three times")
        (checkpoint,) = out.glob(".checkpoint-*.npz")
        with np.load(checkpoint) as state:
            done_before = int(state["counts"][0])
        runs.start([*arguments(out), "--resume"])
        assert runs.end() == (0, "")
    finally:
        runs.close()
    s, expected = (json.loads((d / "calibration.json").read_text(encoding="utf-8")) for d in (out, undisturbed))
    assert 20 <= done_before < expected["sampler"]["steps"]
    assert expected["sampler"]["converged"]
    assert timeless(s) == timeless(expected)
    assert sorted(p.name for p in out.iterdir()) == ["calibration.json", "posterior.nc", "report.html"]
    ours, theirs = bd.load_posterior(out), bd.load_posterior(undisturbed)
    for group in ("posterior", "log_likelihood", "posterior_predictive", "prior"):
        for name, values in theirs[group].data_vars.items():
            assert np.array_equal(ours[group][name].values, values.values, equal_nan=True), (group, name)


# ---------------------------------------------------------------- in this process, so that the sampler can be watched

QUICK = short_settings(predictive_draws=20, sampler=EnsembleSettings(max_steps=200, checkpoint_seconds=0.0))


class _StopError(Exception):
    pass


def calibrate(campaign, seed=1, settings=QUICK, model="hooke+gm1", **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.NotConvergedWarning)
        return bd.calibrate(campaign, model, seed, settings, **options)


@pytest.fixture(scope="module")
def campaign(voltage_campaign):
    return bd.load_campaign(voltage_campaign)


@pytest.fixture(scope="module")
def undisturbed(campaign):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bayes_dea.calibration._refit_left_out", lambda a, b, predictions, *rest: predictions)
        return calibrate(campaign)


def steps_of(seen):
    texts = [text for phase, text in seen if phase == "sampling" and text.startswith("step ")]
    return [int(text.split()[1].rstrip(",")) for text in texts]


@pytest.mark.usefixtures("without_refits")
def test_a_resumed_run_does_not_begin_anew(campaign, undisturbed, tmp_path):
    checkpoint = tmp_path / "c.npz"
    first, second = [], []

    def stop(phase, done, of, text):
        first.append((phase, text))
        if phase == "sampling" and text.startswith("step 100,"):
            raise _StopError

    with pytest.raises(_StopError):
        calibrate(campaign, report=stop, checkpoint=checkpoint)
    assert steps_of(first) == [20, 40, 60, 80, 100]
    again = calibrate(campaign, report=lambda phase, done, of, text: second.append((phase, text)),
                      checkpoint=checkpoint)
    assert steps_of(second)[0] == 120
    assert timeless(again.summary) == timeless(undisturbed.summary)
    assert np.array_equal(again.draws, undisturbed.draws)


@pytest.mark.usefixtures("without_refits")
@pytest.mark.parametrize("at", ["between blocks", "inside the density"])
def test_what_was_done_is_kept_when_it_is_interrupted(campaign, undisturbed, tmp_path, monkeypatch, at):
    """A checkpoint in an hour: it is written on the way out, in the middle of a block as it was before the block."""
    from bayes_dea.likelihood.posterior import Posterior

    rare = replace(QUICK, sampler=replace(QUICK.sampler, checkpoint_seconds=3600.0))
    checkpoint = tmp_path / "c.npz"
    seen, calls = [], []
    plain_density = Posterior.log_prob

    def density(self, q):
        calls.append(len(q))
        if armed and len(calls) > armed[0] + 30:  # the second ensemble is at work
            raise KeyboardInterrupt
        return plain_density(self, q)

    armed: list[int] = []

    def stop(phase, done, of, text):
        seen.append((phase, text))
        if phase == "sampling" and text.startswith("step 60,"):
            if at == "between blocks":
                raise KeyboardInterrupt
            armed.append(len(calls))

    with monkeypatch.context() as patch:
        patch.setattr(Posterior, "log_prob", density)
        with pytest.raises(KeyboardInterrupt):
            calibrate(campaign, settings=rare, report=stop, checkpoint=checkpoint)
    assert steps_of(seen)[-1] == 60
    with np.load(checkpoint) as state:
        assert int(state["counts"][0]) == 60
    again = calibrate(campaign, settings=rare, checkpoint=checkpoint)
    assert timeless(again.summary) == timeless(undisturbed.summary)
    assert np.array_equal(again.draws, undisturbed.draws)


def test_resume_and_anew(small_campaign, tmp_path, monkeypatch, capsys):
    """--resume continues or, with nothing to continue, begins; --anew begins; both is a contradiction."""
    from bayes_dea import cli, sampling

    began = []
    sample = sampling.sample

    def watched(*arguments, **options):
        began.append(options["resume_from"])
        return sample(*arguments, **options)

    campaign = tiny_campaign(small_campaign, tmp_path / "tiny")
    monkeypatch.setattr(sampling, "sample", watched)
    monkeypatch.setattr("bayes_dea.report.page.write_report", lambda folder, **_: None)
    shorten(monkeypatch.setattr)

    def run(*options):
        began.clear()
        monkeypatch.setattr(sys, "argv", ["bayes-dea", "calibrate", str(campaign), "--model", "hooke", "--max-steps",
                                          "200", "--out", str(tmp_path / "out"), "--quiet", *options])
        status = cli._run()
        return status, timeless(json.loads((tmp_path / "out" / "calibration.json").read_text(encoding="utf-8")))

    status, first = run("--resume")  # nothing to continue
    assert (status, began) == (0, [None])
    (checkpoint,) = (tmp_path / "out").glob(".checkpoint-*")
    for options, expected in ((["--resume"], [checkpoint]), ([], [checkpoint]), (["--anew"], [None])):
        assert run(*options) == (0, first)
        assert began == expected
    status, _ = run("--anew", "--resume")
    assert status == 2
    assert capsys.readouterr().err == "bayes-dea: --resume and --anew: give one of them\n"
    assert checkpoint.exists()


@pytest.mark.usefixtures("without_refits")
@pytest.mark.long
def test_a_run_that_stopped_too_early_goes_on_when_it_may_take_longer(campaign, undisturbed, tmp_path):
    seen = []
    short = replace(QUICK, sampler=replace(QUICK.sampler, max_steps=100))
    assert calibrate(campaign, settings=short, checkpoint=tmp_path / "c.npz").summary["sampler"]["steps"] == 100
    longer = calibrate(campaign, report=lambda phase, done, of, text: seen.append((phase, text)),
                       checkpoint=tmp_path / "c.npz")
    assert steps_of(seen) == [120, 140, 160, 180, 200]
    assert timeless(longer.summary) == timeless(undisturbed.summary)


@pytest.mark.usefixtures("without_refits")
def test_a_checkpoint_that_does_not_fit_is_not_used(campaign, undisturbed, tmp_path):
    checkpoint = tmp_path / "c.npz"
    calibrate(campaign, seed=2, checkpoint=checkpoint)
    assert checkpoint.exists()
    again = calibrate(campaign, seed=1, checkpoint=checkpoint)  # left by another seed
    assert timeless(again.summary) == timeless(undisturbed.summary)
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])  # damaged
    again = calibrate(campaign, seed=1, checkpoint=checkpoint)
    assert timeless(again.summary) == timeless(undisturbed.summary)


@pytest.mark.long
@pytest.mark.usefixtures("without_refits")
def test_workers_change_no_number(small_campaign):
    both = bd.load_campaign(small_campaign)
    few = replace(QUICK, sampler=replace(QUICK.sampler, max_steps=40), adapt=replace(QUICK.adapt, steps=40))
    one = calibrate(both, settings=replace(few, workers=1))
    for workers in (2, 4):
        more = calibrate(both, settings=replace(few, workers=workers))
        assert timeless(one.summary) == timeless(more.summary)
        assert np.array_equal(one.draws, more.draws)
        for a, b in zip(one.predictions, more.predictions, strict=True):
            assert np.array_equal(a.draws, b.draws)
            assert np.array_equal(a.log_likelihood, b.log_likelihood)


@pytest.mark.usefixtures("without_refits")
def test_another_seed_gives_other_draws(campaign, undisturbed):
    other = calibrate(campaign, seed=2)
    assert not np.array_equal(other.draws, undisturbed.draws)
    # the maximum is the same whatever the swarm's luck
    assert other.map.log_posterior == pytest.approx(undisturbed.map.log_posterior, abs=1e-3)


@pytest.mark.usefixtures("without_refits")
def test_permuted_columns_change_nothing(voltage_campaign, undisturbed, tmp_path):
    folder = shutil.copytree(voltage_campaign, tmp_path / "voltage")
    for path in folder.glob("*.csv"):
        rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
        path.write_text("\n".join(",".join([r[2], r[0], r[1], *r[3:]]) for r in rows) + "\n", encoding="utf-8")
    permuted = calibrate(bd.load_campaign(folder))
    without = [{k: v for k, v in timeless(r.summary).items() if k != "inputs"} for r in (permuted, undisturbed)]
    assert without[0] == without[1]


@pytest.mark.long
def test_order_of_recordings_matters_no_more_than_chance(voltage_campaign, converged, calibrated, tmp_path_factory):
    folder = shutil.copytree(voltage_campaign, tmp_path_factory.mktemp("reversed") / "voltage")
    toml = folder / "campaign.toml"
    parts = re.split(r"(?=\[\[recording\]\])|(?=\[meta\])", toml.read_text(encoding="utf-8"))
    recordings = [p for p in parts if p.startswith("[[recording]]")]
    others = [p for p in parts if not p.startswith("[[recording]]")]
    toml.write_text("".join([others[0], *reversed(recordings), *others[1:]]), encoding="utf-8")
    campaign = bd.load_campaign(folder)
    assert campaign.recordings[0].name == "rectangle_1Hz.csv"
    turned = bd.calibrate(campaign, "hooke+gm1", seed=1, settings=short_settings(predictive_draws=20))
    assert turned.converged
    for name, theirs in converged.summary["parameters"].items():
        ours = turned.parameters[name]
        # of 2,000 stored draws, with an ESS of 400 at least
        assert abs(ours["mean"] - theirs["mean"]) < 5 * theirs["sd"] * np.sqrt(2 / 400), name
        assert ours["map"] == pytest.approx(theirs["map"], rel=1e-3), name
    assert turned.summary["map_log_posterior"] == pytest.approx(converged.summary["map_log_posterior"], abs=1e-2)
    ours, theirs = turned.summary, converged.summary
    spread = np.hypot(ours["log_evidence_se"], theirs["log_evidence_se"])
    assert abs(ours["log_evidence"] - theirs["log_evidence"]) < 5 * spread + 0.02


# ---------------------------------------------------------------- the folder's state

def test_a_checkpoint_is_named_after_its_run(tmp_path):
    run = {"model": "hooke", "seed": 1, "inputs": ["a", "b"]}
    path = checkpoint_for(tmp_path, run)
    assert path.parent == tmp_path
    assert checkpoint_for(tmp_path, dict(reversed(run.items()))) == path
    for other in ({"seed": 2}, {"model": "hooke+gm1"}, {"inputs": ["b", "a"]}):
        assert checkpoint_for(tmp_path, run | other) != path
    path.write_bytes(b"x")
    checkpoint_for(tmp_path, run | {"seed": 2})
    assert path.exists(), "another command must not throw away hours"


def test_what_killed_runs_left_goes_when_one_ends(tmp_path):
    own = checkpoint_for(tmp_path, {"seed": 1})
    rest = [own.name, further(own, 1).name, ".part-x1y2_zz0-.checkpoint-0123.npz", ".part-abcdefgh-posterior.nc"]
    others = [".checkpoint-0123.npz", ".checkpoint-0123_1.npz", ".checkpoint-4567.jsonl"]
    (tmp_path / ".part-folder00").mkdir()
    for name in (*rest, *others, "calibration.json", "notes.txt", ".hidden"):
        (tmp_path / name).write_bytes(b"x")
    finished(tmp_path)
    kept = [own.name, further(own, 1).name, *others, ".hidden", "calibration.json", "notes.txt"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(kept), "this run had none of its own"
    finished(tmp_path, [own])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(kept[2:])


def test_a_folder_notes_which_checkpoints_a_run_asked_for(tmp_path):
    noted = Checkpoints(tmp_path)
    asked = [checkpoint_for(noted, {"seed": k}) for k in range(2)]
    assert noted.own == asked == [checkpoint_for(tmp_path, {"seed": k}) for k in range(2)]


@pytest.mark.parametrize("words", [["diagnose", "--model", "hooke"], ["compare", "--models", "hooke,hooke+gm1"],
                                   ["next", "--model", "hooke", "--files", "1"]], ids=lambda words: words[0])
def test_a_verb_that_ends_leaves_what_another_goes_on_from(small_campaign, tmp_path, monkeypatch, words):
    """All verbs write into the same folder by default: what an interrupted calibration kept must outlive the others."""
    tiny, out = tiny_campaign(small_campaign, tmp_path / "tiny"), tmp_path / "out"
    out.mkdir()
    left = [".checkpoint-0123456789abcdef0123.jsonl", ".checkpoint-0123456789abcdef0123.npz"]
    for name in left:
        (out / name).write_bytes(b"of a run that goes on later")
    monkeypatch.setattr(sys, "argv", ["bayes-dea", words[0], str(tiny), *words[1:], "--out", str(out), "--workers",
                                      "1", "--quiet"])
    assert cli._run() == 0
    assert sorted(p.name for p in out.glob(".*")) == left, "its own, and no other, is gone"


def test_anew_takes_what_further_stages_kept_too(tmp_path):
    own = checkpoint_for(tmp_path, {"seed": 1})
    for path in (own, further(own, 1), further(own, 2)):
        path.write_bytes(b"x")
    begin(own, resume=False, anew=True)
    assert list(tmp_path.iterdir()) == []

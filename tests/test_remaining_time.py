"""Every long phase says how far it is, so that the terminal can say how long it will take."""

import contextlib
import importlib
import io
import re
import sys
import time
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from short_runs import shorten
from tiny_campaign import tiny_campaign

from bayes_dea import cli
from bayes_dea.campaign.schema import Actuator
from bayes_dea.commands.progress import progress
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.fit.evidence import bridge_log_evidence
from bayes_dea.prediction.follow import _Count

#: phases of each verb that may take longer than two seconds
BOUNDED = {
    "calibrate": {"reading recordings", "reading noise", "searching the MAP", "learning a proposal", "sampling",
                  "evidence", "predicting", "writing results", "drawing the page"},
    "compare": {"comparing", "drawing the page"},
    "next_": {"fitting", "scoring the menu", "drawing the page"},
    "diagnose": {"reading noise", "fitting", "refining the fit", "finding starts", "weighing hypotheses", "refitting",
                 "proving", "drawing the page"},
    "predict": {"reading", "predicting", "writing", "drawing the page"},
}
OPTIONS = {
    "calibrate": ["--model", "pz3", "--max-steps", 200],
    "compare": ["--models", "hooke,hooke+gm1"],
    "next_": ["--model", "hooke", "--files", 1],
    "diagnose": ["--model", "hooke"],
}


@pytest.fixture(scope="module")
def tiny(small_campaign, tmp_path_factory):
    return tiny_campaign(small_campaign, tmp_path_factory.mktemp("remaining") / "tiny")


@pytest.fixture
def reports(monkeypatch):
    """`reports(verb, *words)`: shares done by phase, of a run of the command line."""

    def get(verb, *words):
        said = {}

        @contextlib.contextmanager
        def spy(_quiet):
            yield lambda phase, done, of, _text: said.setdefault(phase, []).append(done / of)

        monkeypatch.setattr(importlib.import_module(f"bayes_dea.commands.{verb}"), "progress", spy)
        argv = ["bayes-dea", verb.rstrip("_"), *map(str, words), "--workers", "1", "--quiet"]
        monkeypatch.setattr(sys, "argv", argv)
        shorten(monkeypatch.setattr)
        assert cli._run() == 0
        return said

    return get


@pytest.fixture(scope="module")
def calibration(tiny, tmp_path_factory):
    return tmp_path_factory.mktemp("remaining") / "calibration"


@pytest.mark.parametrize("verb", [
    pytest.param(v, marks=pytest.mark.long) if v in ("diagnose", "next_") else v for v in OPTIONS
])
def test_phases_say_how_far_they_are(tiny, reports, calibration, tmp_path, verb):
    out = calibration if verb == "calibrate" else tmp_path / "out"
    check(reports(verb, tiny, *OPTIONS[verb], "--out", out), BOUNDED[verb])


def check(said, phases):
    for phase in phases:
        shares = [x for x in said.get(phase, []) if x > 0]
        assert shares, f"{phase}: no bound"
        assert max(shares) <= 1.0 + 1e-9, phase
    pages = said["drawing the page"]
    assert pages == sorted(pages)
    assert pages[-1] > 0.6  # a calibration's page is put together after its last picture


@pytest.mark.parametrize("asked", ["--signal", "--wanted"])
def test_predictions_say_how_far_they_are(reports, calibration, tmp_path, asked):
    if not calibration.is_dir():
        pytest.skip("the calibration of this module was not asked for")
    time_s = 1e-3 * np.arange(5000)
    column = "voltage_V" if asked == "--signal" else "displacement_m"
    values = (300.0 if asked == "--signal" else 30e-6) * (1 - np.cos(2 * np.pi * time_s))
    file = tmp_path / "asked.csv"
    np.savetxt(file, np.column_stack([time_s, values]), delimiter=",", header=f"time_s,{column}", comments="")
    said = reports("predict", calibration, asked, file, "--out", tmp_path / "out")
    check(said, BOUNDED["predict"] | ({"inverting"} if asked == "--wanted" else set()))
    if asked == "--wanted":  # a black box: solution after solution
        assert len(said["inverting"]) > 10


def test_rounds_are_taken_to_be_as_long_as_the_longest_before():
    said = []
    count = _Count(lambda done, of: said.append((done, of)))
    for _ in range(10):
        count.add()
    assert said[-1] == (10, 28)
    for _ in range(3):
        count.begin()
        for _ in range(9):
            count.add()
    assert said[-1] == (37, 37)
    assert said[12] == (13, 28)
    assert said[18] == (19, 37)


def test_bridge_sampling_counts_its_densities():
    rng = np.random.default_rng(1)
    draws = rng.standard_normal((2, 500, 4, 2))
    for warp in (False, True):
        from bayes_dea.fit.evidence import BridgeSettings

        said = []
        settings = BridgeSettings(warp=warp)
        bridge_log_evidence(lambda x: -0.5 * np.sum(x**2, axis=1), draws, rng, settings,
                            report=lambda done, of, into=said: into.append((done, of)))
        assert said[-1][0] == said[-1][1]
        assert len(said) >= 8


def test_parts_of_a_diagnosis_count_what_they_try(monkeypatch):
    """Those that a short run does not reach, or passes at once; nothing is fitted here."""
    from bayes_dea.mismatch import ask, left_out, prove
    from bayes_dea.mismatch.readings import reread

    said = []

    def told(_result):
        shares = [done / of for done, of, _ in said]
        said.clear()
        return shares

    def tell(*at):
        said.append(at)

    monkeypatch.setattr(reread, "refit", lambda *_, **__: None)
    for module in (prove, left_out):
        monkeypatch.setattr(module, "refit_without", lambda *_: None)
    monkeypatch.setattr(reread, "_expected_chi2", lambda *_: float("inf"))
    monkeypatch.setattr(prove, "held_out", lambda *_: [])
    for told_by_prior in ("own_index", "_untold"):
        monkeypatch.setattr(prove, told_by_prior, lambda *_: ())
    monkeypatch.setattr(ask, "separation", lambda *_: 1.0)

    @dataclass(frozen=True)
    class Pieces:
        pieces: tuple = ()
        model: object = None

    pieces = tuple(SimpleNamespace(name=n, channel="displacement", nodes=None) for n in "abcd")
    fit = SimpleNamespace(problem=Pieces(pieces), q=None, noise=None, clean=[None] * 4, slopes=[None] * 4)
    assert told(reread.odd_one_out(fit, None, None, tell)) == [0, 0.25, 0.5, 0.75]
    assert told(prove.leave_out_in_turn(fit, fit, None, ("b", "c"), tell)) == [0, 0.5]
    actuator = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8, electrode_area_m2=7.56e-5,
                        total_area_m2=1.145e-4, max_voltage_V=1000.0, max_frequency_Hz=10.0)
    limits = limits_of_actuator(actuator, True)
    n = len(ask.menu(limits))
    assert n > 5
    assert told(ask.next_experiment([fit, fit], ["a", "b"], limits, tell)) == [k / n for k in range(n)]
    voltage = SimpleNamespace(nodes=1, recording=SimpleNamespace(hold="end"))
    monkeypatch.setattr(reread, "with_hold", lambda piece, hold: piece)
    for reach in ("within_reach", "_never_noise"):
        monkeypatch.setattr(reread, reach, lambda *_: None)
    assert told(reread.other_holds(SimpleNamespace(problem=Pieces((voltage,)), q=None), None, None, tell)) == [0, 0.5]


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_bar_has_a_remaining_time_from_the_first_report_on(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=False) as report:
        report("reading", 0, 1, "")
        time.sleep(0.3)
        report("reading", 1, 30, "file.csv")
        time.sleep(0.3)
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", sys.stderr.getvalue())
    last = [line for line in re.split(r"[\r\n]+", drawn) if "file.csv" in line][-1]
    times = re.findall(r"(\d+):(\d\d):(\d\d)", last)
    assert len(times) == 2, last
    assert 3 <= 60 * int(times[1][1]) + int(times[1][2]) <= 60

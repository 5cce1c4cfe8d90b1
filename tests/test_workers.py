"""The same seed gives the same numbers with any number of workers."""

import json
import sys

import numpy as np
import pytest
from short_runs import shorten, without_page
from tiny_campaign import tiny_campaign

import bayes_dea as bd
from bayes_dea import cli

CASES = {
    "diagnose": (["diagnose", "--model", "hooke"], "diagnosis.json"),
    "compare": (["compare", "--models", "hooke,hooke+gm1"], "comparison.json"),
    "nonlinear": (["calibrate", "--model", "yeoh+gm1", "--max-steps", 200], "calibration.json"),
    "effect": (["calibrate", "--model", "hooke+series_resistance", "--max-steps", 200], "calibration.json"),
}


@pytest.fixture(scope="module")
def tiny(small_campaign, tmp_path_factory):
    return tiny_campaign(small_campaign, tmp_path_factory.mktemp("workers") / "tiny")


def without_clock(value):
    if isinstance(value, dict):
        return {k: without_clock(v) for k, v in value.items() if k not in ("seconds", "seconds_by", "command")}
    return [without_clock(v) for v in value] if isinstance(value, list) else value


@pytest.mark.parametrize("case", [
    pytest.param(c, marks=pytest.mark.long) if c in ("effect", "nonlinear", "diagnose") else c for c in CASES
])
def test_one_worker_and_two(tiny, tmp_path, monkeypatch, case):
    shorten(monkeypatch.setattr)
    without_page(monkeypatch.setattr)
    (verb, *options), file = CASES[case]
    found = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        words = [verb, tiny, *options, "--out", out, "--workers", workers, "--quiet"]
        monkeypatch.setattr(sys, "argv", ["bayes-dea", *map(str, words)])
        assert cli._run() == 0
        found.append(without_clock(json.loads((out / file).read_text(encoding="utf-8"))))
    one, two = found
    assert one == two
    if verb == "calibrate":
        ours, theirs = (bd.load_posterior(tmp_path / w) for w in "12")
        for group in ours.groups():
            for name, values in ours[group].variables.items():
                same = values.dtype.kind != "f" or np.array_equal(values, theirs[group][name], equal_nan=True)
                assert same, (group, name)

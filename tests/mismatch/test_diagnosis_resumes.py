"""An interrupted diagnosis goes on from what it has kept."""

import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.descent import approach
from bayes_dea.gauss_newton.journal import Journal, digest
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.weigh import within_reach

RESISTOR = {"series_resistance": {"R_s_ohm": 1.2e5}}


class InterruptedRunError(Exception):
    """Stands for whatever ends a run."""


def numbers(summary):
    """A summary without what a clock says."""
    return json.dumps({k: v for k, v in summary.items() if not k.startswith("seconds")}, sort_keys=True)


@pytest.mark.long  # test_kills_other_verbs.py stops a smaller one wherever chance has it
def test_an_interrupted_diagnosis_ends_at_the_same_numbers(diagnosed, tmp_path, monkeypatch):
    whole = diagnosed("series_resistance", RESISTOR["series_resistance"])
    file = tmp_path / "checkpoint.jsonl"
    campaign = concealed(RESISTOR)
    put, left = Journal.put, 0

    def failing(self, key, value):
        nonlocal left
        left -= 1
        if left < 0:
            raise InterruptedRunError
        put(self, key, value)

    monkeypatch.setattr(Journal, "put", failing)
    rng = np.random.default_rng(3)
    for _ in range(2):
        left = int(rng.integers(20, 400))
        with pytest.raises(InterruptedRunError):
            diagnose(campaign, "hooke+gm3", seed=1, checkpoint=file)
    with file.open("ab") as out:  # cut off in the middle of a line
        out.write(b'["0123", [1.0, [')
    entries = file.read_bytes().count(b"\n")
    assert entries > 40
    left = 10**9
    again = diagnose(campaign, "hooke+gm3", seed=1, checkpoint=file)
    assert numbers(again.summary) == numbers(whole.summary)
    total = file.read_bytes().count(b"\n")
    assert total > entries
    # nothing is worked out twice: a further run adds no line
    assert numbers(diagnose(campaign, "hooke+gm3", seed=1, checkpoint=file).summary) == numbers(whole.summary)
    assert file.read_bytes().count(b"\n") == total


def test_what_is_given_up_on_the_way_or_not_ends_at_the_same_numbers(tmp_path):
    """Cut off between the approach and the refit, whose first step must not hang on what the approach had at hand."""
    left_out = {"series_resistance": {"R_s_ohm": 6e5}, "amplitude_softening": {"dE_Pa": 2e5, "e_c": 0.01}}
    problem, prior, middle = problem_of(concealed(left_out), "hooke+gm2")
    q = refit(problem, middle, prior.start(), prior).q
    q[: problem.model.dimension] += 0.1 * np.random.default_rng(6).standard_normal(problem.model.dimension)
    file = tmp_path / "j.jsonl"
    journal = Journal(file)
    whole = within_reach(replace(problem, journal=journal), q, prior, math.inf)
    journal.close()
    plain = within_reach(problem, q, prior, math.inf)
    lines = file.read_bytes().splitlines(keepends=True)
    assert len(lines) == 2
    file.write_bytes(lines[0])
    again = within_reach(replace(problem, journal=Journal(file)), q, prior, math.inf)
    assert np.array_equal(again.q, whole.q)
    assert np.array_equal(plain.q, whole.q)
    assert again.log_evidence == whole.log_evidence == plain.log_evidence
    end = approach(problem, q, prior.start())
    assert not end.exact  # the premise
    assert within_reach(problem, q, prior, end.value - 1.0) is None


def test_a_journal_keeps_every_digit_and_survives_a_cut(tmp_path):
    file = tmp_path / "j.jsonl"
    x = np.random.default_rng(1).standard_normal(5) * 1e-7
    j = Journal(file)
    j.put("a", x.tolist())
    j.put("b", [float("nan"), float("-inf"), None])
    j.close()
    file.write_bytes(file.read_bytes() + b'["c", [1.0')
    j = Journal(file)
    assert np.array_equal(np.array(j["a"]), x)
    assert np.isnan(j["b"][0])
    assert j["b"][1] == -np.inf
    assert "c" not in j
    j.put("c", 1)
    j.close()
    assert Journal(file)["c"] == 1


def test_a_journal_of_nothing_leaves_no_file(tmp_path):
    file = tmp_path / "j.jsonl"
    Journal(file).close()
    assert not file.exists()
    j = Journal(file)
    j.put("a", 1)
    j.close()
    assert file.exists()


def test_a_digest_depends_on_every_part_and_not_on_the_make_of_a_number():
    a = np.arange(3.0)
    assert digest(1.5, [a], {"x": 2.0}) == digest(np.float64(1.5), (a.copy(),), {"x": np.float64(2.0)})
    others = [a, a[:2], np.nextafter(a, 9.0), a.reshape(1, 3), a.astype(int), "a", 1, 1.0, True, None, [a, a]]
    assert len({digest(x) for x in others}) == len(others)


def test_resume_and_anew_exclude_each_other(tmp_path):
    words = ("diagnose", str(tmp_path), "--model", "hooke+gm3", "--resume", "--anew")
    done = subprocess.run([sys.executable, "-m", "bayes_dea", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--resume and --anew: give one of them" in done.stderr


@pytest.mark.long
def test_a_campaign_with_an_odd_recording_goes_on_to_the_same_numbers(tmp_path):
    """Fits without it begin where a coarse descent ended: what that had carried along is not kept, nor is it used."""
    campaign = concealed()
    odd = replace(campaign, recordings=tuple(
        replace(r, columns={**r.columns, "displacement_m": 1.1 * r.columns["displacement_m"]})
        if r.name == "sine_10Hz.csv" else r for r in campaign.recordings))  # fmt: skip
    file = tmp_path / "checkpoint.jsonl"
    whole = diagnose(odd, "hooke+gm3", seed=1, checkpoint=file)
    assert "sine_10Hz.csv" in " ".join(whole.summary["warnings"])
    lines = file.read_bytes()
    again = diagnose(odd, "hooke+gm3", seed=1, checkpoint=file)
    assert numbers(again.summary) == numbers(whole.summary)
    assert file.read_bytes() == lines


@pytest.mark.parametrize("what", ["actuator", "commands", "zeros", "prior"])
def test_another_campaign_recalls_nothing(what):
    """Whatever predictions come from is part of the key under which a fit is kept, to the last digit."""
    campaign = concealed(pressed=True)
    problem, prior, q = problem_of(campaign)
    model = problem.model
    if what == "actuator":
        thin = replace(campaign.recordings[0].actuator, layer_thickness_m=20e-6)
        other = problem_of(replace(campaign, recordings=tuple(replace(r, actuator=thin) for r in campaign.recordings)))
    elif what == "commands":
        other = problem_of(replace(campaign, recordings=tuple(
            replace(r, columns={**r.columns, "voltage_V": 0.8 * r.columns["voltage_V"]}) if r.is_voltage else r
            for r in campaign.recordings)))  # fmt: skip
    elif what == "zeros":
        other = (replace(problem, zero_mean=problem.zero_mean + 1e-9), prior, q)
    else:
        narrow = [replace(p, prior=replace(p.prior, b=np.nextafter(p.prior.b, 9.0))) if p.name == "Y_Pa" else p
                  for p in model.parameters]  # fmt: skip
        other = (problem.with_model(replace(model, parameters=tuple(narrow))), prior, q)
    assert other[0].key != problem.key
    assert problem_of(campaign)[0].key == problem.key

"""Proposals from a campaign: limits, files, plans, sources, repeatability, errors."""

import json
import math
import sys

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.campaign import load_campaign
from bayes_dea.design.sources import from_comparison, leading, of_diagnosis
from bayes_dea.design.store import terminal_summary
from bayes_dea.errors import InputError
from bayes_dea.experiments.costs import Costs
from bayes_dea.experiments.menu import Experiment

QUICK = bd.ProposalSettings(refine=1, evaluations=8, draws=600, costs=Costs(longest_rest_s=1800.0))


@pytest.fixture(scope="module")
def made(electric, tmp_path_factory):
    from dataclasses import replace

    folder = tmp_path_factory.mktemp("next")
    result = bd.propose(electric, model="hooke+gm1", settings=replace(QUICK, plan=2, refine=3, evaluations=30), seed=3,
                        checkpoints=folder)
    result.summary["command"] = ["bayes-dea", "next", "x"]
    result.save(folder)
    return result, folder


def test_the_ranking_is_by_gain_an_hour_within_the_limits(made):
    result, _ = made
    ranking = result.summary["ranking"]
    assert len(ranking) > 130
    rates = [e["gain_per_hour"] for e in ranking]
    assert rates == sorted(rates, reverse=True)
    assert rates[0] > 0
    for e in ranking:
        x = e["experiment"]
        # no limit is stated for this actuator: nothing beyond what was recorded
        assert x.get("voltage_V", 0.0) + x.get("amplitude_V", 0.0) <= 900.0 * (1 + 1e-12)
        assert x.get("frequency_Hz", 0.0) <= 100.0
        assert e["cost_s"] == pytest.approx(sum(e["cost"].values()))
        assert e["gain_per_hour"] == pytest.approx(3600 * e["expected_information_gain_nats"] / e["cost_s"])
        assert x["kind"] in ("creep", "sine", "triangle", "rectangle", "voltage")
    assert any("max_voltage_V" in w for w in result.summary["warnings"])
    assert {n["kind"] for n in result.summary["not_offered"]} == {"blocked_force", "load", "capacitance", "compression",
                                                                 "relaxation"}


def test_next_json_and_files(made):
    _, folder = made
    content = json.loads((folder / "next.json").read_text(encoding="utf-8"))
    assert content["for"] == "parameters"
    assert content["model"] == "hooke+gm1"
    assert {"ranking", "statement", "seconds", "seconds_by", "seed", "version", "inputs", "warnings"} <= set(content)
    assert {"experiment", "expected_information_gain_nats", "se", "cost_s", "gain_per_hour", "why"} \
        <= set(content["ranking"][0])
    assert (folder / "next" / "costs.toml").is_file()
    with_file = [e for e in [*content["ranking"], *content["plan"]["experiments"]] if e["file"]]
    assert len(with_file) >= 12
    for e in with_file:
        path = folder / e["file"]
        assert path.read_text().splitlines()[0] == "time_s,voltage_V"
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        assert np.all(np.diff(table[:, 0]) > 0)
        assert table[:, 1].max() <= 900.0
        assert table[-1, 0] == pytest.approx(e["experiment"]["duration_s"], rel=0.01, abs=0.6)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<img ") >= 4
    assert "<script" not in page


def test_what_is_printed_fits_80_columns(made):
    text = terminal_summary(made[0].summary)
    assert max(map(len, text.splitlines())) <= 80


def test_a_plan_adds_less_with_each_step_and_narrows_more(made):
    s = made[0].summary
    steps = s["plan"]["experiments"]
    assert len(steps) == 2
    assert steps[0]["experiment"] == s["ranking"][0]["experiment"]
    # gains are estimated from draws: what is stated as their standard error is what the order may be off by
    first, second = ((e["gain_per_hour"], 3600 * e["se"] / e["cost_s"]) for e in steps)
    assert second[0] <= first[0] + 2 * np.hypot(first[1], second[1])
    assert np.hypot(first[1], second[1]) < 0.2 * first[0]
    assert all(s["intervals_after"]["plan"][k] <= v + 1e-9 for k, v in s["intervals_after"]["first"].items())
    assert min(s["intervals_after"]["first"].values()) < 0.9
    for name, (low, high) in s["intervals_after"]["first_range"].items():
        assert 0 < low <= high
        assert name in s["intervals_after"]["first"]
    assert any("is rough" in w for w in s["warnings"]) == bool(s["intervals_after"]["rough"])


def test_widths_that_depend_on_where_the_truth_lies_are_rough():
    from bayes_dea.design.propose import rough_widths

    expected = {"a": 0.5, "b": 0.5, "c": 0.99, "d": 0.1}
    ranges = {"a": (0.45, 0.55), "b": (0.1, 0.8), "c": (0.2, 0.99), "d": (0.4, 0.5)}
    assert rough_widths(expected, ranges) == ["b", "d"]


def test_refined_settings_are_no_worse_than_the_grid(made):
    from bayes_dea.experiments.menu import menu

    result, _ = made
    grid = {(e.pattern, *e.settings.values()) for e in menu(result.ranking[0].experiment.limits)}
    refined = [p for p in result.ranking if (p.experiment.pattern, *p.experiment.settings.values()) not in grid]
    assert refined, "some settings were moved off the grid"
    for p in refined:
        rivals = [q for q in result.ranking if q.experiment.pattern == p.experiment.pattern and q is not p]
        assert p.per_hour >= max(q.per_hour for q in rivals)


def test_same_seed_same_numbers_also_from_kept_fits(electric, made):
    from dataclasses import replace

    result, folder = made
    assert list(folder.glob(".checkpoint-*")), "the fit was kept"
    again = bd.propose(electric, model="hooke+gm1", settings=replace(QUICK, plan=2, refine=3, evaluations=30), seed=3,
                       checkpoints=folder)
    assert again.summary["ranking"] == result.summary["ranking"]


def test_commands_can_be_predicted(made, tmp_path):
    """The command file goes through the reader of signals."""
    from bayes_dea.prediction.signal import read_signal

    result, folder = made
    signal = read_signal(folder / result.best["file"])
    assert signal.column == "voltage_V"


@pytest.mark.long
def test_between_models_the_gain_is_at_most_what_is_unknown(campaign):
    result = bd.propose(campaign, "models", models="hooke+gm1,hooke+gm2", settings=QUICK, seed=1)
    s = result.summary
    p = np.array(list(s["probabilities"].values()))
    assert p.sum() == pytest.approx(1.0)
    assert s["entropy_nats"] == pytest.approx(-np.sum(p * np.log(p)))
    assert all(e["expected_information_gain_nats"] <= s["entropy_nats"] + 4 * e["se"] + 1e-6 for e in s["ranking"])
    assert {e["experiment"]["kind"] for e in s["ranking"]} >= {"compression", "relaxation", "creep", "sine"}
    assert s["models"] == list(s["probabilities"])


def test_a_longer_experiment_teaches_more(electric, made):
    """Common random numbers: the same experiment, held longer, never teaches less."""
    from bayes_dea.design.hypotheses import FitSettings, fitted_beliefs
    from bayes_dea.design.questions import OfParameters
    from bayes_dea.models.model import build_model

    beliefs, _ = fitted_beliefs(electric, {"hooke+gm1": build_model("hooke+gm1")}, 3, FitSettings(draws=600),
                                lambda *_: None)
    question = OfParameters.of(beliefs[0], 1)
    limits = made[0].ranking[0].experiment.limits
    nats = [question.ask(Experiment("creep", (1.0, x), limits)).nats for x in (0.1, 0.3, 0.5, 0.7)]
    assert nats == sorted(nats)
    assert nats[-1] > nats[0] + 0.05


def test_hypotheses_of_a_diagnosis():
    def summary(members, p):
        return {"model": "hooke+gm3", "indistinguishable": members,
                "hypotheses": [{"name": n, "probability": v} for n, v in p.items()]}

    p = {"series_resistance": 0.6, "sensor_lag": 0.3, "unknown": 0.06, "none": 0.04}
    named = of_diagnosis(summary(["series_resistance", "sensor_lag", "unknown"], p))
    assert named.names == ("series_resistance", "sensor_lag")
    assert named.specs == ("hooke+gm3+series_resistance", "hooke+gm3+sensor_lag")
    assert any("unknown" in n for n in named.notes)
    alone = of_diagnosis(summary(["series_resistance"], p))
    assert alone.names[0] == "series_resistance"
    assert len(alone.names) > 1
    assert alone.notes


def test_leading_structures():
    named = leading([("a", 0.7), ("b", 0.295), ("c", 0.005), ("d", 0.0)])
    assert named.names == ("a", "b")
    assert leading([("a", 1.0), ("b", 0.0)]).names == ("a", "b")
    with pytest.raises(InputError, match="one structure"):
        leading([("a", 1.0)])


@pytest.mark.parametrize("models", ["hooke+gm2, hooke+gm3", "hooke+gm2..3", "Hooke+GM2,hooke+gm3",
                                    ["hooke+gm2", " hooke+gm3"]])
def test_structures_of_a_comparison_are_named_as_for_a_comparison(tmp_path, models):
    """--from or not, the list is read by the same rules; probabilities are those of the comparison."""
    p = {"hooke+gm1": 0.9, "hooke+gm2": 0.06, "hooke+gm3": 0.04}
    ranking = [{"model": n, "probability": v} for n, v in p.items()]
    (tmp_path / "comparison.json").write_text(json.dumps({"ranking": ranking}))
    named, _ = from_comparison(tmp_path, models)
    assert named.names == ("hooke+gm2", "hooke+gm3")
    assert named.probability == (0.06, 0.04)
    with pytest.raises(InputError, match=r"--models hooke\+gm4: .* compared hooke\+gm1"):
        from_comparison(tmp_path, "hooke+gm3..4")


@pytest.mark.parametrize(("options", "said"), [
    ({"purpose": "fun"}, "--for fun"),
    ({}, "--model SPEC"),
    ({"model": "hooke+gmm1"}, "gmm1"),
    ({"models": "hooke,hooke+gm1"}, "--model SPEC, not --models"),
    ({"purpose": "models"}, "--models SPEC"),
    ({"purpose": "models", "models": "hooke"}, "two"),
    ({"model": "hooke", "settings": bd.ProposalSettings(plan=0)}, "--plan 0"),
    ({"model": "hooke", "settings": bd.ProposalSettings(max_voltage_V=-3.0)}, "--max-voltage"),
    ({"model": "hooke", "settings": bd.ProposalSettings(max_frequency_Hz=1e4)}, "--max-frequency"),
    ({"source": "nowhere"}, "--from nowhere: holds no calibration.json; give the --out of `bayes-dea calibrate`"),
    ({"purpose": "diagnosis", "source": "nowhere"}, "diagnosis.json"),
    ({"purpose": "models", "source": "nowhere"}, "comparison.json"),
    ({"purpose": "models", "models": "hooke+gm1,hooke+gkv1"}, "are one and the same function"),
])
def test_what_cannot_be_asked_is_said(electric, options, said):
    with pytest.raises(InputError, match=said):
        bd.propose(electric, **options)


@pytest.mark.parametrize(("options", "said"), [
    (["--model", "hooke", "--max-voltage", "-5"], "--max-voltage -5: give a positive number of V"),
    (["--model", "hooke", "--max-frequency", "nan"], "--max-frequency nan: give a positive number of Hz"),
    (["--from", "nowhere"], "--from nowhere: holds no calibration.json"),
])
def test_what_no_campaign_can_have_is_said_before_one_is_read(monkeypatch, capsys, tmp_path, options, said):
    from bayes_dea import campaign, cli

    def unread(*_, **__):
        raise AssertionError("the campaign was read")

    monkeypatch.setattr(campaign, "load_campaign", unread)
    monkeypatch.setattr(sys, "argv", ["bayes-dea", "next", "campaign", "--out", str(tmp_path / "out"), *options])
    assert cli._run() == 2
    assert said in capsys.readouterr().err


def test_command_line(command, tmp_path, once):
    from bayes_dea.bench.run import run_bench

    small = once("next-small", lambda folder: run_bench(folder, "small"))
    out = tmp_path / "out"
    done = command("next", str(small), "--model", "hooke+gm1", "--out", str(out), "--json", "--max-voltage", "1000")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["limits"]["max_voltage_V"] == 1000.0
    assert content["command"][1] == "next"
    assert not list(out.glob(".checkpoint-*"))
    assert math.isfinite(content["ranking"][0]["gain_per_hour"])
    assert {"relaxation", "compression"} <= {e["experiment"]["kind"] for e in content["ranking"]}
    assert load_campaign([small]).name
    wrong = command("next", str(small), "--model", "hooke+gm1", "--for", "nothing", "--out", str(tmp_path / "no"))
    assert wrong.returncode == 2
    assert len(wrong.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "no").exists()

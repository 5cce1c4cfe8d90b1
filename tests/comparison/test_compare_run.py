"""A comparison as a whole, on a campaign of a minute."""

import math
from dataclasses import replace

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.comparison.common import Restricted, common_data
from bayes_dea.comparison.run import ComparisonSettings, compare
from bayes_dea.errors import InputError
from bayes_dea.models.model import build_model

KEYS = {"model", "probability", "log_evidence", "log_evidence_se", "elpd", "elpd_se", "elpd_diff", "elpd_diff_se",
        "parameters", "converged"}


def test_every_function_is_ranked_once(compared):
    s = compared.summary
    ranked = [e["model"] for e in s["ranking"]]
    assert all(set(e) >= KEYS for e in s["ranking"])
    assert sorted(["hooke+gm2", "hooke+gkv2"]) in [sorted(g) for g in s["equivalent"]]
    assert len([n for n in ranked if n in ("hooke+gm2", "hooke+gkv2")]) == 1
    values = [e["log_evidence"] for e in s["ranking"]]
    assert values == sorted(values, reverse=True)
    assert sum(e["probability"] for e in s["ranking"]) == pytest.approx(1.0)
    partner = next(p for p in s["partners"] if p["model"] == "hooke+gkv2")
    assert abs(partner["likelihood_gap_nats"]) < 0.01
    assert partner["through_priors_alone"] is not None
    assert "hooke+gkv2" in s["statement"] or compared.best != "hooke+gm2"


def test_the_bench_is_viscoelastic(compared):
    s = compared.summary
    assert s["ranking"][-1]["model"] == "hooke"
    question = next(q for q in s["questions"] if "viscoelastic" in q["question"])
    assert question["answer"] == "yes"
    assert question["elpd_diff"] > 0
    assert ranking(s, "hooke")["rmse_m"] > ranking(s, "hooke+gm2")["rmse_m"]


def ranking(s, name):
    return next(e for e in s["ranking"] if e["model"] == name)


def test_evidence_of_a_second_name_is_what_a_run_of_its_own_finds(voltage_campaign):
    one = compare(voltage_campaign, "hooke+gm1,hooke+gkv1,hooke", seed=1)
    partner = one.summary["partners"][0]
    assert partner["model"] == "hooke+gkv1"
    other = compare(voltage_campaign, "hooke+gkv1,hooke", seed=1)
    own = ranking(other.summary, "hooke+gkv1")
    assert own["log_evidence"] == pytest.approx(
        partner["log_evidence"], abs=4 * math.hypot(own["log_evidence_se"], partner["log_evidence_se"]) + 0.02)


def test_scores_are_what_integrals_of_their_own_find(compared):
    """p(recording | others) by reweighting against the ratio of two integrals."""
    from bayes_dea.comparison.integrate import IntegralSettings
    from bayes_dea.comparison.leave_out import _integral

    d = compared.done["hooke+gm1"]
    fitted = frozenset(p.name for g in d.fit.posterior.groups for p in g.fitted)
    for s in d.scores:
        if s.recording not in ("creep.csv", "kept.csv"):
            continue
        names = fitted - {s.recording} if s.role == "identify" else fitted | {s.recording}
        other = _integral(Restricted(d.fit.posterior, names), d.fit.posterior, d.fit.x, np.random.default_rng(5),
                          IntegralSettings())
        expected = (d.whole.log_value - other.log_value) * (1 if s.role == "identify" else -1)
        assert s.elpd == pytest.approx(expected, abs=4 * math.hypot(s.mc_se, other.se) + 0.05), s.recording


def test_curved_laws_are_scored_like_straight_ones(campaign, compared):
    """The likelihood in blocks of Hooke's law against that of every sample, at the same parameters."""
    from bayes_dea.likelihood.block_group import build_block_groups

    fit = compared.done["hooke+gm2"].fit
    prepared = [p for p in fit.assembled.prepared if p.recording.is_voltage]
    channel = next(c for c in fit.posterior.channels if c.channel == "displacement")
    blocks = build_block_groups(prepared, fit.assembled.terms, channel.rates, "displacement")
    groups = (*blocks, *(g for g in fit.posterior.groups if g.channel == "force"))
    from bayes_dea.comparison.fit_one import reference_at

    other = reference_at(replace(fit.assembled, posterior=replace(fit.assembled.posterior, groups=groups)), fit.x)
    assert float(other.log_likelihood(fit.x[None])[0]) == pytest.approx(fit.log_likelihood, abs=0.3)
    # a recording that is only predicted counts every sample as well
    for name in ("kept.csv", "creep.csv"):
        a, b = (float(Restricted(p, frozenset([name])).log_prob(fit.x[None])[0]) for p in (other, fit.posterior))
        assert a == pytest.approx(b, abs=0.3), name


def test_same_seed_same_numbers_whatever_the_order(voltage_campaign):
    a = compare(voltage_campaign, "hooke+gm1,hooke", seed=3)
    b = compare(voltage_campaign, "hooke,hooke+gm1", seed=3)
    for name in ("hooke", "hooke+gm1"):
        assert ranking(a.summary, name)["log_evidence"] == ranking(b.summary, name)["log_evidence"]
        assert ranking(a.summary, name)["elpd"] == ranking(b.summary, name)["elpd"]


def test_what_was_done_is_not_done_again(voltage_campaign, tmp_path, monkeypatch):
    from bayes_dea.comparison import run

    whole = compare(voltage_campaign, "hooke+gm1,hooke", seed=3)
    real, names = run._one, []

    def stops(name, *rest):
        names.append(name)
        if name == "hooke+gm1":
            raise KeyboardInterrupt
        return real(name, *rest)

    monkeypatch.setattr(run, "_one", stops)
    with pytest.raises(KeyboardInterrupt):
        compare(voltage_campaign, "hooke,hooke+gm1", seed=3, checkpoints=tmp_path)
    names.clear()
    monkeypatch.setattr(run, "_one", lambda name, *rest: names.append(name) or real(name, *rest))
    again = compare(voltage_campaign, "hooke,hooke+gm1", seed=3, checkpoints=tmp_path)
    assert names == ["hooke+gm1"]
    for name in ("hooke", "hooke+gm1"):
        for key in ("log_evidence", "elpd", "probability"):
            assert ranking(again.summary, name)[key] == ranking(whole.summary, name)[key]
        assert ranking(again.summary, name)["prior_widths"] == ranking(whole.summary, name)["prior_widths"]
    names.clear()
    compare(voltage_campaign, "hooke,hooke+gm1", seed=4, checkpoints=tmp_path)  # another run: nothing is taken over
    assert sorted(names) == ["hooke", "hooke+gm1"]


def test_a_black_box_is_compared_on_voltage_alone(campaign):
    data = common_data(campaign, [build_model("pz3"), build_model("hooke+gm2")])
    assert all(r.is_voltage for r in data.campaign.recordings)
    assert "relax.csv" in data.notes[0]
    assert "pz3 knows no force" in data.notes[0]
    assert common_data(campaign, [build_model("hooke+gm1"), build_model("hooke+gm2")]).notes == ()
    only_force = replace(campaign, recordings=tuple(r for r in campaign.recordings if r.is_mechanical))
    with pytest.raises(InputError, match="voltage recordings only"):
        common_data(only_force, [build_model("pz3"), build_model("hooke+gm2")])


def test_one_recording_cannot_be_left_out(voltage_campaign):
    alone = replace(voltage_campaign, recordings=voltage_campaign.recordings[:1])
    s = compare(alone, "hooke,hooke+gm1").summary
    assert s["recordings"] == []
    assert any("cannot be left out" in w for w in s["warnings"])
    assert not math.isfinite(s["ranking"][0]["elpd"])


def test_priors_reach_the_models_that_have_them(voltage_campaign):
    from bayes_dea.comparison.run import built_models
    from bayes_dea.priors import Prior

    prior = Prior("lognormal", 9.0, 0.1)
    built = built_models(["hooke", "hooke+gm1"], {"tau_1_s": prior})
    assert next(p for p in built["hooke+gm1"].parameters if p.name == "tau_1_s").prior == prior
    with pytest.raises(InputError, match=r"none of the models has it; did you mean tau_1_s\? They have Y"):
        built_models(["hooke", "hooke+gm1"], {"tau_7_s": prior})


def test_names_in_the_flat_namespace(compared):
    assert bd.compare is compare
    assert bd.ComparisonSettings is ComparisonSettings
    assert isinstance(compared, bd.Comparison)


def test_the_answer_in_words():
    from bayes_dea.comparison.words import statement

    def entry(name, evidence, scores):
        return {"model": name, "log_evidence": evidence, "probability": 0.9, "elpd": sum(scores), "scores": scores,
                "elpd_diff": 0.0, "elpd_diff_se": 1.0}

    a, b = entry("a", 0.0, [3.0] * 6), {**entry("b", -2.0, [2.0] * 6), "elpd_diff": -6.0, "elpd_diff_se": 9.0}
    s = {"ranking": [a, b], "equivalent": [["a", "c"]], "cannot_tell": [["a", "b"]], "tell_apart": [
        {"models": ["a", "b"], "decisive": True, "expected_nats": 12.0,
         "experiment": {"kind": "creep", "voltage_V": 1200.0, "duration_s": 3600.0}}]}
    text = statement(s)
    assert "support a (the same function as c) most" in text
    assert "also predicts recordings left out best" in text
    assert "better on 6 of 6" in text
    assert "cannot tell a from b; a creep recording at 1200 V for 3600 s could tell it from b" in text
    s["tell_apart"][0]["decisive"] = False
    assert "nor would any experiment" in statement(s)
    s["cannot_tell"] = []
    assert "cannot" not in statement(s)


@pytest.mark.long
def test_populations_find_the_scores_that_integrals_find(voltage_campaign):
    """Two ways to what a recording left out is worth, for a model whose posterior is simple enough for both."""
    from bayes_dea.comparison.integrate import IntegralSettings
    from bayes_dea.comparison.leave_out import _Scoring

    d = compare(voltage_campaign, "hooke,hooke+gm2", seed=2).done["hooke+gm2"]
    fitted = frozenset(p.name for g in d.fit.posterior.groups for p in g.fitted)
    scoring = _Scoring(d.fit, replace(d.whole, method="annealed"), d.whole.draws, fitted, IntegralSettings())
    apart = []  # in stated errors, over three recordings and four draws of populations
    for s in d.scores:
        p = next(p for p in d.fit.assembled.prepared if p.name == s.recording)
        for seed in range(4):
            other = scoring._curved(p, -1.0 if s.role == "identify" else 1.0, np.random.default_rng(seed))
            assert other.method == "annealed"
            assert other.mc_se < 0.5
            apart.append((other.elpd - s.elpd) / math.hypot(s.mc_se, other.mc_se))
    # the error of a few populations is known to a factor of two (1.4 over 36 draws); one draw may be 4 off
    assert np.sqrt(np.mean(np.square(apart))) < 2.0


def test_correlation_at_a_rate_that_is_left_out_is_unseen(compared):
    from bayes_dea.comparison.leave_out import unseen

    posterior = compared.done["hooke+gm1"].fit.posterior
    names = {p.name for g in posterior.groups for p in g.fitted}
    assert len(unseen(posterior, frozenset(names))) == 0
    # the sine alone was sampled at 100 Hz
    (rho,) = unseen(posterior, frozenset(names - {"sine.csv"}))
    assert rho >= posterior.zero_start + len(posterior.zeros) + 1
    assert len(unseen(posterior, frozenset(names - {"relax.csv"}))) == 3  # zero, sigma and rho of the force


@pytest.mark.long
def test_hopeless_models_are_spared_whatever_the_order(compared, voltage_campaign):
    from bayes_dea.comparison.run import hopeless

    s = ComparisonSettings()
    best = max(d.fit.laplace for d in compared.done.values())
    for name, d in compared.done.items():
        assert d.spared == (best - d.fit.log_likelihood > s.hopeless_nats), name
        if d.spared:  # what it is spared for: no evidence beyond its likelihood
            assert d.whole.log_value < best - s.hopeless_nats
    assert compared.done["hooke"].spared
    assert not compared.done[compared.best].spared
    assert not hopeless(compared.done["hooke"].fit, -np.inf, s)
    for models in ("hooke,hooke+gm1", "hooke+gm1,hooke"):
        done = compare(voltage_campaign, models, seed=3).done
        assert done["hooke"].spared
        assert not done["hooke+gm1"].spared


def test_what_was_spared_and_did_not_settle_is_said():
    from bayes_dea.comparison.words import notes_of

    entries = [{"model": "a", "spared": False, "converged": False}, {"model": "b", "spared": True, "converged": True},
               {"model": "c", "spared": True, "converged": False}]
    (note,) = notes_of(entries)
    assert note.startswith("c: fits so much worse")
    assert notes_of(entries[:2]) == []

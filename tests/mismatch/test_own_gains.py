"""A sensor whose gain differs from recording to recording hides no physics, and is none."""

import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of
from test_campaign_faults import with_column

from bayes_dea.bench.concealed import draw_case
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch import sought
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.readings.instead_of_gains import better_than_gains
from bayes_dea.mismatch.readings.own_gains import (
    MOVED,
    Loosened,
    apart,
    gains_of,
    may_take_much,
    own_gains,
    worth_a_search,
)
from bayes_dea.mismatch.readings.seen import Seen
from bayes_dea.mismatch.search import name
from bayes_dea.mismatch.search.naming import Naming, across_readings
from bayes_dea.mismatch.where.features import features

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "runs" / "concealed"))

from study import campaign_of


def resized(campaign, factors):
    """Displacements of the recordings times these, in their order."""
    for r, factor in zip(campaign.recordings, factors, strict=True):
        campaign = with_column(campaign, r.name, lambda y, _, factor=factor: factor * y)
    return campaign


#: sd 1.3 %; the sensor's statement allows 5 % either way
FACTORS = 1.0 + np.array([0.015, -0.01, 0.0, 0.02, -0.018, 0.004, -0.012])


def fitted(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior), prior


@pytest.mark.parametrize(("campaign", "better"), [
    (lambda: concealed({"holder_resonance": {"holder_share": 0.004, "holder_Hz": 11.0, "holder_zeta": 0.05}}), True),
    pytest.param(lambda: concealed({"output_backlash": {"play_m": 2e-6}}, scale=0.3), True, marks=pytest.mark.long),
    (concealed, False),
    pytest.param(lambda: resized(concealed(), FACTORS), False, marks=pytest.mark.long),
])  # fmt: skip
def test_what_explains_more_than_gains_do_is_looked_for(campaign, better):
    fit, prior = fitted(campaign())
    loose = own_gains(fit, fit.problem.pieces, prior)
    assert better_than_gains(fit, loose, prior) is better
    # nor is it by more than it leads, or where a sensor does not resolve it
    assert not better_than_gains(fit, loose, prior, behind=1e4)
    assert not better_than_gains(fit, loose, prior, 1e-5)


def test_one_step_tells_whether_gains_may_take_much():
    """What a resistance leaves no gain takes, and no fit is made to see that; gains that differ are looked at."""
    fit, prior = fitted(concealed({"series_resistance": {"R_s_ohm": 3e5}}))
    assert not may_take_much(fit, fit.problem.pieces, prior)
    assert Loosened(prior).where_worth(fit, fit.problem.pieces) is None
    assert own_gains(fit, fit.problem.pieces, prior) is not None  # which is what it says nothing of
    apart_fit, prior = fitted(resized(concealed(), FACTORS))
    assert may_take_much(apart_fit, apart_fit.problem.pieces, prior)
    loosened = Loosened(prior)
    assert loosened.where_worth(apart_fit, apart_fit.problem.pieces) is loosened(apart_fit, apart_fit.problem.pieces)


@pytest.mark.long
def test_a_resonance_is_no_gain_of_each_recording():
    rings = {"holder_resonance": {"holder_share": 0.004, "holder_Hz": 11.0, "holder_zeta": 0.05}}
    c = concealed({**rings, "mains_pickup": {"mains_m": 0.5e-6, "mains_Hz": 50.0}})
    s = diagnose(c, "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown"
    assert s["statement"].startswith("A resonance at ")
    assert "gain differs" not in s["statement"]


def test_gains_are_read_with_their_errors():
    fit, prior = fitted(resized(concealed(validate=False), FACTORS))
    loose = own_gains(fit, fit.problem.pieces, prior)
    assert loose is not None
    assert loose.log_evidence > fit.log_evidence + 100.0
    assert worth_a_search(fit, loose, prior, lambda _: False)
    assert own_gains(loose, apart(fit.problem.pieces), prior) is None  # they are apart already
    found = gains_of(loose)
    expected = FACTORS / np.exp(np.mean(np.log(FACTORS)))
    off = (np.array(list(found.ratio.values())) - expected) / np.array(list(found.se.values()))
    assert np.abs(off).max() < 4.0
    assert np.sqrt(np.mean(off**2)) < 2.0
    assert found.widest == ("triangle_1Hz.csv", "rectangle_1Hz.csv")
    assert found.allowed
    assert found.sigmas > 10.0


def test_one_gain_is_enough_where_there_is_one():
    fit, prior = fitted(concealed(validate=False))
    loose = own_gains(fit, fit.problem.pieces, prior)
    assert loose.log_evidence < fit.log_evidence
    assert not worth_a_search(fit, loose, prior, lambda _: True)  # likelier it has to be


def test_gains_are_worth_a_search_where_they_leave_nothing_to_be_seen(monkeypatch):
    """However little that is of what noise has beyond its stated level."""
    before, after = SimpleNamespace(log_evidence=0.0, left=350.0), SimpleNamespace(log_evidence=80.0, left=220.0)
    monkeypatch.setattr("bayes_dea.mismatch.readings.own_gains.excess", lambda fit, _: fit.left)
    assert not worth_a_search(before, after, None, lambda _: False)
    assert worth_a_search(before, after, None, lambda fit: fit is after)
    assert worth_a_search(before, SimpleNamespace(log_evidence=80.0, left=150.0), None, lambda _: False)
    assert not worth_a_search(before, SimpleNamespace(log_evidence=2.0, left=150.0), None, lambda _: True)


@pytest.mark.long
def test_nothing_is_left_out_of_a_model_whose_recordings_have_gains_of_their_own(monkeypatch):
    """Nor are pairs of effects tried first for what is better explained by gains."""
    monkeypatch.setattr(name, "beside_the_leader", lambda *_: pytest.fail("a pair is looked for"))
    s = diagnose(resized(concealed(), FACTORS), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none", s["statement"]
    assert "gain differs from recording to recording" in s["statement"]
    assert "within its stated accuracy" in s["statement"]
    assert s["mismatch"]["detected"]
    assert s["mismatch"]["in_readings"]
    assert [w["recording"] for w in s["mismatch"]["where"][:2]] == ["triangle_1Hz.csv", "rectangle_1Hz.csv"]
    assert s["proof"]["rmse_after_m"] < 1.03 * s["proof"]["noise_m"]
    json.dumps(s)


@pytest.mark.long
def test_physics_is_named_beside_them(monkeypatch):
    hidden, begun = {"series_resistance": {"R_s_ohm": 4e5}}, []
    plain = sought.name_physics

    def watched(*args, **known):
        begun.append([fit.problem.model.spec.effects for fit in known["begun"]])
        return plain(*args, **known)

    monkeypatch.setattr(sought, "name_physics", watched)
    s = diagnose(resized(concealed(hidden), FACTORS), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "series_resistance", s["statement"]
    assert "gain differs" in s["statement"]
    own = s["hypotheses"][0]["parameters"]["R_s_ohm"]
    assert abs(own["mean"] - 4e5) < 4.0 * own["sd"]
    # what gains have shown to be enough is known of when the search begins anew with them
    assert begun[0] == []
    assert ("series_resistance",) in begun[1]


@pytest.mark.parametrize(("effects", "factors", "at_once"), [
    ({}, FACTORS - 0.3 * (FACTORS - 1.0), True),
    pytest.param({"series_resistance": {"R_s_ohm": 1.2e5}}, FACTORS, False, marks=pytest.mark.long),
])  # fmt: skip
@pytest.mark.long
def test_no_effect_is_fitted_where_gains_leave_nothing_and_none_promises_more(monkeypatch, effects, factors, at_once):
    ended, search = [], sought.name_physics

    def spied(*args, **kwargs):
        ended.append(search(*args, **kwargs))
        raise KeyboardInterrupt

    monkeypatch.setattr(sought, "name_physics", spied)
    with pytest.raises(KeyboardInterrupt):
        diagnose(resized(concealed(effects, validate=False), factors), "hooke+gm3")
    assert isinstance(ended[0], name.ReadOtherwise) is at_once


@pytest.mark.long
def test_gains_that_the_sensor_does_not_allow_are_unknown():
    s = diagnose(resized(concealed(), 1.0 + 6.0 * (FACTORS - 1.0)), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "unknown", s["statement"]
    assert "beyond its stated accuracy" in s["statement"]
    assert s["repair"]["stage"] == "sensor"
    assert len(s["repair"]["terms"]) == 5


@pytest.mark.long
def test_one_recording_of_another_size_is_of_another_actuator():
    """That is one thing that differs, not one for each recording."""
    s = diagnose(resized(concealed(), [1.0, 1.0, 1.04, 1.0, 1.0, 1.0, 1.0]), "hooke+gm3", seed=1).summary
    assert "sine_10Hz.csv: this recording does not belong" in s["statement"]
    assert "gain differs" not in s["statement"]


@pytest.mark.long
def test_pairs_that_were_put_off_are_sought_where_gains_do_not_settle_it(monkeypatch):
    """On the grids that the first search has filled."""
    asked, grids = [], []
    monkeypatch.setattr(sought, "_taken_by_gains", lambda *_: 300.0)
    monkeypatch.setattr(sought, "_with_gains_that_matter", lambda *_: [])
    monkeypatch.setattr(sought, "_reread", lambda *_: None)

    def watched(base, looks, brief, rng, otherwise, memory, **_):
        asked.append(otherwise(base))
        grids.append(memory)
        return SimpleNamespace(best=SimpleNamespace(adequate=False), put_off=asked[-1] > 0.0)

    monkeypatch.setattr(sought, "name_physics", watched)
    campaign = concealed(validate=False)
    fit, prior = fitted(campaign)
    seen = Seen(fit, fit.problem.pieces, prior)
    ready = SimpleNamespace(seen=seen, prior=prior, campaign=campaign, resolution_m=1e-7, limit=None)
    _, naming = sought.sought(ready, None, 3, np.random.default_rng(1), lambda *_: None)
    assert asked == [300.0, 0.0]
    assert grids[0] is grids[1]
    assert not naming.put_off


@pytest.mark.parametrize(("promised", "sought_first", "put_off"), [
    pytest.param(*x, marks=pytest.mark.long)
    for x in [(240.0, True, False), (200.0, False, True), (90.0, False, False)]
])
def test_what_a_pair_has_to_promise(monkeypatch, promised, sought_first, put_off):
    """Nearly as much as gains bring, or they are tried first; less than a third of that, and no pair is looked for."""
    campaign = concealed({"series_resistance": {"R_s_ohm": 3e5}, "strain_stiffening": {"beta": 300.0}}, validate=False)
    fit, prior = fitted(campaign)
    tried = []
    monkeypatch.setattr(name, "promised_beside", lambda *_: promised)
    monkeypatch.setattr(name, "beside_the_leader", lambda w, *_: tried.append(w) or (w, []))
    for further in ("second_thoughts", "in_place_of_the_first", "beside_the_next"):
        monkeypatch.setattr(name, further, lambda *_: [])
    found = name.name_physics(
        fit, [features(p) for p in fit.problem.pieces], name.Brief(campaign, prior, 1.5e-7), np.random.default_rng(1),
        otherwise=lambda _: 300.0,
    )  # fmt: skip
    assert not found.best.adequate
    assert (bool(tried), found.put_off) == (sought_first, put_off)


def test_gains_of_one_fit_are_worked_out_once(monkeypatch):
    asked = []
    monkeypatch.setattr("bayes_dea.mismatch.readings.own_gains.own_gains", lambda *of: asked.append(of))
    pieces, fewer, fit = (1, 2, 3, 4), (1, 2, 3), object()
    with_gains = Loosened(None)
    for seen in (pieces, pieces, fewer, pieces):
        assert with_gains(fit, seen) is None
    assert asked == [(fit, pieces, None), (fit, fewer, None)]


@pytest.mark.long
def test_a_limit_of_one_recording_is_no_gain_of_that_recording():
    """A supply that ends at 1066 V, on one creep to 1100 V, readings late by 0.9 ms: gains were taken unsearched."""
    case = draw_case(1565260)
    assert set(case.effects) == {"supply_saturation"}
    result = diagnose(campaign_of(case), case.model, seed=1)
    assert result.verdict == "supply_saturation"
    assert result.summary["warnings"][0].startswith("timing:")
    limit = result.summary["hypotheses"][0]["parameters"]["V_max_V"]
    assert limit["q05"] < case.effects["supply_saturation"]["V_max_V"] < limit["q95"]


def test_what_the_other_reading_needs_is_a_rival_of_what_this_one_does():
    """By Bayes' rule over both, where both leave nothing."""
    def naming(weights, adequate=True):
        return Naming(None, SimpleNamespace(adequate=adequate), {}, weights, {}, {}, weights)

    loose = naming({"none": -100.0, "supply_saturation": -103.0, "unknown": -150.0})
    tight = naming({"none": -500.0, "supply_saturation": -105.0, "unknown": -151.0})
    found = across_readings(loose, math.log(MOVED), tight).probability
    none, limit = MOVED * math.exp(-100.0), MOVED * math.exp(-103.0) + math.exp(-105.0)
    assert found["none"] == pytest.approx(none / (none + limit))
    assert found["supply_saturation"] == pytest.approx(limit / (none + limit))
    assert sum(found.values()) == pytest.approx(1.0)
    # what leaves something says nothing of its rivals
    assert across_readings(loose, math.log(MOVED), naming(tight.log_weight, adequate=False)) is loose

"""A search that begins anew because its best pair has shown false readings goes on from that pair."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search import name
from bayes_dea.mismatch.search.name import Brief, Spoiled, name_physics
from bayes_dea.mismatch.where.features import features


@pytest.fixture(scope="module")
def fit_and_brief():
    effects = {"series_resistance": {"R_s_ohm": 3e5}, "supply_dead_zone": {"V_dead_V": 40.0}}
    campaign = concealed(effects, validate=False)
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior), Brief(campaign, prior, 1.5e-7)


def searched(fit_and_brief, **given):
    fit, brief = fit_and_brief
    looks = [features(p) for p in fit.problem.pieces]
    return name_physics(fit, looks, brief, np.random.default_rng(1), **given)


def pairs_are_spoiled(fit):
    return fit.problem.model.name.count("+") > 2


@pytest.mark.long
def test_it_hands_on_the_pair_and_the_next_one_looks_for_none(fit_and_brief, monkeypatch):
    asked = []
    beside = name.beside_the_leader
    monkeypatch.setattr(name, "beside_the_leader", lambda *of: asked.append(of) or beside(*of))
    first = searched(fit_and_brief, spoiled=pairs_are_spoiled)
    assert isinstance(first, Spoiled)
    assert asked
    assert first.known[0].problem.model.name == "hooke+gm3+series_resistance+supply_dead_zone"
    assert all(f.log_evidence > first.known[0].log_evidence - 40.0 for f in first.known)
    asked.clear()
    second = searched(fit_and_brief, begun=first.known)
    assert not asked
    assert second.best.weighed.effects == ("series_resistance", "supply_dead_zone")
    assert second.best.adequate
    assert second.best.weighed.log_evidence == pytest.approx(first.known[0].log_evidence, abs=1.0)
    assert second.probability["series_resistance+supply_dead_zone"] > 0.99


@pytest.mark.long
def test_where_single_effects_are_spoiled_there_is_nothing_to_hand_on(fit_and_brief):
    assert searched(fit_and_brief, spoiled=lambda fit: fit.problem.model.name != "hooke+gm3") == Spoiled()

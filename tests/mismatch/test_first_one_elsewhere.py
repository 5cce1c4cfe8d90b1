"""The first of two effects, looked for again beside the second: alone it may have ended elsewhere."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search import second_thoughts
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within


def test_a_grid_says_that_it_is_elsewhere(monkeypatch):
    monkeypatch.setattr(second_thoughts, "own_index", lambda fit, model: np.array([2, 0]))

    def model(names):
        return SimpleNamespace(priors=SimpleNamespace(names=names, scales=lambda: np.array([2.0, 1.0, 0.5])))

    def best(*points):
        return SimpleNamespace(model=model(("a", "b", "c")), points=[SimpleNamespace(own=np.array(p)) for p in points])

    fit = SimpleNamespace(problem=SimpleNamespace(model=model(("c", "a", "b"))), q=np.array([5.0, 3.0, 1.0]))
    pair, alone = SimpleNamespace(fit=fit), SimpleNamespace(fit=None)
    assert not second_thoughts._elsewhere(best((5.04, 3.19), (5.0, 3.0)), pair, alone)  # c is known to 0.5, a to 2
    assert second_thoughts._elsewhere(best((5.06, 3.0), (5.0, 3.0)), pair, alone)
    assert second_thoughts._elsewhere(best((5.0, 2.79), (5.0, 3.0)), pair, alone)
    assert not second_thoughts._elsewhere(best((5.06, 3.0), (5.05, 3.0)), pair, alone)  # the grid is as coarse
    assert second_thoughts._elsewhere(best((9.0, 9.0)), pair, alone)  # the grid has nothing near it
    assert second_thoughts._elsewhere(best((9.0, 3.0), (8.5, 3.0), (8.1, 3.0)), pair, alone)
    fit.problem.model = model(("c", "a"))  # another law, without b
    assert not second_thoughts._elsewhere(best((5.06, 3.0), (5.0, 3.0)), pair, alone)


@pytest.mark.long
def test_a_mass_that_rings_at_another_frequency_is_found_beside_a_dead_zone():
    """1551017: a mass of 386 Hz led alone, at 560 Hz; with the dead zone it stayed there, 188 nats behind."""
    true = {"supply_dead_zone": {"V_dead_V": 137.0}, "inertia": {"f_1_Hz": 386.0, "zeta": 0.03}}
    result = diagnose(concealed(true), "hooke+gm3", seed=1)
    known = result.naming.weighed["supply_dead_zone+inertia"]
    fit, prior, base = known.fit, noise_prior(result.assembled), result.base
    names = list(true)
    q = fit.q.copy()
    q[fit.problem.model.priors.names.index("f_1_Hz")] = np.log(587.0)
    stuck = refit(fit.problem, q, fit.noise, prior, max_steps=0, fit_noise=False)
    pair = replace(known, fit=stuck, value=np.inf)
    given = effect_priors(names, result.assembled.campaign)
    quest = Quest(base, tuple(names), given, prior, np.random.default_rng(1))
    alone = within(pair, base, extended(base.problem.model, names[:1], given), prior)
    found = second_thoughts.beside_the_second(pair, alone, quest)
    assert [w.effects for w in found] == [known.effects]
    assert found[0].fit.objective < fit.objective + 1.0
    assert second_thoughts.beside_the_second(known, alone, quest) == []

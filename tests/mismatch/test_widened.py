"""An effect that contains another one of an explanation, looked for in its place."""

from dataclasses import dataclass

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of, weigher

from bayes_dea.gauss_newton.laws import laws_of_effect
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.beside import puts_back
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relabel import within
from bayes_dea.mismatch.search.second_thoughts import beside_the_narrow, merged, widened
from bayes_dea.mismatch.search.weigh import Weighed

LEAK = {"R_leak_ohm": 5e8, "R_s_ohm": 6e4, "E_0_V_per_m": 1.2e6}


@pytest.mark.long
def test_a_leak_is_found_where_a_resistance_did_its_work():
    result = diagnose(concealed({"leakage": LEAK}), "hooke+gm3", seed=1)
    known = result.naming.weighed
    campaign, base = result.assembled.campaign, result.base
    prior, model = noise_prior(result.assembled), base.problem.model
    given = effect_priors(["series_resistance", "leakage"], campaign)
    narrow = within(known["leakage"], base, extended(model, ["series_resistance"], given), prior)
    quest = Quest(base, ("series_resistance", "leakage"), given, prior, np.random.default_rng(1))
    found = widened(narrow, quest)
    best = max(found, key=lambda w: w.log_evidence)
    assert best.effects == ("leakage",)
    assert best.log_evidence > narrow.log_evidence + 100
    assert abs(best.log_evidence - known["leakage"].log_evidence) < 5
    assert best.size_m > 1e-6
    # where it is no candidate, or is there already, nothing is looked for
    assert widened(narrow, quest.among(["series_resistance"])) == []
    assert widened(known["leakage"], quest) == []


def test_a_leak_found_beside_a_resistance_is_a_leak():
    """Both together are the same model; here without any search, from the truth."""
    problem, prior, q = problem_of(concealed({"leakage": LEAK}))
    base = refit(problem, q, prior.start(), prior)
    model = problem.model
    both = extended(model, ["series_resistance", "leakage"], {})
    start = Weighed((), base, base.log_evidence, 0.1, 0.0)
    pair = within(start, base, both, prior)
    assert set(pair.effects) == {"series_resistance", "leakage"}
    quest = Quest(base, (), {}, prior, np.random.default_rng(1))
    (leak,) = merged([pair, start], quest)
    assert leak.effects == ("leakage",)
    assert leak.fit.objective == pytest.approx(pair.fit.objective, abs=1.0)
    assert leak.log_evidence > base.log_evidence + 100.0
    assert merged([leak], quest) == []


@pytest.mark.parametrize("c_eps", [-3.0, 0.0])
def test_beside_a_resistance_another_effect_may_do_what_a_leak_does_beyond_it(c_eps):
    """1567150: a leak left nothing, as the true pair did, of which nobody had thought."""
    second = {} if c_eps == 0.0 else {"stretch_dependent_permittivity": {"c_eps": c_eps}}
    campaign = concealed({"series_resistance": {"R_s_ohm": 25e3}, **second}, scale=0.5)
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    names = ("series_resistance", "leakage", "stretch_dependent_permittivity", "sensor_nonlinearity")
    given = effect_priors(names, campaign)
    quest = Quest(base, names, given, prior, np.random.default_rng(1))
    (law,) = (law for law in laws_of_effect("leakage", given) if law)
    narrow = weigher(problem, prior, base, given, base.values())("series_resistance", R_s_ohm=25e3)
    leaking = weigher(problem, prior, base, {**given, **law}, base.values())
    leak = leaking("leakage", R_s_ohm=25e3, R_leak_ohm=1e8, E_0_V_per_m=3e6)
    found = {w.effects: w.log_evidence for w in beside_the_narrow(leak, narrow, quest)}
    if c_eps == 0.0:
        assert found == {}
        return
    assert leak.log_evidence > narrow.log_evidence + 10.0
    assert found["series_resistance", "stretch_dependent_permittivity"] > leak.log_evidence - 3.0
    assert not any("leakage" in effects for effects in found)


def test_what_would_be_put_back_into_what_is_known_is_not_looked_for():
    """Of leak, softening and drift the resistance in the leak's place leads back to the leak; one without drift not."""

    @dataclass(frozen=True)
    class Stub:
        effects: tuple[str, ...]

    leak = Stub(("leakage", "amplitude_softening", "sensor_drift"))
    assert puts_back(Stub(("series_resistance", "amplitude_softening", "sensor_drift")), leak)
    assert not puts_back(Stub(("series_resistance", "amplitude_softening")), leak)
    assert not puts_back(Stub(("amplitude_softening", "sensor_drift")), leak)
    both = Stub(("series_resistance", "supply_dead_zone", "amplitude_softening"))
    assert not puts_back(Stub(("series_resistance", "amplitude_softening")), both)

"""When the search for further effects ends: what a grid promises, and what a second effect leaves."""

import math
from types import SimpleNamespace

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search import name as naming
from bayes_dea.mismatch.search import promising, weigh
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.grid import screen
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended

CROSSTALK = {"crosstalk_m_per_V": 3e-8, "tau_crosstalk_s": 0.015}


@pytest.fixture
def tried():
    """What every hypothesis that a descent is begun for adds to its base."""
    return []


@pytest.fixture
def fitted(monkeypatch, tried):
    """Effects of every hypothesis that is fitted; not of those that are given up on the way."""
    out = []

    def watched(base, screened, *args, **more):
        tried.append((base.problem.model.spec.effects, set(screened.effects) - set(base.problem.model.spec.effects)))
        found = refine(base, screened, *args, **more)
        out.extend([] if found is None else [screened.effects])
        return found

    refine = promising.refine
    monkeypatch.setattr(promising, "refine", watched)
    return out


@pytest.mark.long
def test_no_pair_is_fitted_where_none_promises_a_tenth_of_what_is_left(fitted, tried):
    """A crosstalk of the supply is on no list; beside what does best alone nothing takes it away."""
    result = diagnose(concealed({"edge_crosstalk": CROSSTALK}), "hooke+gm3", seed=1)
    assert result.verdict == "unknown"
    assert not result.naming.best.adequate
    assert len(fitted) > 3
    assert {len(effects) for effects in fitted} == {1}
    # a mass alone may lie between the points of its grid: a descent is begun for it, and given up
    assert [added for there, added in tried if there] == [{"inertia"}]


@pytest.mark.parametrize(("once", "at_most", "begun"), [(True, 0.0, 1), (False, 0.0, 2), (True, math.inf, 2)])
def test_of_what_is_dear_one_start_is_enough_where_that_is_given_up(monkeypatch, once, at_most, begun):
    """at_most: nothing is as good as that; with infinity the first is, and the second point counts."""
    problem, prior, q = problem_of(concealed({"sensor_lag": {"tau_s_s": 0.02}}))
    base = refit(problem, q, prior.start(), prior)
    given = effect_priors(["sensor_lag"], concealed())
    grid = screen([Frame(base)], extended(problem.model, ["sensor_lag"], given), ("sensor_lag",))
    points, approach = set(), weigh.approach

    def watched(problem, q, *args):
        points.add(float(q[problem.model.priors.names.index("tau_s_s")]))
        return approach(problem, q, *args[:-1], math.inf)  # none is given up on its way

    monkeypatch.setattr(weigh, "approach", watched)
    found = weigh.refine(base, grid, prior, 2, at_most=at_most, once=once)
    assert (found is None) is (at_most == 0.0)
    assert len(points) == begun


@pytest.mark.long
def test_no_third_effect_is_looked_for_where_the_second_leaves_most(fitted, monkeypatch):
    """Branches that relax more slowly when they are unloaded: the best pair leaves more than half, were all fitted."""
    monkeypatch.setattr(promising, "SHARE", 0.0)
    monkeypatch.setattr(naming, "_STEP", 0.0)
    result = diagnose(concealed({"asymmetric_viscosity": {"unload_ratio": 10.0}}), "hooke+gm3", seed=1)
    assert result.verdict == "unknown"
    assert {len(effects) for effects in fitted} == {1, 2}


def test_beside_others_what_is_dear_to_simulate_is_fitted_last_of_what_is_fitted_in_any_case():
    def order(base_effects):
        model = SimpleNamespace(spec=SimpleNamespace(effects=base_effects))
        base = SimpleNamespace(problem=SimpleNamespace(model=model))
        return [s.effects[-1] for s in promising._in_order(base, screened)]

    gains = {"inertia": 90.0, "sensor_lag": 80.0, "mullins_softening": 70.0, "leakage": 60.0, "sensor_drift": 50.0,
             "acquisition_delay": 40.0, "rate_independent_hysteresis": 30.0, "charge_retention": 20.0}
    screened = [SimpleNamespace(effects=("series_resistance", name), gain=gain) for name, gain in gains.items()]
    assert order(()) == list(gains)
    assert order(("series_resistance",)) == [
        "sensor_lag", "leakage", "sensor_drift", "acquisition_delay", "inertia", "mullins_softening",
        "rate_independent_hysteresis", "charge_retention",
    ]


def test_a_mass_has_to_promise_less_as_its_peak_is_narrower_than_the_steps_of_a_grid():
    def of(*effects):
        return SimpleNamespace(effects=effects)

    left = 10_000.0 + promising.SMALL
    assert promising.asked_of(of("supply_current_limit", "sensor_lag"), ("supply_current_limit",), left) == 1000.0
    assert promising.asked_of(of("supply_current_limit", "inertia"), ("supply_current_limit",), left) < 500.0
    # what is looked for beside a mass has no such peak
    assert promising.asked_of(of("sensor_lag", "inertia"), ("inertia",), left) == 1000.0


def test_what_is_dear_is_given_up_where_it_leaves_much():
    """Beside two that are dear no third is looked for, so that they have to explain it: 40 % of 10,000 nats, not 70."""
    pieces = (SimpleNamespace(blocks=SimpleNamespace(n=2000)),)

    def most(there, effects, left=1e4):
        base = SimpleNamespace(problem=SimpleNamespace(
            pieces=pieces, model=SimpleNamespace(spec=SimpleNamespace(effects=there))))
        refits = promising._Refits(base, [], SimpleNamespace(prior=None), left)
        return refits._most(SimpleNamespace(effects=effects))

    friction = ("rate_independent_hysteresis",)
    assert most(friction, (*friction, "inertia")) == pytest.approx(1000.0 + 4000.0)
    assert most(("sensor_lag",), ("sensor_lag", "inertia")) == pytest.approx(1000.0 + 7000.0)
    assert most(friction, (*friction, "sensor_lag")) == float("inf")
    assert most(friction, (*friction, "inertia"), left=150.0) == float("inf")

"""What has been weighed: what replaces what, what counts, and with what prior odds."""

import math
from dataclasses import dataclass, field, replace

import pytest

from bayes_dea.mismatch.search.hypotheses import Odds
from bayes_dea.mismatch.search.known import Known


@dataclass(frozen=True, eq=False)
class Peak:
    objective: float


@dataclass(frozen=True)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float
    size_m: float = 1e-6
    fit: object = field(default_factory=lambda: Peak(0.0))
    refitted: bool = True

    @property
    def name(self):
        return "+".join(self.effects)


NONE = Stub((), 0.0, 0.0)
ODDS = Odds(none=0.4, single=0.4, double=0.1, unknown=0.1, shifted=0.2)


def known(*weighed):
    return Known(NONE, 1e-7, ODDS, 20, (), {w.name: w for w in weighed})


def test_a_grid_does_not_replace_what_was_found_from_elsewhere():
    far = Stub(("leakage", "sensor_lag"), 86088.9)
    k = known(far)
    k.take([Stub(far.effects, 83770.1)])  # the same pair, on the grid of another search
    assert k.weighed[far.name] is far
    finer = Stub(far.effects, 86080.0)  # drawn along its ridge: Laplace's evidence had been too high
    k.take([finer, Stub(("inertia",), 5.0)])
    assert k.weighed[far.name] is finer
    assert set(k.weighed) == {"leakage+sensor_lag", "inertia"}


def test_a_lower_maximum_replaces_no_higher_one_unless_its_evidence_is_more():
    """Within ten nats it did, so that a pair's probability hung on the order of the search."""
    name = ("leakage", "sensor_lag")
    top = Stub(name, 100.0, fit=Peak(-120.0))
    k = known(top)
    k.take([Stub(name, 90.5, fit=Peak(-109.0))])
    assert k.weighed["leakage+sensor_lag"] is top
    broad = Stub(name, 101.0, fit=Peak(-115.0))
    k.take([broad])
    assert k.weighed["leakage+sensor_lag"] is broad


def test_what_is_found_from_elsewhere_has_to_be_clearly_better():
    one, other = Stub(("leakage",), 100.0), Stub(("inertia",), 50.0)
    k = known(one, other)
    little, much, new = Stub(("leakage",), 109.0), Stub(("inertia",), 61.0), Stub(("sensor_lag",), 1.0)
    assert k.take_from_elsewhere([little, much, new]) == [much, new]
    assert k.weighed == {"leakage": one, "inertia": much, "sensor_lag": new}


def test_a_higher_maximum_has_to_be_better_by_less():
    one = Stub(("leakage",), 100.0, fit=Peak(-110.0))
    as_high, higher = Stub(("leakage",), 108.0, fit=Peak(-112.0)), Stub(("leakage",), 108.0, fit=Peak(-114.0))
    assert known(one).take_from_elsewhere([as_high]) == []
    assert known(one).take_from_elsewhere([higher]) == [higher]
    # what only a grid has weighed keeps the base's fit, and that says nothing
    screened = Stub(("leakage",), 100.0, fit=Peak(-110.0), refitted=False)
    assert known(screened).take_from_elsewhere([higher]) == []


def test_what_moves_less_than_the_sensor_resolves_counts_only_before_one_that_moves_more():
    small, large = Stub(("leakage",), 100.0, 1e-8), Stub(("inertia",), 90.0, 2e-7)
    assert known(small).counting == []
    assert known(small, large).counting == [small, large]
    better = Stub(("inertia",), 101.0, 2e-7)
    assert known(small, better).counting == [better]


def test_two_effects_share_the_odds_of_two():
    k = known()
    assert k.share(Stub(("leakage",), 0.0)) == pytest.approx(0.02)
    assert k.share(Stub(("inertia", "leakage"), 0.0)) == pytest.approx(0.1 / 190)  # of the pairs of twenty
    assert k.weight(Stub(("leakage",), 3.0)) == pytest.approx(3.0 + math.log(0.02))


def test_a_size_on_recordings_that_were_not_fitted_is_simulated_once_for_each_fit(monkeypatch):
    asked = []

    def size(_base, fit, _pieces):
        asked.append(fit)
        return 2e-7

    monkeypatch.setattr("bayes_dea.mismatch.search.known.size_elsewhere", size)
    one, other = Stub(("leakage",), 100.0, 1e-8), Stub(("inertia",), 50.0, 1e-8)
    k = Known(NONE, 1e-7, ODDS, 20, ("a piece",), {w.name: w for w in (one, other)})
    assert k.counting == [one, other]
    assert k.counting == [one, other]
    assert asked == [one.fit, other.fit]


def test_what_a_grid_calls_hopeless_does_not_count_with_the_fit_of_another():
    """A pair that was not refitted has the fit of the single effect, and on other recordings that one's size."""
    single = Stub(("amplitude_softening",), 100.0)
    pair = Stub(("amplitude_softening", "inertia"), 100.0, 1e-6, single.fit, refitted=False)
    assert known(single, pair).counting == [single]


def test_a_size_is_that_against_the_likeliest_that_is_simpler(monkeypatch):
    """Worked out once for each of these, though a likelier one may be found later."""
    asked = []

    def held(fit, simpler, _):
        asked.append(simpler)

    monkeypatch.setattr("bayes_dea.mismatch.search.known.with_true_modes", held)
    monkeypatch.setattr("bayes_dea.mismatch.search.known.sized_start", lambda *_: None)
    one, other = Stub(("leakage",), 50.0), Stub(("inertia",), 60.0)
    pair = Stub(("leakage", "inertia"), 100.0, size_m=0.0)
    k = Known(NONE, 1e-7, ODDS, 20, (), {w.name: w for w in (one, pair)}, noise=object())
    assert not k.enough(pair)
    assert not k.enough(pair)
    k.take([other])
    assert not k.enough(pair)
    assert asked == [one.fit, other.fit]


def test_on_recordings_not_fitted_a_second_effect_counts_by_what_it_adds_itself(monkeypatch):
    """An expansion shows on them whatever stands beside it; a limit that adds a tenth of a step does not count."""
    single, pair = Stub(("thermal_expansion",), 100.0), Stub(("thermal_expansion", "sensor_clipping"), 111.0, 1e-8)
    both = Stub(("thermal_expansion", "series_resistance"), 115.0, 1e-8)
    adds = {id(single.fit): 5e-7, id(pair.fit): 1e-8, id(both.fit): 3e-7}

    def size(without, fit, _):
        return adds[id(fit)] if without is not NONE.fit else 5e-7

    monkeypatch.setattr("bayes_dea.mismatch.search.known.size_elsewhere", size)
    k = Known(NONE, 1e-7, ODDS, 20, ("a recording",), {w.name: w for w in (single, pair, both)})
    assert not k.enough(pair)
    assert k.enough(both)
    assert k.enough(Stub(single.effects, 100.0, 1e-8, single.fit))


def test_what_is_found_in_less_than_a_step_is_no_larger_by_recordings_not_fitted(monkeypatch):
    """Beside softening, a supply that ends just above what was commanded: 0.036 um, and 25 um at more volts."""
    monkeypatch.setattr("bayes_dea.mismatch.search.known.size_elsewhere", lambda *of: 2.5e-5 if of[2] else 0.0)
    single = Stub(("mullins_softening",), 100.0, 1e-4)
    pair = Stub(("mullins_softening", "supply_saturation"), 111.0, 3.6e-8)
    k = Known(NONE, 1e-7, ODDS, 20, ("a recording",), {w.name: w for w in (single, pair)})
    assert k.enough(pair)
    settled = replace(k, nothing_left=(frozenset(single.effects),))
    assert not settled.enough(pair)
    assert settled.enough(single)
    assert settled.enough(Stub(pair.effects, 111.0, 2e-7))
    assert settled.enough(Stub(("sensor_drift",), 111.0, 3.6e-8))  # nothing is known of what others leave


def test_beside_another_an_effect_is_held_against_that_without_a_gain_that_no_sensor_has(monkeypatch):
    """Not against the base without one: beside a large effect whatever was added passed for as large."""
    single, pair = Stub(("leakage",), 50.0, 1e-4), Stub(("leakage", "inertia"), 100.0, 1e-8)
    stated = {id(single.fit): Peak(0.0)}
    sizes = {id(NONE.fit): 1e-4, id(stated[id(single.fit)]): 3e-8}
    monkeypatch.setattr("bayes_dea.mismatch.search.known.with_true_modes", lambda *_: None)
    monkeypatch.setattr("bayes_dea.mismatch.search.known.sized_start", lambda fit, *_: stated.get(id(fit)))
    monkeypatch.setattr("bayes_dea.mismatch.search.known.effect_size", lambda base, _: sizes[id(base)])
    by_name = {w.name: w for w in (single, pair)}
    assert not Known(NONE, 1e-7, ODDS, 20, (), by_name, noise=object(), sized=NONE.fit).enough(pair)
    sizes[id(stated[id(single.fit)])] = 3e-7
    assert Known(NONE, 1e-7, ODDS, 20, (), by_name, noise=object(), sized=NONE.fit).enough(pair)

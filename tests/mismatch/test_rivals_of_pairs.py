"""Pairs whose first effect is one that nothing tells from the first that led."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from bayes_dea.mismatch.search import pairs, second_thoughts
from bayes_dea.mismatch.search.beside import names_beside
from bayes_dea.mismatch.search.hypotheses import DELAY
from bayes_dea.mismatch.search.quest import Quest

#: the fit that effects are added to
BASE = SimpleNamespace(problem=SimpleNamespace(model=None))
NAMES = ["series_resistance", "leakage", "thickness_feedback", "sensor_nonlinearity"]


@dataclass(frozen=True)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float
    fit: float = 0.0  # what it leaves
    refitted: bool = True
    value: float = math.inf
    laws: Mapping[str, str] = field(default_factory=dict)


def quest(adequate=None, base=None):
    """A search among `NAMES`; stubs leave what their fit says."""
    return Quest(base, tuple(NAMES), {}, None, np.random.default_rng(0), adequate=adequate)


def noise_is_left(fit):
    return fit < 10.0


def test_what_does_as_well_alone_is_tried_beside_the_best_second_effects(monkeypatch):
    asked = []

    def beside(best, quest, reached):
        asked.append((best.effects, list(quest.names), reached))
        return [Stub((*best.effects, n), best.log_evidence) for n in quest.names]

    monkeypatch.setattr(pairs, "beside", beside)
    lag = Stub(("sensor_lag",), 100.0)
    singles = [lag, Stub(("parallel_damper",), 99.9), Stub(("inertia",), 20.0), Stub(("leakage",), 85.0)]
    found = [Stub(("thickness_feedback", "sensor_lag"), 500.0),
             Stub(("sensor_lag", "sensor_nonlinearity"), 495.0, value=7.0),
             Stub(("sensor_lag", "leakage"), 300.0)]
    out = pairs.in_place_of_the_first(lag, found, [*singles, *found], quest())
    assert asked == [
        (("parallel_damper",), ["thickness_feedback", "sensor_nonlinearity"], 7.0),
        (("leakage",), ["thickness_feedback", "sensor_nonlinearity"], 7.0),  # what stays far behind 7 is given up
    ]
    assert len(out) == 4


def test_where_nothing_helps_beside_the_leader_all_is_tried_beside_the_next(monkeypatch):
    """A mass with much damping does what two lags do; the second effect only shows beside one of these."""
    asked = []

    def beside(best, quest, reached=math.inf):
        asked.append((best.effects, list(quest.names)))
        return [Stub((*best.effects, n), 150.0 if n == "series_resistance" else 90.0) for n in quest.names]

    monkeypatch.setattr(pairs, "beside", beside)
    mass = Stub(("inertia",), 102.5)
    singles = [mass, Stub(("sensor_lag",), 100.0), Stub(("parallel_damper",), 99.9), Stub(("leakage",), 20.0)]
    found = [Stub(("inertia", "leakage"), 102.4), Stub(("inertia", "sensor_nonlinearity"), 101.0)]
    all_of_them = [*singles, *found]
    out = pairs.in_place_of_the_first(mass, found, all_of_them, quest())
    assert asked == [(("sensor_lag",), NAMES), (("parallel_damper",), ["series_resistance"])]
    assert {"sensor_lag", "parallel_damper"} == {w.effects[0] for w in out if w.log_evidence == 150.0}
    # the same where no second effect promised anything beside the leader, so that none was fitted
    asked.clear()
    out = pairs.in_place_of_the_first(mass, [], all_of_them, quest())
    assert asked == [(("sensor_lag",), NAMES), (("parallel_damper",), ["series_resistance"])]
    assert len(out) == len(NAMES) + 1
    # alone it has no rival to go on from
    asked.clear()
    assert pairs.in_place_of_the_first(mass, found, [mass, *found], quest()) == []
    assert asked == []


def test_what_is_quick_is_tried_before_what_is_dear_and_explains_hardly_more(monkeypatch):
    """A mass that rings beyond what is sampled does what a lag does, and is dear beside anything else."""
    asked = []

    def beside(best, quest, reached=math.inf):
        asked.append(best.effects)
        left = lag_leaves if best.effects == ("sensor_lag",) else 0.0
        return [Stub((*best.effects, "leakage"), 300.0 - left, left), Stub((*best.effects, "sensor_drift"), 1.0, 400.0)]

    monkeypatch.setattr(pairs, "beside", beside)
    monkeypatch.setattr(pairs, "excess", lambda fit, prior: fit)
    lag_leaves = 0.0

    def begun(mass, *others, thoughts=None):
        asked.clear()
        start, found = pairs.beside_the_leader(mass, [mass, *others], quest(noise_is_left), thoughts)
        return start.effects[0], list(asked), [w.effects for w in found]

    mass, lag = Stub(("inertia",), 100.0, 400.0), Stub(("sensor_lag",), 10.0, 490.0)  # 90 nats of the 400 that are left
    of_lag = [("sensor_lag", "leakage"), ("sensor_lag", "sensor_drift")]
    of_mass = [("inertia", "leakage"), ("inertia", "sensor_drift")]
    damper, pair = Stub(("parallel_damper",), 5.0, 495.0), Stub(("sensor_lag", "leakage"), 99.0, 1.0)
    assert begun(mass, lag, damper, pair) == ("sensor_lag", [("sensor_lag",)], of_lag)
    # what leaves something beside the lag as well may be a mass after all
    lag_leaves = 50.0
    assert begun(mass, lag) == ("inertia", [("sensor_lag",), ("inertia",)], of_lag + of_mass)
    # or another one that is as good alone does what the lag does not, beside what helps the lag
    damper = Stub(("parallel_damper",), 9.0, 491.0)
    of_damper = [("parallel_damper", "leakage"), ("parallel_damper", "sensor_drift")]
    assert begun(mass, lag, damper) == ("sensor_lag", [("sensor_lag",), ("parallel_damper",)], of_lag + of_damper)
    # one that is behind by more than a quarter of what is left, or was never fitted, takes nobody's place
    alone = ("inertia", [("inertia",)], of_mass)
    assert begun(mass, Stub(("sensor_lag",), -10.0, 510.0)) == alone
    assert begun(mass, Stub(("sensor_lag",), 99.0, 401.0, refitted=False)) == alone
    assert begun(mass, Stub(("amplitude_softening",), 99.0, 401.0)) == alone
    assert begun(Stub(("sensor_lag",), 100.0, 400.0), mass) == ("sensor_lag", [("sensor_lag",)], of_lag)


def test_a_mode_that_stands_in_beside_what_is_quick_is_looked_behind_before_what_is_dear(monkeypatch):
    asked, thought_of = [], []

    def beside(best, quest, reached=math.inf):
        asked.append(best.effects)
        on_grid = Stub((*best.effects, "fractional_relaxation"), 900.0, 0.0, refitted=False)
        return [Stub((*best.effects, "extra_relaxation_mode"), 200.0, 300.0), on_grid]

    monkeypatch.setattr(pairs, "beside", beside)
    monkeypatch.setattr(pairs, "excess", lambda fit, prior: fit)
    softening, zone = Stub(("amplitude_softening",), 100.0, 400.0), Stub(("supply_dead_zone",), 10.0, 490.0)

    def begun(behind):
        def thoughts(w):
            thought_of.append(w.effects)
            return behind

        asked.clear()
        thought_of.clear()
        return pairs.beside_the_leader(softening, [softening, zone], quest(noise_is_left), thoughts)

    pair = Stub(("supply_dead_zone", "leakage"), 490.0, 5.0)
    start, found = begun(pair)
    assert start is zone
    assert found[-1] is pair
    assert asked == [zone.effects]
    assert thought_of == [("supply_dead_zone", "extra_relaxation_mode")]
    start, found = begun(Stub(("supply_dead_zone", "series_resistance"), 400.0, 90.0))
    assert start is softening
    assert asked == [zone.effects, softening.effects]
    assert len(found) == 5


def test_beside_a_leak_that_is_hardly_more_than_its_resistance_the_resistance_is_taken(monkeypatch):
    """The leak costs ten times as much to simulate; where it matters it is put back once there is a pair."""
    asked = []

    def beside(best, quest, reached=math.inf):
        asked.append(best.effects)
        return [Stub((*best.effects, "inertia"), 300.0, 400.0)]

    monkeypatch.setattr(pairs, "beside", beside)
    leak, plain = Stub(("leakage",), 100.0, 900.0), Stub(("series_resistance",), 97.0, 905.0)
    given = (quest(lambda fit: False), lambda w: w)
    start, found = pairs.beside_the_leader(leak, [leak, plain], *given)
    assert (start, asked) == (plain, [plain.effects])
    # nor is it tried as a rival of the first of the pair that was found
    asked.clear()
    assert pairs.in_place_of_the_first(plain, found, [leak, plain, *found], quest()) == []
    assert asked == []
    # a leak that explains clearly more stays what it is
    start, _ = pairs.beside_the_leader(leak, [leak, Stub(("series_resistance",), 50.0, 950.0)], *given)
    assert start is leak


def test_a_leak_in_a_pair_that_is_hardly_more_than_its_resistance_is_looked_for_as_a_third(monkeypatch):
    """A pair whose leak does nothing led by chance: with the leak there already, no grid would have looked for it."""
    asked = []

    def beside(best, quest, reached=math.inf):
        asked.append(best.effects)
        return []

    monkeypatch.setattr(pairs, "beside", beside)
    idle, plain = (Stub((first, "strain_stiffening"), 100.0, 900.0) for first in ("leakage", "series_resistance"))
    given = (quest(lambda fit: False), lambda w: w)
    start, _ = pairs.beside_the_leader(idle, [idle, plain], *given)
    assert (start, asked) == (plain, [plain.effects])
    # beside another second effect it says nothing, nor where the leak is needed
    other = Stub(("series_resistance", "sensor_drift"), 100.0, 900.0)
    needed = Stub(("series_resistance", "strain_stiffening"), 50.0, 950.0)
    start, _ = pairs.beside_the_leader(idle, [idle, other, needed], *given)
    assert start is idle


def test_a_mass_that_explains_nothing_alone_gets_no_other_first(monkeypatch):
    """A mass beside friction took forty seconds to be paired with everything, though alone it left all there was."""
    asked = []
    monkeypatch.setattr(second_thoughts, "extended", lambda model, effects, given: tuple(effects))
    monkeypatch.setattr(second_thoughts, "beside_the_second", lambda w, alone, *_: asked.append(alone.effects) or [])
    monkeypatch.setattr(second_thoughts, "excess", lambda fit, prior: 1000.0 if fit is BASE else fit)

    def thoughts(second, left):
        alone = {("rate_independent_hysteresis",): Stub(("rate_independent_hysteresis",), 50.0, 40.0),
                 (second,): Stub((second,), 10.0, left)}
        monkeypatch.setattr(second_thoughts, "within", lambda w, base, m, prior: alone[m])
        asked.clear()
        pair = Stub(("rate_independent_hysteresis", second), 100.0, 5.0)
        second_thoughts.second_thoughts(pair, quest(base=BASE))
        return asked

    assert thoughts("inertia", 990.0) == []
    assert thoughts("inertia", 900.0) == [("inertia",)]
    # Mullins softening that leads nowhere alone may belong beside thickness feedback (`test_pairs`)
    assert thoughts("mullins_softening", 990.0) == [("mullins_softening",)]


def test_beside_what_explains_next_to_nothing_no_pair_is_looked_for(monkeypatch):
    """Of what the base leaves the curvature explains two thirds, a dead zone a third, a damper a hundredth."""
    asked = []

    def beside(best, quest, reached):
        asked.append(best.effects)
        return []

    monkeypatch.setattr(pairs, "beside", beside)
    monkeypatch.setattr(pairs, "excess", lambda fit, prior: fit)
    first = Stub(("sensor_nonlinearity",), -333.0, 333.0)
    zone, damper = Stub(("supply_dead_zone",), -400.0, 700.0), Stub(("parallel_damper",), -380.0, 990.0)
    pairs.beside_the_next(first, [], [first, zone, damper], quest(lambda fit: False, base=1000.0))
    assert asked == [zone.effects]


def test_nothing_that_charges_the_dielectric_is_a_third_beside_a_mass():
    """Nor a mass beside that; beside the mass alone, where a pair of the two is found, it is looked for."""
    names = ["series_resistance", "leakage", "thickness_feedback", "inertia", "parallel_damper", "sensor_lag"]
    beside = names_beside
    assert beside(Stub(("inertia",), 0.0), names) == [n for n in names if n not in ("inertia", "parallel_damper")]
    assert beside(Stub(("one_quadrant_supply", "inertia"), 0.0), names) == ["thickness_feedback", "sensor_lag"]
    assert beside(Stub(("leakage", "sensor_lag"), 0.0), names) == [
        "series_resistance", "thickness_feedback", "parallel_damper"]
    # a shift of the readings costs nothing, and may be there whatever else is
    assert beside(Stub(("leakage", "inertia"), 0.0), [*names, "acquisition_delay"]) == ["acquisition_delay"]
    # what bends or remembers is as dear beside a mass, but for a pair of the two
    dear = ["rate_independent_hysteresis", "amplitude_softening", "sensor_lag"]
    assert beside(Stub(("inertia",), 0.0), dear) == dear
    assert beside(Stub(("charge_retention", "inertia"), 0.0), dear) == ["sensor_lag"]
    assert "inertia" not in beside(Stub(("charge_retention", "amplitude_softening"), 0.0), names)


def test_what_helps_beside_a_shift_is_tried_beside_another_effect_with_that_shift(monkeypatch):
    """1566355: a softening did a part of the work of a dead zone and of absorption, in readings 0.2 ms early."""
    asked = []

    def beside(best, quest, reached):
        asked.append((best.effects, list(quest.names), reached))
        return []

    monkeypatch.setattr(pairs, "beside", beside)
    monkeypatch.setattr(pairs, "excess", lambda fit, prior: fit)
    first = Stub(("amplitude_softening", DELAY), -552.0, 552.0)
    zone = Stub(("supply_dead_zone", DELAY), -968.0, 968.0)
    far = Stub(("dielectric_absorption", DELAY), -2e4, 2e4)
    found = [Stub(("dielectric_absorption", "amplitude_softening", DELAY), -32.0, 32.0, value=7.0),
             Stub(("amplitude_softening", "sensor_nonlinearity", DELAY), -550.0, 552.0)]
    known = [first, zone, far, *found, Stub(("supply_dead_zone", "thickness_feedback"), -900.0, 900.0)]
    pairs.helped_elsewhere(first, found, known, quest())
    # nothing beside what leaves far more, nor what helped little
    assert asked == [(("supply_dead_zone", DELAY), ["dielectric_absorption"], 7.0)]
    asked.clear()
    pairs.helped_elsewhere(first, found[1:], known, quest())
    assert asked == []

"""Pairs whose first effect is one that nothing tells from the first that led."""

from dataclasses import dataclass

import numpy as np

from bayes_dea.mismatch import search

NAMES = ["series_resistance", "leakage", "thickness_feedback", "sensor_nonlinearity"]


@dataclass(frozen=True)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float


def test_what_does_as_well_alone_is_tried_beside_the_best_second_effects(monkeypatch):
    asked = []

    def beside(best, model, names, prior, overrides, say, rng):
        asked.append((best.effects, list(names)))
        return [Stub((*best.effects, n), best.log_evidence) for n in names]

    monkeypatch.setattr(search, "beside", beside)
    lag = Stub(("sensor_lag",), 100.0)
    singles = [lag, Stub(("parallel_damper",), 99.9), Stub(("inertia",), 20.0), Stub(("leakage",), 85.0)]
    pairs = [Stub(("thickness_feedback", "sensor_lag"), 500.0), Stub(("sensor_lag", "sensor_nonlinearity"), 495.0),
             Stub(("sensor_lag", "leakage"), 300.0)]
    out = search.in_place_of_the_first(
        lag, pairs, [*singles, *pairs], None, NAMES, None, {}, None, np.random.default_rng(0))
    assert asked == [
        (("parallel_damper",), ["thickness_feedback", "sensor_nonlinearity"]),
        (("leakage",), ["thickness_feedback", "sensor_nonlinearity"]),
    ]
    assert len(out) == 4


def test_where_nothing_helps_beside_the_leader_all_is_tried_beside_the_next(monkeypatch):
    """A mass with much damping does what two lags do; the second effect only shows beside one of these."""
    asked = []

    def beside(best, model, names, prior, overrides, say, rng):
        asked.append((best.effects, list(names)))
        return [Stub((*best.effects, n), 150.0 if n == "series_resistance" else 90.0) for n in names]

    monkeypatch.setattr(search, "beside", beside)
    mass = Stub(("inertia",), 102.5)
    singles = [mass, Stub(("sensor_lag",), 100.0), Stub(("parallel_damper",), 99.9), Stub(("leakage",), 20.0)]
    pairs = [Stub(("inertia", "leakage"), 102.4), Stub(("inertia", "sensor_nonlinearity"), 101.0)]
    given = ([*singles, *pairs], None, NAMES, None, {}, None, np.random.default_rng(0))
    out = search.in_place_of_the_first(mass, pairs, *given)
    assert asked == [(("sensor_lag",), NAMES), (("parallel_damper",), ["series_resistance"])]
    assert {"sensor_lag", "parallel_damper"} == {w.effects[0] for w in out if w.log_evidence == 150.0}
    # alone it has no rival to go on from
    asked.clear()
    assert search.in_place_of_the_first(mass, pairs, [mass, *pairs], *given[1:]) == []
    assert asked == []

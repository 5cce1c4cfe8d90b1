"""What a search does once its best explanation leaves something, or is enough: with stubs for all that is fitted."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from bayes_dea.mismatch.search import name
from bayes_dea.mismatch.search.name import _Search


@dataclass(frozen=True, eq=False)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float
    fit: object = field(default_factory=object)


@dataclass(frozen=True, eq=False)
class Found:
    weighed: Stub
    adequate: bool = True
    discrepancy: object = None


LEAK, MASS = Stub(("leakage",), 100.0), Stub(("inertia",), 90.0)


def search(best, none=None):
    """A search whose hypotheses weigh what their evidence says, and that takes what it is given."""
    s = object.__new__(_Search)
    s.best, s.none, s.others = best, none or Found(Stub((), 0.0)), []
    s.quest = SimpleNamespace()
    s.known = SimpleNamespace(
        counting=[], weighed={}, weight=lambda w: w.log_evidence, physics=lambda w: len(w.effects),
        enough=lambda w: True, take_from_elsewhere=lambda found: found,
    )  # fmt: skip
    s._lead = lambda w: setattr(s, "best", Found(w))
    s._taken = lambda found: found
    return s


@pytest.mark.parametrize(("adequate", "gain", "asked"), [(True, 0.0, 0), (True, 1e3, 1), (False, 0.0, 1)])
def test_modes_are_put_elsewhere_where_something_is_left(monkeypatch, adequate, gain, asked):
    calls = []
    monkeypatch.setattr(name, "put_right", lambda w, others, quest: calls.append(w) or [])
    s = search(Found(LEAK, adequate, SimpleNamespace(gain=gain)))
    assert not s._put_right()
    assert calls == [LEAK] * asked
    assert s.best.weighed is LEAK


def test_nothing_is_put_elsewhere_where_nothing_leads(monkeypatch):
    monkeypatch.setattr(name, "put_right", lambda *_: pytest.fail("there is no explanation to put right"))
    none = Found(Stub((), 0.0), adequate=False)
    assert not search(none, none)._put_right()


@pytest.mark.parametrize(("evidence", "leads"), [(148.0, True), (99.0, False)])
def test_what_is_likelier_with_a_mode_elsewhere_leads(monkeypatch, evidence, leads):
    moved = Stub(("leakage",), evidence)
    monkeypatch.setattr(name, "put_right", lambda *_: [moved])
    s = search(Found(LEAK, adequate=False))
    assert s._put_right() is leads
    assert s.best.weighed is (moved if leads else LEAK)


@pytest.mark.parametrize(("ahead", "asked"), [(1.0, 1), (-15.0, 0)])
def test_only_what_is_ahead_of_what_is_enough_has_pairs_looked_for_in_its_place(monkeypatch, ahead, asked):
    """A mass with a shift, 15 nats behind a lag that is enough, had every effect tried beside the mass: 31 s."""
    calls = []
    monkeypatch.setattr(name, "beside", lambda *_: [])
    monkeypatch.setattr(name, "shifted_rivals", lambda *_: [Stub(("inertia", "acquisition_delay"), 100.0 + ahead)])
    monkeypatch.setattr(name, "in_place_of_the_first", lambda *a: calls.append(a[0]) or [MASS])
    more = search(Found(LEAK))._beside_what_is_enough(None)
    assert calls == [LEAK] * asked
    assert (MASS in more) is bool(asked)

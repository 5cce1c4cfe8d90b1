"""What leads after second thoughts has the modes of its base where they are needed, and so have its rivals."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search import name
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relocate import elements_of, with_modes
from bayes_dea.mismatch.search.rivals import put_right
from bayes_dea.mismatch.search.weigh import Weighed


@pytest.mark.long
def test_a_leader_comes_back_from_a_mode_that_no_reading_shows_and_its_rivals_with_it(diagnosed):
    """A leak that takes nothing is the resistance before it: either had lost its third mode to 1 us."""
    result = diagnosed("series_resistance", {"R_s_ohm": 5e4})
    prior, right = noise_prior(result.assembled), result.naming.weighed
    quest = Quest(result.naming.none.weighed.fit, (), {}, prior, np.random.default_rng(1))

    def astray(effect, log_evidence):
        fit = right[effect].fit
        q = with_modes(fit, fit.problem.model, fit.values(), [*elements_of(fit.values(), 2), (1e-6, 3e9)])
        stuck = refit(fit.problem, q, fit.noise, prior)
        assert stuck.objective > fit.objective + 5.0  # the premise
        return Weighed((effect,), stuck, log_evidence, 0.1, 1e-6)

    before = {"series_resistance": astray("series_resistance", 1e3), "leakage": astray("leakage", 950.0)}
    leader = before["series_resistance"]
    far_behind = astray("leakage", 930.0)
    assert [w.effects for w in put_right(leader, [leader, far_behind], quest)] == [leader.effects]
    found = {w.effects[0]: w for w in put_right(leader, list(before.values()), quest)}
    assert set(found) == set(before)
    for effect, w in found.items():
        assert w.fit.objective < right[effect].fit.objective + 0.5
        gained = w.fit.log_evidence - before[effect].fit.log_evidence  # in what Laplace says of both
        assert w.log_evidence == pytest.approx(before[effect].log_evidence + gained)
    assert put_right(found["series_resistance"], list(found.values()), quest) == []


@dataclass(frozen=True, eq=False)
class Stub:
    log_evidence: float
    fit: str


@pytest.mark.parametrize(("found", "adequate", "asked", "leads"), [
    ([120.0, 130.0], (), ["130.0"], 150.0),
    ([120.0, 130.0], ("130.0",), [], 130.0),
    ([90.0], (), [], 100.0),  # what led before was looked around from by the search that found it
])  # fmt: skip
def test_only_what_comes_to_lead_and_leaves_something_is_put_right(monkeypatch, found, adequate, asked, leads):
    put = []
    monkeypatch.setattr(name, "second_thoughts", lambda *_: [Stub(e, str(e)) for e in found])
    monkeypatch.setattr(name, "put_right", lambda w, *_: put.append(w.fit) or [Stub(w.log_evidence + 20.0, "moved")])
    monkeypatch.setattr(name, "counted", lambda w, *_: w)
    search = object.__new__(name._Search)
    search.quest = SimpleNamespace(base=None, explained_by=lambda fit: fit in adequate)
    search.brief = SimpleNamespace(prior=None)
    search.known = SimpleNamespace(enough=lambda _: True, weight=lambda w: w.log_evidence,
                                   take_from_elsewhere=lambda ws: [w for w in ws if w.log_evidence > 100.0])
    search._considered = []
    assert search._thoughts(Stub(100.0, "first")).log_evidence == leads
    assert put == asked

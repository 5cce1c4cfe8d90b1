"""What something unlisted weighs beside what is listed."""

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import pytest

from bayes_dea.mismatch.search.hypotheses import UNKNOWN, Odds
from bayes_dea.mismatch.search.known import Known
from bayes_dea.mismatch.search.naming import Explanation, Naming, log_probabilities
from bayes_dea.mismatch.where.discrepancy import Discrepancy

ODDS = Odds(none=0.5, single=0.38, double=0.04, unknown=0.08, shifted=0.2)


@dataclass(frozen=True)
class Stub:
    effects: tuple[str, ...]
    log_evidence: float
    size_m: float = 1e-6
    fit: object = field(default_factory=object)
    refitted: bool = True
    log_evidence_se: float = 0.1

    @property
    def name(self):
        return "+".join(self.effects) or "none"


@dataclass(frozen=True)
class Calm:
    p_value: float = 0.5
    nothing_claimed: bool = False


def weights(best, gain, labelled=None):
    none = Stub((), 0.0, 0.0)
    known = Known(none, 1e-7, ODDS, 19, (), {best.name: best})
    bare = Explanation(none, Calm(p_value=1e-9), Discrepancy(20.0, 1e-6))
    explained = [bare, Explanation(best, Calm(), Discrepancy(gain, 0.3e-6))]
    return log_probabilities(known, bare, explained, ODDS, None, labelled or {})


@pytest.mark.parametrize("lead", [50.0, 400.0])
def test_something_that_nobody_sees_beside_an_effect_is_no_likelier_than_the_effect(lead):
    """A discrepancy of no evidence of its own: 4 to 1 for "unknown" without the prior odds of the effect it needs."""
    evidence, _, weight = weights(Stub(("sensor_drift",), lead), 0.0)
    assert evidence[UNKNOWN] == lead
    assert weight[UNKNOWN] - weight["sensor_drift"] == pytest.approx(math.log(ODDS.unknown / ODDS.none))


def test_what_is_seen_beside_an_effect_is_unknown():
    _, _, weight = weights(Stub(("sensor_drift",), 50.0), 30.0)
    assert weight[UNKNOWN] - weight["sensor_drift"] == pytest.approx(30.0 + math.log(ODDS.unknown / ODDS.none))


def test_a_mismatch_that_no_effect_explains_has_the_odds_of_what_is_unlisted():
    """The model with a discrepancy, 20 nats, against a listed effect that takes 1 of them."""
    evidence, _, weight = weights(Stub(("sensor_drift",), 1.0), -5.0)
    assert evidence[UNKNOWN] == 20.0
    assert weight[UNKNOWN] - weight["none"] == pytest.approx(20.0 + math.log(ODDS.unknown / ODDS.none))


def test_any_mode_may_be_the_further_one():
    """Found by one labelling, from which a ridge has taken 2 nats; another one is 3 nats likelier by the priors."""
    found = Stub(("extra_relaxation_mode", "sensor_drift"), 48.0)
    labelled = {found.name: [SimpleNamespace(log_evidence=50.0), SimpleNamespace(log_evidence=53.0)]}
    before, _, _ = weights(found, 0.0, {found.name: labelled[found.name][:1]})
    evidence, _, weight = weights(found, 0.0, labelled)
    more = math.log(1.0 + math.exp(3.0))
    assert before[found.name] == 48.0
    assert evidence[found.name] == pytest.approx(48.0 + more)
    # and no less for what is unlisted beside it
    assert weight[UNKNOWN] - weight[found.name] == pytest.approx(math.log(ODDS.unknown / ODDS.none))


def test_what_is_likely_goes_on_to_a_second_look():
    """The best explanation first, then the likeliest; what only a grid has weighed has no fit of its own."""
    none = Stub((), 0.0)
    found = {w.name: w for w in (Stub(("inertia",), 3.0), Stub(("leakage",), 2.0), Stub(("sensor_lag",), 1.0),
                                 Stub(("sensor_drift",), 1.0, refitted=False))}  # fmt: skip
    bare, best = Explanation(none, Calm()), Explanation(found["leakage"], Calm())
    p = {"none": 0.001, "unknown": 0.005, "inertia": 0.6, "leakage": 0.3, "sensor_drift": 0.08, "sensor_lag": 0.02}
    naming = Naming(bare, best, found, {}, {}, p, {})
    in_order = (found["leakage"].fit, found["inertia"].fit, found["sensor_lag"].fit)
    assert naming.likely(0.01, 4) == in_order
    assert naming.likely(0.1, 4) == in_order[:2]
    assert naming.likely(0.01, 1) == in_order[:1]
    assert replace(naming, best=bare).likely(0.1, 4) == (none.fit, found["inertia"].fit, found["leakage"].fit)

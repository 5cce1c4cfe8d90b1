"""What counts as large enough to be claimed: also what explains more than something that is."""

from bayes_dea.mismatch.search.known import Known
from bayes_dea.mismatch.search.weigh import Weighed


def _hypotheses(**evidence):
    """By name, an underscore between the effects of a pair; "none" is the base."""
    effects = {name: () if name == "none" else tuple(name.split("_")) for name in evidence}
    return {name: Weighed(effects[name], object(), log, 0.1, 0.0) for name, log in evidence.items()}


def _names(of, found):
    none = found.pop("none")
    return {w.name for w in Known(none, 1e-7, {}, 1, (), found).poorer(found[of])}


def test_it_explains_more_than_those_of_its_kind_that_explain_something():
    found = _hypotheses(none=0.0, lag=150.0, damper=190.0, mass=1.0)
    assert _names("damper", found) == {"lag"}


def test_what_explains_next_to_nothing_says_nothing_of_others():
    """Its size may be anything: the base was refitted beside it."""
    assert _names("damper", _hypotheses(none=0.0, damper=190.0, mass=2.9)) == set()


def test_a_pair_is_compared_with_pairs_that_explain_more_than_one_effect_does():
    found = _hypotheses(none=0.0, fall=500.0, fall_damper=650.0, fall_lag=690.0, fall_mass=502.0)
    assert _names("fall_lag", dict(found)) == {"fall+damper"}
    assert _names("fall_damper", dict(found)) == set()


def test_what_was_not_refitted_is_none_of_them():
    found = _hypotheses(none=0.0, lag=150.0, damper=190.0)
    found["lag"] = Weighed(("lag",), found["none"].fit, 150.0, 0.5, 0.0)
    assert _names("damper", found) == set()

"""What is given to a verdict from its raw probability."""

import numpy as np
import pytest

from bayes_dea.mismatch.confidence import confidence_of


def test_a_claim_rises_with_its_probability():
    given = [confidence_of(p, ["leakage"]) for p in np.linspace(0.0, 1.0, 101)]
    assert np.all(np.diff(given) >= 0.0)
    assert given[0] < 0.02
    assert 0.9 < given[-1] < 1.0


@pytest.mark.parametrize("members", [["leakage", "series_resistance"], ["leakage", "unknown"],
                                     ["leakage", "series_resistance", "none"]])
def test_one_of_several_that_act_has_no_more_than_a_set_allows(members):
    assert confidence_of(0.985, members[:1]) > 0.9
    assert confidence_of(0.985, members) == 0.8
    assert confidence_of(0.45, members) <= 0.45


def test_none_beside_what_may_act_is_as_probable_as_it_is():
    """Two effects that could be too weak to be seen do not make "none" a claim of physics."""
    assert 0.9 < confidence_of(0.985, ["none", "leakage", "series_resistance"]) <= 0.985

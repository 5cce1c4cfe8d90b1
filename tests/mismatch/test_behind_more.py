"""A leak behind a resistor that is larger than the actuator's own resistance may be."""

from types import SimpleNamespace

import numpy as np
import pytest

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.search.beside import puts_back
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.pairs import behind_more
from bayes_dea.mismatch.search.promising import frames_of
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.where.features import features

LEAK = {"R_leak_ohm": 2e9, "E_0_V_per_m": 1e6}
NAMES = ("series_resistance", "leakage")


def looked_for(result, first):
    prior, base = noise_prior(result.assembled), result.base
    quest = Quest(base, NAMES, effect_priors(NAMES, result.assembled.campaign), prior, np.random.default_rng(1))
    frames = frames_of(base, [features(p) for p in base.problem.pieces], prior)
    return behind_more(first, frames, quest)


@pytest.mark.long
def test_the_resistor_is_found_with_the_leak_from_the_base(diagnosed):
    """A leak alone ends at 100 kohm, where the modes do the rest badly; beside that nothing promised anything."""
    result = diagnosed("leakage", {**LEAK, "R_s_ohm": 1.8e5})
    alone = result.naming.weighed["leakage"]
    assert "log R_s_ohm" in alone.fit.at_bound  # the premise
    (pair,) = looked_for(result, alone)
    assert pair.effects == NAMES
    assert pair.log_evidence > alone.log_evidence + 100.0
    assert pair.fit.values()["R_s_ohm"] == pytest.approx(1.8e5, rel=0.02)
    assert result.verdict == "series_resistance+leakage"


@pytest.mark.long
def test_one_that_needs_no_more_is_left_alone(diagnosed):
    result = diagnosed("leakage", {**LEAK, "R_s_ohm": 5e4})
    alone = result.naming.weighed["leakage"]
    assert result.verdict == "leakage"
    assert looked_for(result, alone) == []


@pytest.mark.parametrize(("narrow", "wide", "put_back"), [
    (("series_resistance",), ("leakage",), True),
    (("series_resistance", "inertia"), ("leakage", "inertia"), True),
    (("series_resistance", "leakage"), ("leakage",), False),
    (("inertia",), ("leakage",), False),
])
def test_a_leak_is_put_back_to_a_resistance_and_not_to_both(narrow, wide, put_back):
    """A search that took the pair for the simpler explanation ended with an error."""
    assert puts_back(SimpleNamespace(effects=narrow), SimpleNamespace(effects=wide)) == put_back

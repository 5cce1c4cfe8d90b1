"""A base that leaves nothing because a mode of it does an effect's work."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.relocate import stands_in
from bayes_dea.mismatch.search.work_of_a_mode import instead_of_a_mode

NAMES = ("series_resistance", "sensor_lag", "parallel_damper", "sensor_drift")


def in_its_place(tau_s):
    """What is found beside the base on waves alone, in which nothing needs the slowest mode."""
    whole = concealed({"sensor_lag": {"tau_s_s": tau_s}} if tau_s else {})
    waves = tuple(r for r in whole.recordings if not r.name.startswith("creep"))
    campaign = replace(whole, recordings=waves)
    result = diagnose(campaign, "hooke+gm3", seed=1)
    prior = noise_prior(result.assembled)
    quest = Quest(result.base, NAMES, effect_priors(NAMES, campaign), prior, np.random.default_rng(1))
    return result.base, instead_of_a_mode(result.base, quest)


@pytest.mark.long
def test_a_lag_that_the_base_does_by_a_mode_is_found_in_its_place():
    base, found = in_its_place(1.2e-3)
    assert stands_in(base)  # the premise
    assert base.values()["k_3_Pa"] > 0.5 * base.values()["Y_Pa"]
    best = max(found, key=lambda w: w.log_evidence)
    assert {w.name for w in found} >= {"sensor_lag", "parallel_damper"}
    assert best.log_evidence > base.log_evidence + 10.0
    lag = next(w for w in found if w.name == "sensor_lag")
    assert lag.fit.values()["tau_s_s"] == pytest.approx(1.2e-3, rel=0.1)
    assert not stands_in(lag.fit)
    assert not {"sensor_drift", "series_resistance"} & {w.name for w in found}  # they do nothing of the kind


@pytest.mark.long
def test_nothing_is_tried_where_no_mode_stands_in():
    base, found = in_its_place(0.0)
    assert not stands_in(base)
    assert found == []

"""Modes that are quicker than the priors say are no further mode."""

import pytest
from concealed_campaigns import concealed

from bayes_dea.bench.rig import Material
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.priors import Prior


@pytest.mark.long
def test_modes_elsewhere_than_expected_are_not_one_more():
    """Three modes, each far quicker than its own place but near the next one: with a further mode nothing is paid.

    The noise is three times what is stated, so that the priors send the base's modes astray: 42 nats.
    """
    quick = Material(1.2e6, (60e3, 60e3, 60e3), (20.0, 1.0, 0.05))
    expected = {f"tau_{i}_s": Prior("lognormal", tau, 0.5) for i, tau in ((1, 300.0), (2, 20.0), (3, 1.0))}
    result = diagnose(concealed(scale=3.0, material=quick), "hooke+gm3", seed=1, priors=expected)
    weights = result.naming.log_weight
    further = result.naming.weighed["extra_relaxation_mode"]
    assert further.log_evidence > result.base.log_evidence + 20.0, "the base alone pays for where its modes lie"
    assert weights["none"] > weights["extra_relaxation_mode"]
    assert result.verdict == "none"
    assert result.summary["confidence"] > 0.8


@pytest.mark.long
def test_a_further_mode_that_is_there_is_one_more_wherever_the_others_lie():
    quick = Material(1.2e6, (60e3, 60e3, 60e3), (20.0, 1.0, 0.05))
    campaign = concealed({"extra_relaxation_mode": {"k_x_Pa": 120e3, "tau_x_s": 0.2}}, material=quick)
    result = diagnose(campaign, "hooke+gm3", seed=1)
    assert result.verdict == "extra_relaxation_mode"
    assert result.summary["confidence"] > 0.8

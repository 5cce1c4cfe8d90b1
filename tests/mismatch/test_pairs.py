"""Two effects at once, where the search has to look beyond the one that leads alone."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import effect_priors
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.second_thoughts import second_thoughts

LEAK = {"R_leak_ohm": 1e8, "R_s_ohm": 9.4e4, "E_0_V_per_m": 1.45e6}
HYSTERESIS = {"sigma_y_Pa": 8800.0, "eps_y": 2.25e-3}
MULLINS = {"mullins_share": 0.03, "mullins_m_Pa": 60.0, "mullins_b": 0.84}


@pytest.mark.long
def test_a_leak_that_the_field_activates_is_found_beside_a_stronger_effect():
    """A plain leak beside the hysteresis stays hundreds of nats behind one that the field activates."""
    campaign = concealed({"leakage": LEAK, "rate_independent_hysteresis": HYSTERESIS})
    result = diagnose(campaign, "hooke+gm3", seed=1)
    assert set(result.verdict.split("+")) == {"leakage", "rate_independent_hysteresis"}
    found = result.summary["hypotheses"][0]["parameters"]
    for name, true in {**LEAK, **HYSTERESIS}.items():
        f = found[name]
        assert f["mean"] == pytest.approx(true, abs=4 * f["sd"]), name


@pytest.mark.long
def test_another_first_effect_is_found_beside_the_second():
    """Amplitude softening leads alone; beside the Mullins softening that it brought, thickness feedback does better."""
    result = diagnose(concealed({"thickness_feedback": {}, "mullins_softening": MULLINS}), "hooke+gm3", seed=1)
    assert set(result.verdict.split("+")) == {"thickness_feedback", "mullins_softening"}
    pair = result.naming.weighed["amplitude_softening+mullins_softening"]
    names = ["thickness_feedback", "stretch_dependent_permittivity", "amplitude_softening", "mullins_softening"]
    priors = dict(effect_priors(names, result.assembled.campaign))
    prior = noise_prior(result.assembled)
    found = second_thoughts(pair, Quest(result.base, tuple(names), priors, prior, np.random.default_rng(1)))
    best = max(found, key=lambda w: w.log_evidence)
    assert set(best.effects) == {"thickness_feedback", "mullins_softening"}
    assert best.log_evidence > pair.log_evidence + 5.0

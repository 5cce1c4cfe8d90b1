"""A fit that stopped in a bent valley goes on: a slow mode gives way to a drift, and the other way round."""

import pytest

from bayes_dea.bench.concealed import draw_case, write_case
from bayes_dea.campaign import load_campaign
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.noise_prior import noise_prior
from bayes_dea.mismatch.refit import refit


@pytest.mark.long
def test_the_fit_of_what_is_named_is_at_its_end(tmp_path):
    case = draw_case(1547328)
    result = diagnose(load_campaign(write_case(case, tmp_path / "campaign")), case.model, seed=1)
    assert result.verdict == "sensor_drift"
    fit, prior = result.corrected, noise_prior(result.assembled)
    assert refit(fit.problem, fit.q, prior.start(), prior).objective > fit.objective - 0.2
    drift = result.summary["hypotheses"][0]["parameters"]["drift_m_per_s"]
    assert drift["q05"] < case.effects["sensor_drift"]["drift_m_per_s"] < drift["q95"]

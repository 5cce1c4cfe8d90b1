"""Evidence along the ridge of an effect's own parameters."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.frame import own_index
from bayes_dea.mismatch.search.ridge import integrated


def test_a_narrow_posterior_is_laplace(diagnosed):
    """A resistance of 120 +- 1 kohm is as good as normal."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    fit = result.corrected
    found = integrated(fit, own_index(result.base, fit.problem.model), np.random.default_rng(1))
    assert found is not None
    assert found[0] == pytest.approx(fit.log_evidence, abs=0.3)
    assert found[1] < 0.3


@pytest.mark.long
def test_a_ridge_is_weighed_the_same_by_other_draws_and_less_than_by_laplace():
    """A bent sensor, explained by a field-activated leak: three parameters of which the readings tell about one."""
    result = diagnose(concealed({"sensor_nonlinearity": {"q_2_per_m": -240.0}}), "hooke+gm3")
    s = result.summary
    assert s["verdict"] == "sensor_nonlinearity"
    leak = result.naming.weighed["leakage"]
    assert leak.log_evidence < result.naming.weighed["sensor_nonlinearity"].log_evidence
    assert leak.fit is not result.base
    own = own_index(result.base, leak.fit.problem.model)
    first, second = (integrated(leak.fit, own, np.random.default_rng(k)) for k in (2, 3))
    assert first is not None
    assert second is not None
    assert first[0] == pytest.approx(second[0], abs=4 * np.hypot(first[1], second[1]))

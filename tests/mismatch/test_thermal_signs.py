"""Temperature that moves the readings either way: the stack grows against its stroke, or what holds the sensor does."""

import pytest
from concealed_campaigns import concealed

from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.models.model import build_model
from bayes_dea.priors import parse_override

NAME, ALPHA = "thermal_expansion", "alpha_T_m_per_K"


@pytest.mark.long
@pytest.mark.parametrize(("alpha", "said"), [
    (3e-5, "to be taken from the recorded"), (-3e-5, "readings rise by"),
])
def test_it_is_named_with_its_sign(alpha, said):
    s = diagnose(concealed({NAME: {ALPHA: alpha}}, scale=0.5), "hooke+gm3", seed=1).summary
    assert s["verdict"] == NAME
    assert s["confidence"] > 0.9
    found = s["hypotheses"][0]["parameters"][ALPHA]
    assert found["mean"] == pytest.approx(alpha, abs=4.0 * found["sd"])
    assert said in s["statement"]
    # what calibrate has to be told, where its prior file has the other sign
    assert (ALPHA in s["corrected_priors"]) == (alpha < 0.0)
    told = dict(parse_override(f"{n}={p}") for n, p in s["corrected_priors"].items())
    model = build_model(s["corrected_model"], told)
    (prior,) = [p.prior for p in model.parameters if p.name == ALPHA]
    assert prior.a < alpha < prior.b

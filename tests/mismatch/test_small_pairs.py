"""Two effects at once, each of which moves less than the sensor resolves."""

from dataclasses import replace

import pytest
from concealed_campaigns import concealed

import bayes_dea as bd
from bayes_dea.mismatch.diagnosis import diagnose


@pytest.mark.long
def test_two_effects_below_the_resolution_are_no_unknown_physics():
    """0.3 um of both where a step is 4 um: neither alone leaves noise, and "unknown" was said of that at 0.96."""
    effects = {"charge_retention": {"a_q": 0.05, "tau_q_s": 30.0}, "sensor_drift": {"drift_m_per_s": 3e-8}}
    campaign = concealed(effects, scale=0.3, validate=False)
    chosen = ("creep_1200V.csv", "creep_600V.csv", "sine_10Hz.csv")
    campaign = replace(
        campaign,
        sensors={**campaign.sensors, "displacement": bd.Sensor(1.4e-6, 19.4e-6, 4e-6)},
        recordings=tuple(r for r in campaign.recordings if r.name in chosen),
    )
    result = diagnose(campaign, "hooke+gm3", seed=1)
    assert result.verdict == "none"
    assert result.summary["mismatch"]["detected"]
    assert "less than the sensor resolves" in result.summary["statement"]
    assert "charge_retention+sensor_drift" in result.summary["statement"]

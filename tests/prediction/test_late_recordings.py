"""From recordings that come late to a prediction that does: the whole road of a model with an effect."""

import numpy as np
import pytest
from short_runs import short_settings

import bayes_dea as bd

LATE_S = 0.030
CAMPAIGN = """
[actuator]
layers = 399
layer_thickness_m = 25e-6
relative_permittivity = 2.8
electrode_area_m2 = 7.5602e-5
total_area_m2 = 1.1450e-4
max_voltage_V = 1200
max_frequency_Hz = 100

[sensor.displacement]
fluctuation_m = 1e-6
accuracy_m = 10e-6
resolution_m = 0.1e-6

[[recording]]
file = "steps.csv"
kind = "voltage"
"""


def relaxing(t, on_s):
    """Strain per Pa at t (s) of a spring with one branch, after a stress that came on at on_s."""
    Y, k, tau = 1.2e6, 4e5, 0.5
    after = np.clip(t - on_s, 0, None)
    creep = 1 / Y - (1 / Y - 1 / (Y + k)) * np.exp(-after / (tau * (1 + k / Y)))
    return np.where(t > on_s, creep, 0.0)


@pytest.mark.long
@pytest.mark.usefixtures("without_refits")
def test_recordings_that_are_late_give_predictions_that_are(tmp_path):
    t = np.arange(1500) * 0.004
    stress = 8.8541878128e-12 * 2.8 * (900.0 / 25e-6) ** 2 * 7.5602e-5 / 1.1450e-4
    V = np.where((t > 0.5) & (t < 3.0), 900.0, 0.0)
    shown = 399 * 25e-6 * stress * (relaxing(t, 0.5 + LATE_S) - relaxing(t, 2.996 + LATE_S))
    y = shown + 1e-6 * np.random.default_rng(5).standard_normal(t.size)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    np.savetxt(tmp_path / "steps.csv", np.column_stack([t, V, y]), delimiter=",", comments="",
               header="time_s,voltage_V,displacement_m")  # fmt: skip
    with pytest.warns(bd.NotConvergedWarning):
        c = bd.calibrate(bd.load_campaign(tmp_path), bd.build_model("hooke+gm1+acquisition_delay"), seed=1,
                         settings=short_settings(max_steps=300, predictive_draws=20))  # fmt: skip
    c.save(tmp_path / "out")
    p = bd.predict(tmp_path / "out", {"time_s": t, "voltage_V": V}, draws=50)
    aside = (np.abs(t - 0.530) > 0.006) & (np.abs(t - 3.026) > 0.006)  # edges fall between rows
    np.testing.assert_allclose(p.mean[aside], shown[aside], rtol=0, atol=2e-6)
    edge = int(np.argmax(V > 0))
    assert np.max(np.abs(p.mean[: edge + 6])) < 1e-7  # 24 ms on: nothing yet
    assert p.mean[edge + 9] > 4e-5

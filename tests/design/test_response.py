"""Answers of draws to recordings that are planned."""

import numpy as np
from bench_campaigns import ACTUATOR

from bayes_dea.design.response import answers
from bayes_dea.experiments.limits import limits_of_actuator
from bayes_dea.experiments.menu import Experiment
from bayes_dea.models.model import build_model


def test_a_planned_recording_needs_no_temperature():
    recording = Experiment("creep", (1.0, 0.2), limits_of_actuator(ACTUATOR, True)).recording
    values = {"Y_Pa": 1.2e6, "k_1_Pa": 3e5, "tau_1_s": 5.0}
    out = []
    for spec, more in (("hooke+gm1+sensor_lag", {"tau_s_s": 1e-9}),
                       ("hooke+gm1+sensor_lag+thermal_expansion", {"tau_s_s": 1e-9, "alpha_T_m_per_K": 3e-6})):
        model = build_model(spec)
        point = {k: np.array([v]) for k, v in {**values, **more}.items()}
        out.append(answers(model, model.from_prior_coordinates(model.priors.to_coordinates(point)), recording))
    np.testing.assert_allclose(out[1], out[0], rtol=1e-12)
    assert out[0].max() > 1e-5

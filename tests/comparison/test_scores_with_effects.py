"""What a comparison scores a model with effects by is the density of every reading of its forward simulation."""

import numpy as np
import pytest
from bench_campaigns import ACTUATOR, SENSORS
from scipy.stats import multivariate_normal

from bayes_dea.campaign import campaign_from_recordings, recording_from_arrays
from bayes_dea.comparison.common import common_data, group_log_likelihood
from bayes_dea.comparison.fit_one import reference_at
from bayes_dea.comparison.terms import RecordTerms
from bayes_dea.forward import simulate
from bayes_dea.models.model import build_model
from bayes_dea.noise.stated import noise_terms

TRUTH = {"Y_Pa": 1.2e6, "k_1_Pa": 6e4, "tau_1_s": 1.0, "R_s_ohm": 2e6, "tau_s_s": 0.03, "d0_Pa_s": 1e4,
         "V_dead_V": 80.0}
SIGMA = 4.7e-6


def made(model, name, volts, seed):
    """A recording (n,) of a model that is true, 100 readings a second."""
    t = 0.01 * np.arange(volts.size)
    columns = {"time_s": t, "voltage_V": volts, "displacement_m": np.zeros(t.size)}
    r = recording_from_arrays(name, "voltage", columns, actuator=ACTUATOR)
    x = simulate(model, {p.name: TRUTH[p.name] for p in model.parameters}, r)
    noisy = x + SIGMA * np.random.default_rng(seed).standard_normal(t.size)
    return recording_from_arrays(name, "voltage", {**columns, "displacement_m": noisy}, actuator=ACTUATOR)


def exact(model, values, prepared, sd, offset_sd, gain_sd):
    """Log density of all readings of recordings, offsets and the common gain in their covariance."""
    x = [simulate(model, values, p.recording)[p.observed] for p in prepared]
    y = np.concatenate([p.y[p.observed] for p in prepared])
    whole = np.concatenate(x)
    covariance = sd**2 * np.eye(y.size) + gain_sd**2 * np.outer(whole, whole)
    start = 0
    for part in x:
        covariance[start : start + part.size, start : start + part.size] += offset_sd**2
        start += part.size
    return multivariate_normal(whole, covariance).logpdf(y)


@pytest.mark.parametrize("effect", [
    "series_resistance", "parallel_damper",
    *(pytest.param(e, marks=pytest.mark.long) for e in ("sensor_lag", "supply_dead_zone")),
])
def test_scores_are_those_of_the_whole_model(effect):
    model = build_model(f"hooke+gm1+{effect}")
    t = 0.01 * np.arange(300)
    levels = np.repeat([0.0, 900.0, 300.0, 1000.0, 0.0], 60)
    wave = np.where(t > 0.3, 500 + 400 * np.sin(2 * np.pi * 2.0 * t), 0.0)
    campaign = campaign_from_recordings([made(model, "levels", levels, 1), made(model, "wave", wave, 2)],
                                        {"displacement": SENSORS["displacement"]}, ACTUATOR)
    data = common_data(campaign, [model, build_model("hooke+gm1")])
    assembled = data.assembled(model)
    z = model.from_prior_coordinates(model.priors.to_coordinates(
        {p.name: np.array([TRUTH[p.name]]) for p in model.parameters}))[0]
    q = np.concatenate([z, [np.log(SIGMA), 0.0]])
    posterior = reference_at(assembled, q)
    (group,) = posterior.groups
    # the truth, and each parameter of it by some per cent off
    points = np.stack([q, *(q + 0.06 * row for row in np.eye(q.size)[: model.dimension])])
    sd = float(np.sqrt(SIGMA**2 + group.quantisation_variance))
    offset_sd = noise_terms(SENSORS["displacement"], False, 1e-3).offset_sd
    names = frozenset({"levels", "wave"})
    terms = RecordTerms.of(posterior, group, points)
    for chosen in (frozenset({"wave"}), names):
        members = [p for p in assembled.prepared if p.name in chosen]
        values = [{k: float(v[0]) for k, v in model.physical(x[None, : z.size]).items()} for x in points]
        expected = [exact(model, v, members, sd, offset_sd, group.gain_sd) for v in values]
        own = group_log_likelihood(posterior, group, points, chosen)
        np.testing.assert_allclose(own - own[0], np.array(expected) - expected[0], atol=0.5, rtol=0.02)
        np.testing.assert_allclose(terms.log_likelihood(chosen), own, atol=1e-4)
    # what a chain without the effect would score is far off
    without = exact(build_model("hooke+gm1"), TRUTH, assembled.prepared, sd, offset_sd, group.gain_sd)
    assert without < expected[0] - 20.0


@pytest.mark.parametrize(("spec", "effect"), [("pz3", "pz3+series_resistance"), ("ss3", "hooke+gm1+series_resistance"),
                                              ("hooke+gm1", "pz3+series_resistance")])
def test_black_boxes_and_effects_stand_on_one_footing(voltage_campaign, spec, effect):
    """A structure without effects has the same likelihood by its sums and as models with effects are worked out."""
    model, like = build_model(spec), build_model(effect)
    data = common_data(voltage_campaign, [model, like])
    assert data.assembled(like).search_model.name == effect.removesuffix("+series_resistance")
    posterior = data.assembled(model).posterior
    z = np.median(model.prior_draws(400, np.random.default_rng(1)), axis=0)
    x = np.concatenate([z, posterior.noise_guess()])
    x[model.dimension] += 3.0  # noise that hides what this draw misses
    here = float(posterior.log_likelihood(x[None])[0])
    there = float(reference_at(data.simulated(model, like), x).log_likelihood(x[None])[0])
    assert there == pytest.approx(here, abs=0.01)

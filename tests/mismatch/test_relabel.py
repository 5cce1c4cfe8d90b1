"""A mode of the base that went astray, and a further mode that took its place."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.relabel import in_place_of_one, labellings, within, without_stand_in
from bayes_dea.mismatch.search.weigh import Weighed


def test_a_further_mode_gives_its_place_back_to_the_one_that_went_astray(diagnosed):
    """The fit with a resistance, its middle mode sent where it serves nothing and repeated as a further one."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    right = result.corrected
    model = right.problem.model
    both = extended(model, ["extra_relaxation_mode"], {})
    values = right.values()
    stray = {**values, "k_x_Pa": values["k_2_Pa"], "tau_x_s": values["tau_2_s"], "k_2_Pa": 2e3}
    x = np.array([np.log(stray[p.name]) if p.prior.is_log else stray[p.name] for p in both.priors.free])
    q = np.concatenate([both.from_prior_coordinates(x[None])[0], right.q[model.dimension :]])
    fit = replace(right, problem=right.problem.with_model(both), q=q)
    found = Weighed(("series_resistance", "extra_relaxation_mode"), fit, 0.0, 0.1, 1e-6)
    simpler = in_place_of_one(found, result.base, model, noise_prior(result.assembled))
    assert simpler.name == "series_resistance"
    assert simpler.fit.objective == pytest.approx(right.objective, abs=0.5)
    assert simpler.fit.values()["R_s_ohm"] == pytest.approx(values["R_s_ohm"], rel=0.01)


def test_without_a_further_mode_there_is_nothing_to_put_in_place(diagnosed):
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    w = Weighed(("series_resistance",), result.corrected, 0.0, 0.1, 1e-6)
    assert in_place_of_one(w, result.base, result.corrected.problem.model, noise_prior(result.assembled)) is None


def test_what_a_mode_stood_in_for_is_looked_for_in_its_place(diagnosed):
    """A mode of 0.4 ms is a damper to a sampling step of 1 ms: the further mode takes its place, as it is."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    right = result.corrected
    model = right.problem.model
    both = extended(model, ["extra_relaxation_mode"], {})
    values = right.values()
    stray = {**values, "k_x_Pa": values["k_3_Pa"], "tau_x_s": values["tau_3_s"], "k_3_Pa": 1.1e6, "tau_3_s": 4e-4}
    x = np.array([np.log(stray[p.name]) if p.prior.is_log else stray[p.name] for p in both.priors.free])
    q = np.concatenate([both.from_prior_coordinates(x[None])[0], right.q[model.dimension :]])
    prior = noise_prior(result.assembled)
    found = Weighed(("series_resistance", "extra_relaxation_mode"),
                    replace(right, problem=right.problem.with_model(both), q=q), 0.0, 0.1, 1e-6)  # fmt: skip
    fit = without_stand_in(found, model, prior)
    for name, value in values.items():
        assert fit.values()[name] == pytest.approx(value, rel=1e-6), name
    slow = replace(found, fit=replace(found.fit, q=np.concatenate(
        [both.from_prior_coordinates(np.where(x == np.log(4e-4), np.log(0.02), x)[None])[0], right.q[model.dimension :]]
    )))  # fmt: skip
    assert without_stand_in(slow, model, prior) is None


def test_an_effect_that_is_not_needed_is_left_out_again(diagnosed):
    """From a pair with a stray second effect the fit of the first alone is the one that was right."""
    result = diagnosed("series_resistance", {"R_s_ohm": 1.2e5})
    right = result.corrected
    model = right.problem.model
    both = extended(model, ["sensor_drift"], {})
    values = {**right.values(), "drift_m_per_s": 1e-8, "R_s_ohm": 1.0e5}
    x = np.array([np.log(values[p.name]) if p.prior.is_log else values[p.name] for p in both.priors.free])
    q = np.concatenate([both.from_prior_coordinates(x[None])[0], right.q[model.dimension :]])
    fit = replace(right, problem=right.problem.with_model(both), q=q)
    found = Weighed(("series_resistance", "sensor_drift"), fit, 0.0, 0.1, 1e-6)
    alone = within(found, result.base, model, noise_prior(result.assembled))
    assert alone.name == "series_resistance"
    assert alone.fit.objective == pytest.approx(right.objective, abs=0.5)
    assert alone.size_m > 1e-6


@pytest.mark.long
def test_the_interval_of_a_further_mode_holds_every_mode_that_it_may_be():
    """A base with one mode, and two in the answer: which of them is the further one, only weak priors say."""
    result = diagnose(concealed(), "hooke+gm1", seed=1)
    assert result.verdict == "extra_relaxation_mode"
    right = result.corrected
    fits = labellings(Weighed((result.verdict,), right, right.log_evidence, 0.1, 1e-6), noise_prior(result.assembled))
    assert len(fits) == 2
    for f in fits:  # both give the same answer
        for a, b in zip(f.clean, right.clean, strict=True):
            assert np.max(np.abs(a - b)) < 0.05 * right.noise.sigma["displacement"]
    assert fits[1].values()["tau_x_s"] == pytest.approx(right.values()["tau_1_s"], rel=0.02)
    assert fits[1].values()["tau_1_s"] == pytest.approx(right.values()["tau_x_s"], rel=0.02)
    share = 1.0 / (1.0 + np.exp(fits[0].log_evidence - fits[1].log_evidence))
    assert 0.06 < share < 0.94  # or one of the two would be outside of an interval of 90 %
    said = result.summary["hypotheses"][0]["parameters"]["tau_x_s"]
    for f in fits:
        assert said["q05"] < f.values()["tau_x_s"] < said["q95"]

"""Models whose every value is a simulation: evidence and scores against those of the same function in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from bayes_dea.comparison.align import aligned
from bayes_dea.comparison.climb import climb
from bayes_dea.comparison.common import Restricted, common_data, group_log_likelihood
from bayes_dea.comparison.fit_one import _relabelled, reference_at
from bayes_dea.comparison.partners import exact_partner
from bayes_dea.comparison.run import ComparisonSettings, _one, built_models
from bayes_dea.comparison.simulated import fitted_to, with_control
from bayes_dea.comparison.terms import RecordTerms

DAMPED, SAME = "hooke+gm1+parallel_damper", "hooke+gkm1"


@pytest.fixture(scope="module")
def both(voltage_campaign):
    """A model with an effect and the one without that is the same function, each worked out in its own way."""
    built = built_models([SAME, DAMPED], {})
    data = common_data(voltage_campaign, list(built.values()))
    done = {n: _one(n, m, data, 1, ComparisonSettings(), {}, lambda *_: None) for n, m in built.items()}
    return built, data, aligned(done, data, built)[0]


def test_evidence_of_simulations_is_that_of_the_closed_form(both):
    built, data, done = both
    own = done[DAMPED].whole
    assert own.method == "emulated"
    assert own.converged
    other = exact_partner(data, built[SAME], built[DAMPED], done[SAME])
    assert abs(other.gap) < 1e-3
    assert own.log_value == pytest.approx(other.log_evidence, abs=4 * np.hypot(own.se, other.log_evidence_se) + 0.1)


def test_scores_of_simulations_are_those_of_the_closed_form(both):
    _, _, done = both
    for a, b in zip(done[DAMPED].scores, done[SAME].scores, strict=True):
        assert a.recording == b.recording
        # the priors of the damper differ a little, and a recording left out leaves them to speak
        assert a.elpd == pytest.approx(b.elpd, abs=4 * np.hypot(a.mc_se, b.mc_se) + 0.5), a.recording


def test_terms_of_single_recordings_give_any_set_of_them(both):
    _, _, done = both
    fit = done[DAMPED].fit
    q = done[DAMPED].whole.draws[:4]
    group = fit.posterior.groups[0]
    terms = RecordTerms.of(fit.posterior, group, q)
    for names in (["creep.csv"], ["creep.csv", "sine.csv"], ["sine.csv", "kept.csv"], []):
        expected = group_log_likelihood(fit.posterior, group, q, frozenset(names))
        assert np.allclose(terms.log_likelihood(names), expected, atol=1e-5)
    free = replace(terms, gain_sd=0.0)
    assert np.allclose(free.log_likelihood(["sine.csv"]), terms.alone["sine.csv"])


def test_other_recordings_to_fit(both):
    _, _, done = both
    fit = done[DAMPED].fit
    names = frozenset(["kept.csv", "sine.csv"])
    q = done[DAMPED].whole.draws[:3]
    assert np.allclose(fitted_to(fit.posterior, names).log_prob(q), Restricted(fit.posterior, names).log_prob(q))


def test_climbing_ends_at_the_maximum_of_the_same_function(both):
    _, _, done = both
    fit = done[DAMPED].fit
    rng = np.random.default_rng(0)
    away = fit.x + 3 * np.sqrt(np.diag(fit.covariance)) * np.sign(rng.standard_normal(fit.x.size))
    away = np.where(np.isfinite(fit.posterior.log_prior(away[None]))[0], away, fit.x)
    _, posterior = climb(away, lambda x: reference_at(fit.assembled, x), rng)
    x, _ = climb(away, lambda _: posterior, rng)
    assert float(posterior.log_prob(x[None])[0]) > float(posterior.log_prob(fit.x[None])[0]) - 0.3


def test_the_extra_branch_may_be_any(voltage_campaign):
    name = "hooke+gm1+extra_relaxation_mode"
    model = built_models([name], {})[name]
    data = common_data(voltage_campaign, [model])
    assembled = data.assembled(model)
    z = model.prior_draws(1, np.random.default_rng(3))[0]
    start = np.concatenate([z, assembled.posterior.noise_guess()])
    found = _relabelled(assembled, model, start)
    assert len(found) == 2
    assert any(np.allclose(x, start) for x in found)
    posterior = reference_at(assembled, start)
    a, b = posterior.log_likelihood(np.array(found))
    assert a == pytest.approx(b, abs=1e-5)


def test_a_control_that_is_off_biases_nothing():
    """The integral of exp(-x^2/2) by draws of a wider normal, the control too narrow and shifted."""
    rng = np.random.default_rng(4)

    def weights(x, s, m):
        return -0.5 * ((x - m) / s) ** 2 + 0.5 * (x / 1.5) ** 2 + np.log(1.5) + 0.5 * np.log(2 * np.pi)

    errors, se, plain = [], [], []
    for _ in range(200):
        few, many = 1.5 * rng.standard_normal(200), 1.5 * rng.standard_normal(4000)
        value, error = with_control(weights(few, 1.0, 0.0), weights(few, 0.9, 0.1), weights(many, 0.9, 0.1))
        errors.append(value - 0.5 * np.log(2 * np.pi))
        se.append(error)
        plain.append(np.log(np.mean(np.exp(weights(few, 1.0, 0.0)))))
    assert abs(np.mean(errors)) < 3 * np.std(errors) / np.sqrt(200) + 0.002
    assert np.std(errors) == pytest.approx(np.mean(se), rel=0.25)
    assert np.std(errors) < 0.6 * np.std(plain)

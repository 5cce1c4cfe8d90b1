"""Noise models: shapes, domains, limits."""

import numpy as np
import pytest
from scipy import stats

from bayes_dea.noise import densities as d

R = np.random.default_rng(0).normal(0, 0.5, 30)


def test_parameters_broadcast_against_draws():
    sigma = np.array([0.3, 0.5, 0.9])
    residuals = np.stack([R, 2 * R, R + 0.1])
    each = [stats.norm.logpdf(r, scale=s).sum() for r, s in zip(residuals, sigma, strict=True)]
    np.testing.assert_allclose(d.gaussian(residuals, sigma), each)
    assert d.gaussian(R, sigma).shape == (3,)
    assert d.ar1(R, np.array([0.0, 0.4, -0.3]), sigma).shape == (3,)
    assert d.student_t(R, 4.0, sigma).shape == (3,)
    assert d.interval(R, sigma, 0.1).shape == (3,)
    assert d.censored(R, np.zeros(30), sigma, upper=0.2).shape == (3,)


def test_ar1_is_the_dense_normal():
    cov = 0.49 * 0.7 ** np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
    expected = stats.multivariate_normal(np.zeros(30), cov).logpdf(R)
    assert d.ar1(R, 0.7, 0.7) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("value", [
    d.gaussian(R, 0.0), d.gaussian(R, -1.0), d.student_t(R, -1.0, 1.0), d.ar1(R, 1.0, 1.0),
    d.ar1(R, 0.2, np.nan), d.multiplicative(R, R, 1.0, -1.0),
    d.constant_and_multiplicative(R, R, 0.1, 1.0, -0.1), d.censored(R, R, 0.0), d.interval(R, -0.1, 0.1)])
def test_outside_the_domain_is_minus_infinity(value):
    assert value == -np.inf


def test_interval_tends_to_the_density():
    assert d.interval(R, 0.5, 1e-4) == pytest.approx(float(d.gaussian(R, 0.5)), abs=1e-6)


def test_interval_probabilities_add_up_to_one():
    step = 2.0
    centres = step * np.arange(-20, 21) + 0.3
    values = np.exp([float(d.interval([c], 0.4, step)) for c in centres]) * step
    assert values.sum() == pytest.approx(1.0, abs=1e-12)


def test_interval_keeps_its_digits_far_out():
    far = float(d.interval([50.0], 1.0, 0.1))
    assert np.isfinite(far)
    assert far == pytest.approx(stats.norm.logpdf(50.0 - 0.05) - np.log(50.0 - 0.05) - np.log(0.1), abs=0.02)


def test_censored_without_limits_is_gaussian():
    assert d.censored(R, 0 * R, 0.5) == pytest.approx(float(d.gaussian(R, 0.5)), abs=1e-10)

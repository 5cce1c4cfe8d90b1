"""Sequential Monte Carlo where the answer is known: a normal mean under a normal prior."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayes_dea.errors import BayesDEAError
from bayes_dea.live.sequential import SequentialSettings, advance, begin, spread_out

PRIOR = multivariate_normal(np.zeros(3), np.diag([4.0, 1.0, 25.0]))
COVARIANCE = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.4]])


def log_prior(x):
    return PRIOR.logpdf(x)


def likelihood(data):
    precision = np.linalg.inv(COVARIANCE)
    constant = -0.5 * len(data) * np.log((2 * np.pi) ** 3 * np.linalg.det(COVARIANCE))

    def of(x):
        out = np.full(len(x), constant)
        for y in data:
            out -= 0.5 * np.einsum("ni,ij,nj->n", x - y, precision, x - y)
        return out

    return of


def test_blocks_give_mean_spread_and_evidence_of_all_data_at_once():
    rng = np.random.default_rng(1)
    truth = np.array([1.0, -0.5, 4.0])
    data = rng.multivariate_normal(truth, COVARIANCE, 40)
    settings = SequentialSettings(2000)
    particles = begin(rng.multivariate_normal(np.zeros(3), PRIOR.cov, 2000), log_prior)
    evidence = 0.0
    cuts = [0, 1, 2, 5, 10, 20, 30, 40]
    for a, b in pairwise(cuts):
        step = advance(particles, log_prior, likelihood(data[:a]), likelihood(data[:b]), rng, settings)
        particles, evidence = step.particles, evidence + step.log_evidence
    precision = np.linalg.inv(PRIOR.cov) + 40 * np.linalg.inv(COVARIANCE)
    exact = np.linalg.inv(precision)
    mean = exact @ (np.linalg.inv(COVARIANCE) @ data.sum(axis=0))
    sd = np.sqrt(np.diag(exact))
    x = spread_out(particles.x[rng.choice(2000, 4000, p=particles.weights)], log_prior, likelihood(data), rng, settings)
    assert np.all(np.abs(x.mean(axis=0) - mean) < 0.1 * sd)
    assert np.all(np.abs(x.std(axis=0) / sd - 1) < 0.05)
    joint = np.kron(np.ones((40, 40)), PRIOR.cov) + np.kron(np.eye(40), COVARIANCE)
    assert evidence == pytest.approx(multivariate_normal(np.zeros(120), joint).logpdf(data.ravel()), abs=0.3)


def test_a_block_that_says_little_only_shifts_weights():
    rng = np.random.default_rng(2)
    particles = begin(rng.multivariate_normal(np.zeros(3), PRIOR.cov, 500), log_prior)
    step = advance(particles, log_prior, lambda x: np.zeros(len(x)), lambda x: 0.01 * x[:, 0], rng,
                   SequentialSettings(500))
    assert step.sweeps == 0
    assert np.array_equal(step.particles.x, particles.x)
    assert step.particles.weights.sum() == pytest.approx(1.0)
    assert step.particles.effective < 500


def test_draws_that_cannot_explain_anything_are_an_error():
    rng = np.random.default_rng(3)
    particles = begin(rng.standard_normal((300, 3)), log_prior)
    with pytest.raises(BayesDEAError, match="no draw"):
        advance(particles, log_prior, lambda x: np.zeros(len(x)), lambda x: np.full(len(x), np.nan), rng,
                SequentialSettings(300))

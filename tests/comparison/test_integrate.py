"""Integrals against closed forms: one place, several places, a curved valley."""

import numpy as np
import pytest
from benchmarks.evidence import ours
from benchmarks.evidence_problems import linear_gaussian, unknown_noise
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from bayes_dea.comparison.anneal import AnnealSettings, anneal
from bayes_dea.comparison.integrate import IntegralSettings, integrate, normal_mixture
from bayes_dea.comparison.widths import scaled_prior
from bayes_dea.priors import Prior


@pytest.mark.parametrize("problem", [linear_gaussian, unknown_noise])
def test_closed_forms_by_every_way(problem):
    p = problem()
    for name, found in ours(p, bridge=problem is linear_gaussian).items():
        assert abs(found["log_evidence"] - p.exact) < max(0.1, 4 * found["se"]), name
        assert found["se"] < 0.15, name


def banana(x):
    """A normal bent along a parabola: the Jacobian is one, the integral 2 pi sd."""
    y = x.copy()
    y[:, 1] -= x[:, 0] ** 2 - 1.0
    return -0.5 * (y[:, 0] ** 2 + (y[:, 1] / 0.1) ** 2)


def test_a_curved_valley_needs_more_than_a_normal():
    exact = np.log(2 * np.pi * 0.1)
    start = np.array([0.0, -1.0])
    found = integrate(banana, start, np.diag([1.0, 0.01]), np.random.default_rng(0))
    # a tenth as wide as it is bent: the far ends are reached late, and the scatter of the populations does not show it
    assert abs(found.log_value - exact) < 0.3
    assert found.method == "annealed"
    assert found.draws[:, 0].std() == pytest.approx(1.0, abs=0.3)


def test_populations_know_how_much_is_where():
    share = np.array([0.8, 0.2])
    parts = [multivariate_normal([-5.0] * 4, 0.3), multivariate_normal([5.0] * 4, 0.2)]

    def two(x):
        return logsumexp([np.log(w) + np.atleast_1d(p.logpdf(x)) for w, p in zip(share, parts, strict=True)], axis=0)

    wide = normal_mixture(np.zeros(4), 36.0 * np.eye(4))
    found = anneal(wide.draw, wide.log_density, two, np.random.default_rng(1), AnnealSettings(particles=800))
    assert abs(found.log_ratio) < 0.35
    assert (found.draws[:, 0] < 0).mean() == pytest.approx(0.8, abs=0.15)


def test_no_last_resort_says_so():
    found = integrate(banana, np.array([0.0, -1.0]), 1e-4 * np.eye(2), np.random.default_rng(0),
                      IntegralSettings(rounds=1, last_resort="none"))
    assert not found.converged


@pytest.mark.parametrize(
    "prior", [Prior("lognormal", 2.0, 0.5), Prior("normal", 1.0, 3.0), Prior("uniform", 1.0, 5.0),
              Prior("loguniform", 1.0, 100.0)])
def test_wider_priors_keep_their_centre(prior):
    wide = scaled_prior(prior, 2.0)
    assert wide.coordinate_sd() == pytest.approx(2 * prior.coordinate_sd())
    middle = np.array([0.5])
    assert wide.ppf(middle) == pytest.approx(prior.ppf(middle))
    assert scaled_prior(Prior("fixed", 3.0), 2.0) == Prior("fixed", 3.0)

"""Integrals against closed forms: one place, several places, a curved valley."""

import numpy as np
import pytest
from benchmarks.evidence import ours
from benchmarks.evidence_problems import linear_gaussian, unknown_noise
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from bayes_dea.comparison.anneal import AnnealSettings, anneal
from bayes_dea.comparison.integrate import IntegralSettings, bridged, integrate, normal_mixture, straightened
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


def test_a_curved_valley_is_made_straight():
    exact = np.log(2 * np.pi * 0.1)
    found = integrate(banana, np.array([0.0, -1.0]), np.diag([1.0, 0.01]), np.random.default_rng(0))
    assert found.method == "straightened"
    assert found.converged
    assert abs(found.log_value - exact) < max(4 * found.se, 0.03)
    assert found.draws[:, 0].std() == pytest.approx(1.0, abs=0.1)


def long_banana(x):
    """A normal of four dimensions whose second and third bend by ninety and thirty of their widths at its tips."""
    y = x.copy()
    y[:, 1] += 0.1 * (x[:, 0] ** 2 - 100.0)
    y[:, 2] -= 0.03 * x[:, 0] ** 2
    y[:, 0] /= 10.0
    return -0.5 * np.sum(y**2, axis=1)


@pytest.mark.long
def test_standard_errors_of_curved_valleys_are_what_the_estimates_scatter_by():
    exact = 2 * np.log(2 * np.pi) + np.log(10.0)
    start = np.array([0.0, 10.0, 0.0, 0.0])
    far = []
    for seed in range(6):
        found = integrate(long_banana, start, np.diag([100.0, 1, 1, 1]), np.random.default_rng(seed))
        assert found.converged
        far.append((found.log_value - exact) / found.se)
    assert np.max(np.abs(far)) < 4
    assert np.sqrt(np.mean(np.square(far))) < 2


def test_populations_that_agree_on_too_little_get_the_gap_as_their_error():
    from bayes_dea.comparison.anneal import Annealed
    from bayes_dea.comparison.integrate import honest_se

    draws = np.zeros((1, 1))
    far = Annealed(1.0, 0.05, draws, True, 0)
    checked = integrate(lambda x: -0.5 * np.sum(x**2, axis=1), np.zeros(2), np.eye(2), np.random.default_rng(0))
    assert honest_se(far, checked) == pytest.approx(abs(1.0 - checked.log_value))
    near = Annealed(checked.log_value + 0.05, 0.05, draws, True, 0)
    assert honest_se(near, checked) == pytest.approx(0.06)


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


def test_a_second_way_that_falls_short_with_useless_weights_is_no_error():
    """Draws at several places lie straight in no coordinates: what these miss says nothing of the populations."""
    from dataclasses import replace

    from bayes_dea.comparison.anneal import Annealed
    from bayes_dea.comparison.integrate import honest_se, usable

    good = integrate(lambda x: -0.5 * np.sum(x**2, axis=1), np.zeros(2), np.eye(2), np.random.default_rng(0))
    assert usable(good)
    far = Annealed(good.log_value + 50.0, 0.1, np.zeros((1, 1)), True, 0)
    assert honest_se(far, good) == pytest.approx(50.0)
    useless = replace(good, pareto_k=1.0, se=1.0)
    assert honest_se(far, useless) == pytest.approx(0.12)
    # whatever its weights, draws that found more have found what the populations missed
    below = Annealed(good.log_value - 50.0, 0.1, np.zeros((1, 1)), True, 0)
    assert honest_se(below, useless) == pytest.approx(50.0)


def test_draws_without_a_density_end_in_no_value_rather_than_an_error():
    found = straightened(lambda x: np.full(len(x), -np.inf), np.random.default_rng(0).standard_normal((300, 3)),
                         np.random.default_rng(1), IntegralSettings())
    assert not found.converged
    assert not np.isfinite(found.log_value)


def test_what_is_far_behind_is_left_with_a_larger_error():
    def low(x):
        return multivariate_normal(np.zeros(4), 0.3).logpdf(np.atleast_2d(x)) - 40.0

    wide = normal_mixture(np.zeros(4), 4.0 * np.eye(4))
    runs = [anneal(wide.draw, wide.log_density, low, np.random.default_rng(2), AnnealSettings(enough_below=below))
            for below in (-20.0, -60.0)]
    assert runs[0].evaluations < 0.6 * runs[1].evaluations
    assert not runs[0].settled
    for found in runs:
        assert abs(found.log_ratio + 40.0) < max(4 * found.se, 0.3)


def test_a_bridge_from_a_handful_of_distinct_draws():
    """Resampling a few heavy weights leaves copies of them: walkers there would lie in a subspace."""
    density = multivariate_normal(np.zeros(6), np.eye(6))
    around = np.repeat(density.rvs(3, random_state=0), 500, axis=0)
    found = bridged(lambda x: np.atleast_1d(density.logpdf(x)), around, normal_mixture(np.zeros(6), 2.0 * np.eye(6)),
                    np.random.default_rng(0))
    assert found.converged
    assert abs(found.log_value) < max(0.1, 4 * found.se)


def shell(x):
    """A thin shell in ten dimensions, far from where it is looked for."""
    return -0.5 * ((np.linalg.norm(x, axis=1) - 1.0) / 1e-6) ** 2


@pytest.mark.parametrize("resort", ["anneal", "bridge"])
def test_what_no_way_leads_to_is_said_and_costs_no_more_than_it_should(resort):
    few = AnnealSettings(populations=4, particles=60, moves=1, last_moves=1, most_stages=60, patience=8)
    s = IntegralSettings(draws=200, per_dimension=1, last_resort=resort, anneal=few, bridge_steps=100)
    start = np.zeros(10)
    start[0] = 1.0
    found = integrate(shell, start, 1e-3 * np.eye(10), np.random.default_rng(0), s)
    assert not found.converged
    assert found.evaluations < 150_000


def test_no_draws_to_begin_a_bridge_from_end_in_no_value():
    found = bridged(lambda x: np.full(len(x), -np.inf), np.zeros((50, 3)), normal_mixture(np.zeros(3), np.eye(3)),
                    np.random.default_rng(0))
    assert not found.converged
    assert not np.isfinite(found.log_value)


@pytest.mark.long
def test_populations_that_would_not_arrive_give_up():
    """At the pace of the last stages one would not be reached: the first population ends, and with it all."""
    calls = []

    def narrow(x):
        calls.append(len(x))
        return -0.5 * np.sum((x / 1e-4) ** 2, axis=1)

    wide = normal_mixture(np.zeros(4), np.eye(4))
    given_up, whole = [], []
    for keep, into in ((0.99, given_up), (0.5, whole)):
        calls.clear()
        s = AnnealSettings(particles=200, moves=4, last_moves=4, keep=keep)
        found = anneal(wide.draw, wide.log_density, narrow, np.random.default_rng(0), s)
        into += [found, sum(calls) / 200]
    assert not np.isfinite(given_up[0].log_ratio)
    assert not given_up[0].settled
    assert given_up[1] < 4 * (s.patience + 5)
    assert np.isfinite(whole[0].log_ratio)
    assert abs(whole[0].log_ratio + 4 * np.log(1e4 / np.sqrt(2 * np.pi))) < 2.0

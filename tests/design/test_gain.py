"""Expected information gain against closed forms and against brute force."""

import numpy as np
import pytest
from scipy.stats import norm

from bayes_dea.design.discriminate import expected_telling
from bayes_dea.design.gain import (
    Surrogate,
    coordinates,
    expected_gain,
    features,
    linear_after,
    linear_gain,
    shrinkage,
    shrinkage_range,
    surrogate,
)
from bayes_dea.design.response import without


def closed_form(A, C, learned):
    """Gain about the first `learned` of x ~ N(0, C) by y = x A + N(0, I), from covariances of y alone."""
    whole = np.linalg.slogdet(np.eye(A.shape[1]) + A.T @ C @ A)[1]
    if learned == len(C):
        return 0.5 * whole
    P, N = slice(None, learned), slice(learned, None)
    given = C[N, N] - C[N, P] @ np.linalg.solve(C[P, P], C[P, N])
    return 0.5 * (whole - np.linalg.slogdet(np.eye(A.shape[1]) + A[N].T @ given @ A[N])[1])


@pytest.mark.parametrize("learned", [4, 3])
def test_linear_gaussian_agrees_with_the_closed_form_within_one_per_cent(learned):
    rng = np.random.default_rng(learned)
    M = rng.standard_normal((4, 4))
    C = M @ M.T + 0.1 * np.eye(4)
    A = rng.standard_normal((4, 30)) * 0.8
    x = rng.multivariate_normal(np.zeros(4), C, 200_000)
    at = coordinates(x, learned, np.arange(0, 200_000, 1000))
    g = expected_gain(surrogate(at, x[::1000] @ A), at, np.random.default_rng(1))
    expected = closed_form(A, C, learned)
    assert expected > 1.0
    assert g.nats == pytest.approx(expected, rel=0.01)
    assert g.linear == pytest.approx(expected, rel=0.01)
    # nested Monte Carlo adds nothing where the answers are linear, whatever its draws
    assert g.nats == pytest.approx(g.linear, abs=1e-6)
    # the error that is stated is that of the draws of the posterior
    assert abs(g.nats - expected) < 4 * g.se < 0.05


def test_nested_monte_carlo_agrees_with_quadrature_where_answers_bend():
    """One parameter, y = a x + b x^2 + noise: the gain by quadrature on a grid."""
    a, b = 2.0, 0.45
    x = norm.ppf((np.arange(4000) + 0.5) / 4000)[:, None]
    at = coordinates(np.random.default_rng(0).permutation(x), 1, np.arange(0, 4000, 10))
    s = surrogate(at, a * at.v + b * at.v**2)
    assert s.misfit < 1e-9
    g = expected_gain(s, at, np.random.default_rng(2), inner=40)
    y = np.linspace(-12, 40, 8001)
    grid, weight = np.polynomial.hermite_e.hermegauss(120)
    p = norm.pdf(y[:, None] - (a * grid + b * grid**2)) @ (weight / weight.sum())
    entropy = -np.trapezoid(np.where(p > 0, p * np.log(np.maximum(p, 1e-300)), 0.0), y)
    exact = entropy - 0.5 * np.log(2 * np.pi * np.e)
    assert abs(g.linear - exact) > 0.015, "the bend matters here"
    assert abs(g.nats - exact) < min(3 * g.se, 0.03)


def test_a_gain_of_the_sensor_that_is_unknown_takes_what_it_can_explain():
    """y = x (1 + g): with a free gain a reading of x alone says nothing of the parameter."""
    J = np.array([[3.0], [1000.0]])
    assert linear_gain(J, 1) < 1e-4
    assert linear_gain(np.array([[3.0], [0.0]]), 1) == pytest.approx(0.5 * np.log(10.0))


def test_coordinates_have_unit_covariance_and_gains_come_last():
    rng = np.random.default_rng(3)
    x = rng.standard_normal((5000, 3)) @ np.array([[1, 0.5, 2], [0, 1e-6, 0], [0, 0, 50.0]])
    at = coordinates(x, 2)
    assert np.allclose(at.outer.T @ at.outer / 5000, np.eye(3), atol=1e-6)
    # the last one is independent of the parameters
    assert np.abs(np.corrcoef(at.v[:, 2], x[:, 0])[0, 1]) < 1e-6


def test_a_surrogate_moves_with_its_coordinates():
    rng = np.random.default_rng(4)
    curved = rng.standard_normal((3, 3, 5))
    s = Surrogate(rng.standard_normal(5), rng.standard_normal((3, 5)), curved + curved.transpose(1, 0, 2), 0.0)
    root, mean, w = rng.standard_normal((3, 3)), rng.standard_normal(3), rng.standard_normal((7, 3))
    assert np.allclose(s.moved(mean, root).at(w), s.at(mean + w @ root.T))
    step = 1e-6 * np.eye(3)[1]
    assert np.allclose((s.at(w + step) - s.at(w - step)) / 2e-6, s.slope(w)[:, 1], atol=1e-5)
    assert features(w).shape == (7, 10)


def test_integrating_nuisance_out_is_a_change_of_covariance():
    rng = np.random.default_rng(5)
    y, U = rng.standard_normal((4, 9)), rng.standard_normal((9, 2)) * 5
    z = without(y, U)
    assert np.allclose(z @ z.T, y @ np.linalg.solve(np.eye(9) + U @ U.T, y.T))


def test_two_known_points_agree_with_quadrature():
    """Two hypotheses without free parameters: mutual information of a binary channel with normal noise."""
    d, p = 1.7, np.array([0.7, 0.3])
    rng = np.random.default_rng(6)
    direction = np.ones(4) / 2
    small = 1e-7 * rng.standard_normal((2, 50, 4))
    told = expected_telling([small[0], d * direction + small[1]], p, np.random.default_rng(7), 4000)
    y = np.linspace(-9, 11, 20001)
    like = np.stack([norm.pdf(y), norm.pdf(y - d)])
    mixed = p @ like
    exact = sum(w * np.trapezoid(f * np.log(f / mixed), y) for w, f in zip(p, like, strict=True))
    assert abs(told.nats - exact) < max(4 * told.se, 0.004)
    assert told.apart[0, 1] == pytest.approx(0.5 * d**2, rel=0.05)


def test_what_separates_nothing_tells_nothing_and_what_separates_all_tells_all():
    rng = np.random.default_rng(8)
    same = rng.standard_normal((60, 6))
    p = np.array([0.5, 0.5])
    assert expected_telling([same, same], p, np.random.default_rng(9)).nats < 1e-9
    far = expected_telling([same, same + 100.0], p, np.random.default_rng(9))
    assert far.nats == pytest.approx(np.log(2.0), abs=1e-6)
    assert far.right == pytest.approx(1.0)


def test_ranges_of_widths_are_points_where_all_is_linear_and_wide_where_it_bends():
    rng = np.random.default_rng(10)
    x = rng.standard_normal((4000, 2))
    at = coordinates(x, 2)
    straight = Surrogate(np.zeros(3), 2 * rng.standard_normal((2, 3)), np.zeros((2, 2, 3)), 0.0)
    quantity = {"a": x @ np.array([1.0, 0.4])}
    after = linear_after(straight.linear)
    low, high = shrinkage_range(at, quantity, straight)["a"]
    assert low == pytest.approx(high, rel=1e-3)
    assert low == pytest.approx(shrinkage(at, quantity, after)["a"], rel=0.01)
    # answers that saturate on one side: there nothing is learned, on the other much
    bent = Surrogate(np.zeros(1), np.array([[4.0], [0.0]]), np.array([[[2.4], [0.0]], [[0.0], [0.0]]]), 0.0)
    low, high = shrinkage_range(at, {"a": x[:, 0]}, bent)["a"]
    assert high > 3 * low

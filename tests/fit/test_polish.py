"""Newton polish of a log density, least squares polish, variable projection, linear parameters."""

import numpy as np
import pytest

from bayes_dea.errors import InputError
from bayes_dea.fit.polish import polish_least_squares, polish_newton
from bayes_dea.fit.varpro import (
    LinearPrior,
    SeparableProblem,
    assemble,
    find_linear_parameters,
    project,
    separate,
)


def test_newton_on_an_ill_conditioned_gaussian():
    rng = np.random.default_rng(0)
    d = 8
    q = np.linalg.qr(rng.normal(size=(d, d)))[0]
    precision = q @ np.diag(np.logspace(8, 0, d)) @ q.T
    centre = rng.normal(size=d)

    def f(x):
        return 1e4 - 0.5 * np.einsum("ki,ij,kj->k", x - centre, precision, x - centre)

    r = polish_newton(f, centre + 0.5 * rng.normal(size=d))
    assert r.converged
    assert r.value == pytest.approx(1e4, abs=1e-5)
    assert np.linalg.slogdet(-r.hessian)[1] == pytest.approx(np.linalg.slogdet(precision)[1], abs=1e-5)
    assert not r.at_bound.any()


def test_newton_through_a_curved_valley():
    def f(x):
        return -0.5 * x[:, 0] ** 2 - 0.5 * ((x[:, 1] - x[:, 0] ** 2) / 0.05) ** 2

    r = polish_newton(f, [3.0, 7.0])
    assert r.converged
    np.testing.assert_allclose(r.x, 0.0, atol=5e-3)
    # At x0 = 1e-3 sd off the top the exact curvature is already 1.6 % less.
    np.testing.assert_allclose(np.diag(r.hessian), [-1.0, -400.0], rtol=2e-2)


def test_newton_knows_the_top_of_a_bent_valley_when_it_stands_there():
    """Where the fourth power rules the widths of the stencil must not swing for ever."""

    def valley(bend):
        def f(x):
            across = x[:, 1] - bend * x[:, 0] ** 2
            return -0.5 * 1e-4 * x[:, 0] ** 2 - 0.5 * (across / 1e-2) ** 2 - 0.5 * x[:, 2] ** 2

        return f

    for bend in (0.3, 3.0, 30.0, 300.0):
        r = polish_newton(valley(bend), np.zeros(3))
        assert r.converged
        assert r.iterations < 20
        np.testing.assert_allclose(np.diag(r.hessian), [-1e-4, -1e4, -1.0], rtol=1e-3)


def test_newton_beside_and_on_a_wall():
    def gamma(x):
        with np.errstate(all="ignore"):
            return np.where((x > 0).all(axis=1), np.sum(1.05 * np.log(x) - x, axis=1), -np.inf)

    inside = polish_newton(gamma, [1e-3, 3.0])
    assert inside.converged
    np.testing.assert_allclose(inside.x, 1.05, rtol=1e-3)
    np.testing.assert_allclose(np.diag(inside.hessian), -1 / 1.05, rtol=1e-3)

    def slope(x):
        return -3 * np.sum(x, axis=1) - 0.5 * np.sum(x**2, axis=1)

    on = polish_newton(slope, [1.0, 0.5, 2.0], [0, 0, -10], [5, 5, 5])
    np.testing.assert_array_equal(on.at_bound, [True, True, False])
    np.testing.assert_allclose(on.x, [0.0, 0.0, -3.0], atol=1e-6)
    assert np.isnan(on.hessian[0]).all()
    assert on.hessian[2, 2] == pytest.approx(-1.0, rel=1e-4)


def test_newton_needs_a_finite_start():
    with pytest.raises(InputError, match="not finite at the start"):
        polish_newton(lambda x: np.full(len(x), -np.inf), [0.0])
    with pytest.raises(InputError, match="outside the bounds"):
        polish_newton(lambda x: -x[:, 0], [2.0], [0.0], [1.0])


def test_least_squares_with_parameters_decades_apart():
    """A rate of 1e-7 beside a level of 1e3: an absolute difference step would not see it."""
    x = np.linspace(0.0, 1e7, 50)

    def residuals(t):
        return t[:, :1] * np.exp(-t[:, 1:] * x) - 1.234e3 * np.exp(-2.5e-7 * x)

    r = polish_least_squares(residuals, [900.0, 1e-7])
    np.testing.assert_allclose(r.x, [1.234e3, 2.5e-7], rtol=1e-9)
    assert r.evaluations < 500


def test_least_squares_keeps_bounds_and_refuses_bad_trials():
    def residuals(t):
        with np.errstate(invalid="ignore"):
            return np.log(t) - np.log([4.0, 0.1])  # nan for t < 0

    r = polish_least_squares(residuals, [0.5, 3.0])
    np.testing.assert_allclose(r.x, [4.0, 0.1], rtol=1e-8)
    r = polish_least_squares(residuals, [0.5, 3.0], [0.0, 0.3], [2.0, 5.0])
    np.testing.assert_allclose(r.x, [2.0, 0.3], rtol=1e-6)
    with pytest.raises(InputError, match="not finite"):
        polish_least_squares(residuals, [-1.0, 1.0])


def test_projection_equals_lstsq_also_without_full_rank():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(5, 30, 4)), rng.normal(size=(5, 30))
    a[:, :, 2] *= 1e-200  # underflows when squared
    a[3, :, 1] = 2 * a[3, :, 0]
    a[4, :, 3] = 0.0
    p = project(a, b)
    for k in range(5):
        size = np.abs(a[k]).max(axis=0)
        size[size == 0] = 1.0
        c, *_ = np.linalg.lstsq(a[k] / size, b[k], rcond=1e-12)
        assert p.chi2[k] == pytest.approx(np.sum((b[k] - a[k] / size @ c) ** 2), rel=1e-10)
        np.testing.assert_allclose(b[k] - a[k] @ p.coefficients[k], p.residuals[k], atol=1e-10)
        if k < 3:
            np.testing.assert_allclose(p.coefficients[k] * size, c, rtol=1e-8)


def test_projection_of_a_basis_that_is_not_finite():
    a = np.ones((2, 5, 1))
    a[1, 2, 0] = np.inf
    p = project(a, np.ones((2, 5)))
    np.testing.assert_array_equal(p.chi2, [0.0, np.inf])
    assert np.isnan(p.coefficients[1, 0])


def test_weights_and_prior_on_the_linear_part():
    """With a Gaussian prior the projected minimum is the posterior mode of a linear Gaussian model."""
    rng = np.random.default_rng(2)
    x = np.linspace(0, 1, 40)
    y = 2 + 3 * np.exp(-4 * x) + 0.1 * rng.normal(size=40)
    sigma, prior = np.linspace(0.05, 0.2, 40), LinearPrior(np.array([1.0, 2.0]), np.array([0.1, np.inf]))
    problem = SeparableProblem(
        lambda a: np.stack([np.ones((len(a), 40)), np.exp(-a * x)], axis=-1), y, None, sigma**-2.0, prior
    )
    got = problem.project(np.array([[4.0]]))
    basis = np.stack([np.ones(40), np.exp(-4 * x)], axis=1)
    precision = (basis.T / sigma**2) @ basis + np.diag([100.0, 0.0])
    mode = np.linalg.solve(precision, basis.T @ (y / sigma**2) + np.array([100.0, 0.0]))
    np.testing.assert_allclose(got.coefficients[0], mode, rtol=1e-10)
    chi2 = np.sum(((y - basis @ mode) / sigma) ** 2) + ((mode[0] - 1) / 0.1) ** 2
    assert got.chi2[0] == pytest.approx(chi2, rel=1e-10)
    assert problem.negative_log_likelihood(np.array([[4.0]]))[0] == pytest.approx(chi2 / 2)


def test_linear_parameters_are_found_jointly():
    x = np.linspace(0.1, 3, 20)
    theta = np.random.default_rng(0).uniform(0.5, 2.0, size=(40, 4))

    def sums(t):
        a, k, c, e = t.T[:, :, None]
        return a * np.exp(-k * x) + c * x + np.sin(e * x)

    assert find_linear_parameters(sums, theta) == [0, 2]

    def product(t):  # linear in the first two one at a time, not together
        a, b, c, k = t.T[:, :, None]
        return a * b * x + c * np.exp(-k * x)

    found = find_linear_parameters(product, theta)
    assert len(found) == 2
    assert 2 in found
    assert 3 not in found

    def nearly(t):  # a curvature of 1e-6 is curvature
        return t[:, :1] * x + 1e-6 * t[:, :1] ** 2

    assert find_linear_parameters(nearly, theta[:, :1]) == []
    with pytest.raises(InputError, match="fewer than 3"):
        find_linear_parameters(lambda t: np.full((len(t), 3), np.nan), theta)


def test_separate_reads_basis_and_offset_off_the_model():
    x = np.linspace(0, 2, 15)

    def model(t):
        a, k, c = t.T[:, :, None]
        return np.cos(k * x) + a * np.exp(-k * x) + c

    truth = np.array([[1.5, 0.8, -0.3]])
    problem = separate(model, [0, 2], 3, model(truth)[0])
    got = problem.project(np.array([[0.8], [0.5]]))
    np.testing.assert_allclose(got.coefficients[0], [1.5, -0.3], rtol=1e-10)
    assert got.chi2[0] < 1e-24 < got.chi2[1]
    np.testing.assert_allclose(assemble(np.array([0.8]), got.coefficients[0], [0, 2]), truth[0])

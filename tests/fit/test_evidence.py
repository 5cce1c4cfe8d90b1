"""Evidence and importance weights against closed forms."""

import numpy as np
import pytest
from scipy import stats

from bayes_dea.errors import InputError
from bayes_dea.fit.evidence import (
    BridgeSettings,
    bridge_log_evidence,
    laplace_log_evidence,
    nested_log_evidence,
)
from bayes_dea.fit.importance import importance_resample
from bayes_dea.fit.mixture import fit_mixture
from bayes_dea.fit.polish import polish_newton


@pytest.mark.parametrize("d", [2, 5, 10])
def test_gaussian(d):
    rng = np.random.default_rng(d)
    cov = 0.8 + 0.2 * np.eye(d)
    post = stats.multivariate_normal(np.arange(d), cov)

    def log_prob(x):
        return np.atleast_1d(post.logpdf(x)) - 123.4

    draws = np.asarray(post.rvs(4000, random_state=rng))
    value, se = bridge_log_evidence(log_prob, draws, rng)
    assert se < 0.02
    assert abs(value + 123.4) < 3 * se
    top = float(log_prob(np.arange(d)[None])[0])
    assert laplace_log_evidence(top, -np.linalg.inv(cov)) == pytest.approx(-123.4)


def _linear_gaussian():
    """y = A log theta + e with log-normal prior: closed form, but far from Gaussian in theta itself."""
    rng = np.random.default_rng(0)
    a, sigma, prior_sd = rng.normal(size=(6, 3)), 0.8, np.array([0.5, 0.7, 1.0])
    y = a @ (prior_sd * rng.normal(size=3)) + sigma * rng.normal(size=6)
    exact = stats.multivariate_normal(np.zeros(6), sigma**2 * np.eye(6) + (a * prior_sd**2) @ a.T).logpdf(y)
    precision = a.T @ a / sigma**2 + np.diag(prior_sd**-2)
    mean = np.linalg.solve(precision, a.T @ y / sigma**2)

    def in_logs(u):
        like = stats.norm.logpdf(y, u @ a.T, sigma).sum(axis=1)
        return like + stats.norm.logpdf(u, 0.0, prior_sd).sum(axis=1)

    def in_theta(theta):
        with np.errstate(all="ignore"):
            u = np.log(theta)
            return np.where((theta > 0).all(axis=1), in_logs(u) - u.sum(axis=1), -np.inf)

    return in_logs, in_theta, mean, np.linalg.inv(precision), float(exact)


@pytest.mark.parametrize("warp", [False, True])
def test_log_normal_prior_in_its_own_coordinates(warp):
    _, in_theta, mean, cov, exact = _linear_gaussian()
    rng = np.random.default_rng(3)
    draws = np.exp(rng.multivariate_normal(mean, cov, size=4000))
    value, se = bridge_log_evidence(in_theta, draws, rng, BridgeSettings(warp=warp))
    assert se < 0.1
    assert abs(value - exact) < 3 * se


def test_laplace_from_the_polish_is_exact_for_a_linear_model():
    in_logs, _, mean, _, exact = _linear_gaussian()
    r = polish_newton(in_logs, mean + 1.0)
    assert laplace_log_evidence(r.value, r.hessian) == pytest.approx(exact, abs=1e-5)


def test_banana_has_evidence_one():
    """The twist x1 -> x1 + x0^2 has unit Jacobian, so the density stays normalised."""
    rng = np.random.default_rng(5)

    def log_prob(x):
        return stats.norm.logpdf(x[:, 0]) + stats.norm.logpdf(x[:, 1], x[:, 0] ** 2, 0.3)

    x0 = rng.standard_normal(4000)
    draws = np.stack([x0, x0**2 + 0.3 * rng.standard_normal(4000)], axis=1)
    value, se = bridge_log_evidence(log_prob, draws, rng)
    assert se < 0.05
    assert abs(value) < 3 * se


@pytest.mark.long
def test_bounded_support_and_correlated_draws_keep_the_error_honest():
    """Exponentials drawn by a slow chain: over repeats the errors are as large as claimed, not larger."""

    def log_prob(x):
        return np.where((x > 0).all(axis=1), -x.sum(axis=1), -np.inf)

    z = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        x = np.empty((2, 300, 16, 2))
        x[:, 0] = rng.standard_normal((2, 16, 2))
        for t in range(1, 300):
            x[:, t] = 0.9 * x[:, t - 1] + np.sqrt(1 - 0.81) * rng.standard_normal((2, 16, 2))
        value, se = bridge_log_evidence(log_prob, -stats.norm.logsf(x), rng)
        assert se < 0.1
        z.append(value / se)
    assert np.max(np.abs(z)) < 3.5
    assert 0.2 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_nested_sampler_agrees():
    pytest.importorskip("dynesty")
    cov = np.array([[0.04, 0.02], [0.02, 0.09]])
    like = stats.multivariate_normal([0.1, -0.2], cov)
    value, se = nested_log_evidence(
        lambda x: np.atleast_1d(like.logpdf(x)),
        lambda u: 10 * u - 5,
        2,
        np.random.default_rng(0),
        live_points=200,
    )
    assert se < 0.3
    assert abs(value + np.log(100.0)) < 3 * se


def test_laplace_and_bridge_refuse_what_they_cannot_do():
    with pytest.raises(InputError, match="coordinate 1"):
        laplace_log_evidence(0.0, np.diag([-1.0, 1.0]))
    with pytest.raises(InputError, match="not negative definite"):
        laplace_log_evidence(0.0, np.array([[-1.0, 2.0], [2.0, -1.0]]))
    with pytest.raises(InputError, match="not finite"):
        laplace_log_evidence(0.0, np.diag([-1.0, np.nan]))
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((400, 2))
    with pytest.raises(InputError, match="another density"):
        bridge_log_evidence(lambda x: np.where(x[:, 0] > 0, 0.0, -np.inf), draws, rng)
    with pytest.raises(InputError, match="subspace"):
        bridge_log_evidence(lambda x: -0.5 * np.sum(x**2, axis=1), np.repeat(draws[:, :1], 2, axis=1), rng)
    with pytest.raises(InputError, match="8 or more steps"):
        bridge_log_evidence(lambda x: x[:, 0], draws[:4], rng)


def test_mixture_is_normalised_and_draws_from_itself():
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.normal(-3, 0.5, (1500, 1)), rng.normal(2, 1.0, (1500, 1))])
    m = fit_mixture(x, rng)
    assert len(m.weights) >= 2
    grid = np.linspace(-15, 15, 20001)[:, None]
    assert np.trapezoid(np.exp(m.log_density(grid)), grid[:, 0]) == pytest.approx(1.0, abs=1e-6)
    assert stats.ks_2samp(m.draw(4000, rng)[:, 0], x[:, 0]).pvalue > 1e-3


def test_importance_draws_and_k_hat():
    rng = np.random.default_rng(2)
    x = stats.t(5).rvs(size=(6000, 1), random_state=rng) * 1.2
    target = stats.norm.logpdf(x[:, 0], 0.3, 1.0) + 7.0
    proposal = stats.t.logpdf(x[:, 0] / 1.2, 5) - np.log(1.2)
    r = importance_resample(target, proposal, x, 4000, rng)
    assert r.reliable
    assert r.k_hat < 0.5
    assert 2000 < r.ess < 6000
    assert r.log_mean_weight == pytest.approx(7.0, abs=0.05)
    assert np.sum(np.exp(r.log_weights)) == pytest.approx(1.0)
    assert r.draws.mean() == pytest.approx(0.3, abs=0.08)
    assert r.draws.std() == pytest.approx(1.0, abs=0.06)
    np.testing.assert_array_equal(r.draws, x[r.index])


def test_importance_says_when_it_fails():
    rng = np.random.default_rng(3)
    x = 0.3 * rng.standard_normal((3000, 2))
    narrow = importance_resample(
        stats.norm.logpdf(x).sum(axis=1), stats.norm.logpdf(x, 0, 0.3).sum(axis=1), x, 100, rng
    )
    assert narrow.k_hat > 0.7
    assert not narrow.reliable
    half = np.where(x[:, 0] > 0, 0.0, np.nan)
    cut = importance_resample(half, np.zeros(3000), x, 500, rng)
    assert np.all(cut.draws[:, 0] > 0)
    with pytest.raises(InputError, match="lie in the target's support"):
        importance_resample(np.full(3000, -np.inf), np.zeros(3000), x, 10, rng)
    with pytest.raises(InputError, match="importance"):
        importance_resample(np.zeros(10), np.zeros(3000), x, 10, rng)

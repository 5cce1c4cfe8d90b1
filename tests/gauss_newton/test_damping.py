"""How long a step of a descent is: what a failed one tells of the next."""

import math

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.damping import FIRST, after, metric_root, share_that_holds, stronger
from bayes_dea.gauss_newton.descent import bounded_step
from bayes_dea.gauss_newton.refit import refit


@pytest.mark.parametrize("lost", [0.01, 1.0, 30.0])
def test_the_share_brings_most_where_a_model_bends(lost):
    """Against the largest of promised (2 s - s^2) - (promised + lost) s^4, looked for on a grid."""
    s = np.linspace(0.0, 1.0, 100_001)
    brings = 2.0 * (2 * s - s**2) - (2.0 + lost) * s**4
    assert share_that_holds(2.0, lost) == pytest.approx(s[np.argmax(brings)], abs=1e-4)


def test_the_share_stays_within_bounds():
    assert share_that_holds(1e-3, 1e9) == 0.1
    assert share_that_holds(1.0, math.inf) == 0.2
    # a step that neither brings nor loses anything is shortened all the same: 1 - s = 2 s^3
    assert share_that_holds(1.0, 0.0) == pytest.approx(0.5898, abs=1e-4)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_damped_step_is_as_short_as_asked(share):
    """Curvatures over twelve decades; the step is the share, less at most what a factor of two in damping does."""
    rng = np.random.default_rng(3)
    J = rng.standard_normal((9, 9)) * np.logspace(-6, 6, 9)
    prior, decoupled, g = np.eye(9), np.eye(9) + np.triu(0.3 * rng.standard_normal((9, 9)), 1), rng.standard_normal(9)
    H = J.T @ J + prior
    root = metric_root(H, prior, decoupled)
    low, high = np.full(9, -np.inf), np.full(9, np.inf)

    def length(damping):
        return np.linalg.norm(root @ bounded_step(H, g, damping * root.T @ root, np.zeros(9), low, high))

    failed = bounded_step(H, g, FIRST * root.T @ root, np.zeros(9), low, high)
    damping = stronger(H, g, root, FIRST, failed, share)
    assert length(damping) <= share * length(FIRST) * (1 + 1e-9)
    assert length(0.5 * damping) > share * length(FIRST)


def test_the_metric_is_the_mean_of_two_curvatures():
    H, prior = np.diag([4.0, 1e6]), np.diag([1.0, 100.0])
    root = metric_root(H, prior, np.eye(2))
    assert np.allclose(root.T @ root, np.diag([2.0, 1e4]))


def test_damping_is_taken_back_only_where_a_step_held_unshortened():
    assert after(1.0, 0.9, shortened=False) < 1.0
    assert after(1.0, 0.9, shortened=True) == 1.0
    assert after(1.0, 0.5, shortened=False) == 1.0
    assert after(1.0, 0.1, shortened=False) > 1.0


def test_where_a_fit_ends_does_not_hang_on_rounding():
    """Strong friction, whose corners make sensitivities of one place mislead at the next, from far off.

    What a processor rounds stands for itself here as a billionth of the start.
    """
    friction = {"sigma_y_Pa": 6000.0, "eps_y": 3e-3, "elements": 12.0}
    campaign = concealed({"rate_independent_hysteresis": friction}, scale=0.3)
    problem, prior, q = problem_of(campaign, "hooke+gm3+rate_independent_hysteresis")
    ends = []
    for seed in range(3):
        apart = 1e-9 * np.random.default_rng(seed).standard_normal(q.size)
        ends.append(refit(problem, q + apart, prior.start(), prior).objective)
    assert max(ends) - min(ends) < 0.01


def test_a_bump_is_not_taken_for_an_end():
    """A resistance that the model has not: begun again from its end a fit gains next to nothing."""
    problem, prior, q = problem_of(concealed({"series_resistance": {"R_s_ohm": 3e5}}))
    fit = refit(problem, q, prior.start(), prior, fit_noise=False)
    again = refit(problem, fit.q, fit.noise, prior, fit_noise=False)
    assert again.objective > fit.objective - 0.03

"""Delays of less than a sample: any part of it is as likely as any other, and none of them is physics."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from bayes_dea.mismatch.search.phase import delay_of, phase_odds, share_below
from bayes_dea.priors import Prior

STEP, LEAST, MOST = 1e-3, 5e-6, 0.05


def late(delay, sd, prior=None):
    """A fit of a delay (s), as far as it matters here; sd: of its logarithm."""
    free = [SimpleNamespace(name="Y_Pa", prior=Prior("loguniform", 1e5, 1e7)),
            SimpleNamespace(name="T_d_s", prior=prior or Prior("loguniform", LEAST, MOST))]
    pieces = [SimpleNamespace(channel="displacement", prepared=SimpleNamespace(step_s=s)) for s in (0.1, STEP)]
    problem = SimpleNamespace(pieces=pieces, model=SimpleNamespace(priors=SimpleNamespace(free=free)))
    return SimpleNamespace(problem=problem, q=np.array([13.0, math.log(delay)]), covariance=np.diag([1e-4, sd**2]))


def by_hand(delay, sd):
    """Evidence by the prior that is even below a sample, against the one that is log-uniform, and the part below."""
    narrow = norm(math.log(delay), sd).pdf
    below = math.log(STEP / LEAST)  # of the log-uniform prior's mass, over log(MOST / LEAST)
    even = quad(lambda z: narrow(z) * below * math.exp(z) / STEP, math.log(delay) - 9 * sd, math.log(STEP))[0]
    above = quad(narrow, math.log(STEP), math.log(delay) + 9 * sd)[0] if delay * math.exp(9 * sd) > STEP else 0.0
    return even + above, even / (even + above)


@pytest.mark.parametrize("delay", [1e-5, 1e-4, 4e-4])
def test_a_hundredth_of_a_sample_is_less_likely_than_a_half(delay):
    odds, below = by_hand(delay, 0.03)
    assert phase_odds(late(delay, 0.03)) == pytest.approx(odds, rel=0.01)
    assert share_below(late(delay, 0.03)) == pytest.approx(below) == pytest.approx(1.0)


def test_at_one_sample_both_sides_count():
    odds, below = by_hand(STEP, 0.1)
    assert phase_odds(late(STEP, 0.1)) == pytest.approx(odds, rel=0.15)  # the density is taken at the middle
    assert share_below(late(STEP, 0.1)) == pytest.approx(below, abs=0.03)


def test_above_a_sample_nothing_changes():
    assert phase_odds(late(6e-3, 0.1)) == pytest.approx(1.0)
    assert share_below(late(6e-3, 0.1)) == pytest.approx(0.0)
    assert delay_of(late(6e-3, 0.1)) == pytest.approx(6e-3)


def test_a_prior_of_the_users_own_stays():
    own = Prior("lognormal", 1e-5, 0.5)
    assert phase_odds(late(1e-5, 0.1, own)) == 1.0
    assert share_below(late(1e-5, 0.1, own)) == pytest.approx(1.0)


def test_a_fit_without_a_delay_has_none():
    fit = late(1e-5, 0.1)
    fit.problem.model.priors.free.pop()
    assert delay_of(fit) is None
    assert (phase_odds(fit), share_below(fit)) == (1.0, 0.0)

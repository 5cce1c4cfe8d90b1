"""Moves that fit a density: each leaves it as it is, and what the short runs learn shortens the long one."""

import numpy as np
import pytest
from scipy.stats import ks_2samp

from bayes_dea.fit.adapt import AdaptSettings, adapt
from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.metric_move import MetricMove
from bayes_dea.fit.mixture import Mixture, joined
from bayes_dea.fit.subspace_move import SubspaceMove

#: two branches at a right angle, one of them thin
BRANCHES = Mixture(
    np.array([0.6, 0.4]),
    np.array([[0.0, 0.0], [3.0, 4.0]]),
    np.array([[[2.0, 0.0], [0.0, 0.1]], [[0.1, 0.0], [0.0, 1.5]]]),
)


def funnel(x):
    """log density: x0 ~ N(0, 1), x1 | x0 ~ N(0, e^(2 x0))."""
    return -0.5 * x[:, 0] ** 2 - x[:, 0] - 0.5 * (x[:, 1] * np.exp(-x[:, 0])) ** 2


def funnel_draws(n, rng):
    a = rng.standard_normal(n)
    return np.stack([a, np.exp(a) * rng.standard_normal(n)], axis=1)


def funnel_metric(x):
    out = np.zeros((len(x), 2, 2))
    out[:, 0, 0] = 1.0
    out[:, 1, 1] = np.exp(-2 * np.clip(x[:, 0], -30, 30))
    return out


def moved(log_prob, x, move, steps, rng, with_ratio=True):
    """Metropolis-Hastings steps of one move."""
    value = log_prob(x)
    accepted = 0.0
    for _ in range(steps):
        new, ratio = move(x, rng)
        other = log_prob(new)
        good = np.log(rng.random(len(x))) < other - value + (ratio if with_ratio else 0.0)
        x, value = np.where(good[:, None], new, x), np.where(good, other, value)
        accepted += good.mean() / steps
    return x, accepted


@pytest.mark.parametrize("with_ratio", [True, False])
def test_a_walk_of_the_mixture_leaves_its_target(with_ratio):
    """3,000 exact draws stay exact draws; without the ratio of proposal densities the same test fails (power)."""
    rng = np.random.RandomState(1)
    generator = np.random.default_rng(1)
    rough = Mixture(np.array([0.5, 0.5]), BRANCHES.means + 0.3, 1.4 * BRANCHES.roots)
    start, fresh = BRANCHES.draw(3000, generator), BRANCHES.draw(3000, generator)
    x, accepted = moved(
        BRANCHES.log_density, start, lambda x, r: rough.walk(x, r, 1.0), 60, rng, with_ratio
    )
    p = min(ks_2samp(x[:, i], fresh[:, i]).pvalue for i in range(2))
    assert accepted > 0.2
    assert (p > 0.01) == with_ratio


@pytest.mark.parametrize("with_ratio", [True, False])
def test_steps_of_a_metric_leave_their_target(with_ratio):
    rng = np.random.RandomState(2)
    generator = np.random.default_rng(2)
    start, fresh = funnel_draws(3000, generator), funnel_draws(3000, generator)
    x, accepted = moved(funnel, start, MetricMove(funnel_metric), 60, rng, with_ratio)
    p = min(ks_2samp(x[:, i], fresh[:, i]).pvalue for i in range(2))
    assert accepted > 0.3
    assert (p > 0.01) == with_ratio


@pytest.mark.parametrize("true", [True, False])
def test_steps_in_some_coordinates_leave_their_target(true):
    """3,000 exact draws in three dimensions stay exact draws; a target a fifth wider is seen (power)."""
    import emcee

    generator = np.random.default_rng(5)
    root = np.array([[1.0, 0.0, 0.0], [1.8, 0.5, 0.0], [-0.4, 0.3, 2.0]])
    start, fresh = (generator.standard_normal((3000, 3)) @ root.T for _ in range(2))
    width = 1.0 if true else 1.2

    def log_prob(x):
        return -0.5 * np.sum(np.linalg.solve(width * root, x.T) ** 2, axis=0)

    sampler = emcee.EnsembleSampler(3000, 3, log_prob, moves=SubspaceMove(), vectorize=True)
    state = emcee.State(start, random_state=np.random.RandomState(6).get_state())
    x = sampler.run_mcmc(state, 60, store=False).coords
    assert np.mean(np.any(x != start, axis=1)) == 1.0
    p = min(ks_2samp(x[:, i], fresh[:, i]).pvalue for i in range(3))
    assert (p > 0.01) == true


def test_a_step_changes_as_many_coordinates_as_it_says():
    s, c = np.zeros((400, 6)), [np.random.default_rng(7).standard_normal((200, 6))]
    new, ratio = SubspaceMove().get_proposal(s, c, np.random.RandomState(8))
    sizes, counts = np.unique(np.count_nonzero(new, axis=1), return_counts=True)
    assert list(sizes) == [1, 2, 4]
    assert counts[0] == pytest.approx(200, abs=50)
    assert not ratio.any()
    assert np.count_nonzero(SubspaceMove().get_proposal(s[:, :1], [c[0][:, :1]], np.random.RandomState(9))[0]) == 400


def test_a_metric_that_is_singular_or_not_finite_still_moves():
    def odd(x):
        out = np.zeros((len(x), 2, 2))
        out[:, 0, 0] = 1.0
        out[: len(x) // 2] = np.nan
        return out

    new, ratio = MetricMove(odd)(np.zeros((8, 2)), np.random.RandomState(0))
    assert np.all(np.isfinite(new))
    assert np.all(np.isfinite(ratio))


def test_joined_mixtures_are_normalised():
    both = joined([BRANCHES, BRANCHES], np.array([0.3, 0.7]))
    x = np.random.default_rng(0).normal(size=(50, 2))
    assert np.allclose(both.log_density(x), BRANCHES.log_density(x))


@pytest.mark.long
def test_what_is_learned_shortens_the_run_and_keeps_the_answer():
    """Two branches that differences of walkers hardly change between."""
    rng = np.random.default_rng(3)
    start = BRANCHES.means[0] + 0.1 * rng.standard_normal((2, 32, 2))
    start[:, 16:] += BRANCHES.means[1]
    quick = EnsembleSettings(max_steps=1500)
    with pytest.warns(match="did not converge"):
        plain = sample(BRANCHES.log_density, start, quick, np.random.default_rng(4))
    learned = adapt(BRANCHES.log_density, start, np.random.default_rng(5), AdaptSettings(steps=200))
    assert learned.proposal is not None
    helped = sample(
        BRANCHES.log_density, learned.walkers, quick, np.random.default_rng(4), proposal=learned.proposal
    )
    assert helped.converged
    assert not plain.converged
    assert helped.tau.max() < plain.tau.max() / 4
    share = np.mean(helped.flat()[:, 1] > 1.0)
    expected = np.mean(BRANCHES.draw(200_000, rng)[:, 1] > 1.0)
    assert share == pytest.approx(expected, abs=4 * 0.5 / np.sqrt(min(helped.ess_bulk.values())))

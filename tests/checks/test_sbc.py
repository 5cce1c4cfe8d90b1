"""Rank statistics and simultaneous ECDF bands."""

import numpy as np
import pytest
from scipy.stats import binom

from bayes_dea.checks.sbc import _probability_inside, ecdf_band, ecdf_inside, sbc_ranks
from bayes_dea.errors import InputError


def test_probability_of_a_path_is_the_enumerated_one():
    # two values, two points: every outcome counted by hand
    z = np.array([0.3, 0.6])
    # at least one at or below 0.3, both at or below 0.6
    expected = 0.6**2 - 0.3**2
    assert _probability_inside(2, z, np.array([1, 2]), np.array([2, 2])) == pytest.approx(expected)
    assert _probability_inside(7, z, np.array([0, 0]), np.array([7, 7])) == pytest.approx(1.0)
    one = _probability_inside(9, np.array([0.3]), np.array([2]), np.array([4]))
    assert one == pytest.approx(binom.cdf(4, 9, 0.3) - binom.cdf(1, 9, 0.3))


@pytest.mark.parametrize(("n_sims", "n_draws"), [(200, 99), (200, 400), (40, 19)])
def test_uniform_ranks_are_inside_as_often_as_stated(n_sims, n_draws):
    rng = np.random.default_rng(1)
    band = ecdf_band(n_sims, n_draws)
    assert 0.95 <= band.achieved < 0.97
    repeats = 600
    inside = sum(ecdf_inside(rng.integers(0, n_draws + 1, n_sims), n_draws)[0] for _ in range(repeats))
    low, high = binom.ppf([0.001, 0.999], repeats, band.achieved)
    assert low <= inside <= high


def test_other_probability():
    rng = np.random.default_rng(2)
    inside = sum(ecdf_inside(rng.integers(0, 100, 200), 99, 0.5)[0] for _ in range(400))
    low, high = binom.ppf([0.001, 0.999], 400, ecdf_band(200, 99, 0.5).achieved)
    assert low <= inside <= high


@pytest.mark.parametrize(("bias", "scale"), [(0.5, 1.0), (-0.5, 1.0), (0.0, 1.6), (0.0, 0.6)])
def test_wrong_posteriors_are_caught(bias, scale):
    rng = np.random.default_rng(3)
    truth = rng.normal(size=300)
    centre = truth + rng.normal(size=300)  # exact posterior: N(centre/2, 1/2)
    draws = centre[:, None] / 2 + np.sqrt(0.5) * (bias + scale * rng.normal(size=(300, 99)))
    inside, worst = ecdf_inside(sbc_ranks(draws, truth, rng), 99)
    assert not inside
    assert worst > 1


def test_the_right_posterior_passes():
    rng = np.random.default_rng(4)
    truth = rng.normal(size=(300, 2))
    centre = truth + rng.normal(size=(300, 2))
    draws = centre[:, None] / 2 + np.sqrt(0.5) * rng.normal(size=(300, 990, 2))
    ranks = sbc_ranks(draws, truth, rng, keep=99)
    assert ranks.shape == (300, 2)
    for column in ranks.T:
        inside, worst = ecdf_inside(column, 99, 0.999)
        assert inside
        assert worst <= 1


def test_ranks_are_counts_and_ties_are_broken_at_random():
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(sbc_ranks([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]], [0.0, 2.5], rng), [0, 2])
    ranks = sbc_ranks(np.zeros((4000, 9)), np.zeros(4000), rng)
    assert ecdf_inside(ranks, 9, 0.999)[0]
    assert ranks.min() == 0
    assert ranks.max() == 9


def test_band_holds_the_diagonal():
    band = ecdf_band(200, 99)
    assert np.all(band.lower <= band.z)
    assert np.all(band.z <= band.upper)
    assert band.gamma < 0.05
    with pytest.raises(ValueError, match="read-only"):
        band.lower[0] = 1.0


def test_bad_input():
    rng = np.random.default_rng(6)
    with pytest.raises(InputError, match="do not match"):
        sbc_ranks(np.zeros((3, 5)), np.zeros(4), rng)
    with pytest.raises(InputError, match="not finite"):
        sbc_ranks(np.full((3, 5), np.nan), np.zeros(3), rng)
    with pytest.raises(InputError, match="kept"):
        sbc_ranks(np.zeros((3, 5)), np.zeros(3), rng, keep=6)
    with pytest.raises(InputError, match=r"0\.\.9"):
        ecdf_inside([3, 10], 9)
    with pytest.raises(InputError, match="probability"):
        ecdf_band(10, 10, 1.5)

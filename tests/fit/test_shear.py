"""Valleys made straight: undone exactly, of unit volume, and bent by nothing that chance has put into the draws."""

import warnings

import numpy as np
import pytest

from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.pilot import PilotSettings, run_pilot, straightened
from bayes_dea.fit.shear import fit_shear, parted, shared

#: log rate of the slow mode, log compliance and log time of the next one, and a coordinate beside them
PAIR = ((0, 1, 3),)


def two_slow_modes(z):
    """log density of (log c1/T1, log c2, log T1, log T2): as short recordings see two modes, by the sum of their rates
    and hardly by how it is shared out, beside priors of a factor of e and more. Modes are in order."""
    slow, compliance, first, second = z.T
    total = np.logaddexp(slow, compliance - second)
    value = -0.5 * (total / 0.02) ** 2 - 0.5 * ((second - 3.0) / 0.3) ** 2 - 0.5 * ((first - 5.5) / 1.2) ** 2
    value = value - 0.5 * ((slow + 2.0) / 1.5) ** 2 - 0.5 * ((compliance - 3.0) / 1.5) ** 2
    return np.where(second < first, value, -np.inf)


def starts(rng, n=2000):
    ratio = rng.normal(-2.0, 0.3, n)
    second = rng.normal(3.0, 0.1, n)
    x = np.stack([ratio, 0.02 * rng.standard_normal(n), rng.normal(5.5, 0.3, n), second], axis=1)
    return parted(x, PAIR)


def weighed_draws(rng, n=400_000):
    """Draws (n, 4) of two_slow_modes with weights (n,): sum of the rates and times are normal, the rest is weighed."""
    x = np.stack([rng.uniform(-15.0, 15.0, n), 0.02 * rng.standard_normal(n), rng.normal(5.5, 1.2, n),
                  rng.normal(3.0, 0.3, n)], axis=1)
    z = parted(x, PAIR)
    drawn = -0.5 * (x[:, 1] / 0.02) ** 2 - 0.5 * ((x[:, 2] - 5.5) / 1.2) ** 2 - 0.5 * ((x[:, 3] - 3.0) / 0.3) ** 2
    return z, np.exp(two_slow_modes(z) - drawn)


def test_rates_that_are_shared_out_are_undone_with_a_jacobian_of_one():
    z = np.random.default_rng(1).normal(0.0, 3.0, (200, 5))
    x = shared(z, PAIR)
    np.testing.assert_allclose(parted(x, PAIR), z, atol=1e-12)
    np.testing.assert_allclose(np.exp(x[:, 1]), np.exp(z[:, 0]) + np.exp(z[:, 1] - z[:, 3]))
    np.testing.assert_array_equal(x[:, [2, 3, 4]], z[:, [2, 3, 4]])
    step = 1e-6
    for row in z[:20]:
        moved = row + step * np.concatenate([np.eye(5), -np.eye(5)])
        J = (shared(moved[:5], PAIR) - shared(moved[5:], PAIR)) / (2 * step)
        assert abs(np.linalg.det(J)) == pytest.approx(1.0, rel=1e-6)


def test_a_shear_with_shared_rates_is_undone():
    z = starts(np.random.default_rng(2))
    shear = fit_shear(z, np.array([1.0, 1.0, -1.0, -1.0]), PAIR)
    np.testing.assert_allclose(shear.inverse(shear.forward(z)), z, atol=1e-9)
    far = 20 * np.random.default_rng(3).standard_normal((50, 4))
    np.testing.assert_allclose(shear.inverse(shear.forward(far)), far, atol=1e-6)


@pytest.mark.parametrize("follow", [1, 20])
def test_draws_without_a_bend_are_left_as_they_are(follow):
    """Fourteen coordinates that know nothing of each other; follow: draws in turn that are nearly the same.

    So they are in a run. A polynomial with a hundred terms explains a third of 250 such draws by chance.
    """
    rng = np.random.default_rng(4)
    z = np.repeat(rng.standard_normal((5000 // follow, 14)), follow, axis=0)
    z += 0.05 * rng.standard_normal(z.shape)
    shear = fit_shear(z, np.ones(14))
    assert np.count_nonzero(shear.coefficients) == 0
    np.testing.assert_allclose(shear.forward(z), z)


def test_a_bend_is_found_however_many_coordinates_stand_beside_it():
    rng = np.random.default_rng(5)
    z = rng.standard_normal((4000, 10))
    z[:, 7] = 0.1 * z[:, 7] + 0.3 * z[:, 0] ** 2
    z[:, 0] *= 3.0
    y = fit_shear(z, np.zeros(10)).forward(z)
    assert np.std(y[:, 7]) == pytest.approx(0.1, rel=0.1)


@pytest.mark.long
def test_two_slow_modes_of_short_recordings_are_sampled_quickly():
    """In coordinates of their rates' sum and ratio in a fraction of the steps, and what is sampled is the density."""
    draws = starts(np.random.default_rng(6))
    settings = EnsembleSettings(max_steps=2000, check_every=500)
    found = {}
    for name, pairs in (("apart", ()), ("shared", PAIR)):
        rng = np.random.default_rng(7)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pilot = run_pilot(two_slow_modes, draws, np.array([1.0, 1.0, -1.0, -1.0]), rng, PilotSettings(), 2, pairs)
            run = sample(lambda y, shear=pilot.shear: straightened(two_slow_modes, shear, 1.0, y),
                         pilot.start(two_slow_modes), settings, rng, proposal=pilot.proposal, straight=True)
        found[name] = float(np.max(run.tau)), pilot.shear.inverse(run.flat())
    assert found["shared"][0] < 40
    assert found["shared"][0] < 0.5 * found["apart"][0]
    exact, weights = weighed_draws(np.random.default_rng(8))
    for i in range(4):
        order = np.argsort(exact[:, i])
        share = np.cumsum(weights[order])
        wanted = exact[order, i][np.searchsorted(share, np.array([0.05, 0.5, 0.95]) * share[-1])]
        np.testing.assert_allclose(np.quantile(found["shared"][1][:, i], [0.05, 0.5, 0.95]), wanted, atol=0.1)

"""The mixture that proposals are made of."""

import numpy as np
import pytest

from bayes_dea.errors import InputError
from bayes_dea.fit.mixture import fit_mixture


def test_branches_far_narrower_than_their_distance_are_not_blurred():
    """Two branches 400 of their widths apart: as a proposal the mixture has to hit them, not what lies between."""
    rng = np.random.default_rng(3)
    d, width = 6, 0.01
    centres = np.zeros((2, d))
    centres[1, :3] = 4.0
    x = centres[rng.integers(2, size=6000)] + width * rng.standard_normal((6000, d))
    mixture = fit_mixture(x, rng, floor=1e-6)
    new = mixture.draw(4000, rng)

    def log_density(y):
        parts = -0.5 * np.sum((y[:, None] - centres) ** 2, axis=2) / width**2
        return np.logaddexp(*parts.T)

    weight = log_density(new) - mixture.log_density(new)
    weight = np.exp(weight - weight.max())
    assert weight.sum() ** 2 / np.sum(weight**2) > 0.9 * len(new)


@pytest.mark.parametrize("different", [1, 2, 3])
def test_a_few_draws_many_times_over_are_said_to_lie_in_a_subspace(different):
    """As a pool of draws leaves them that one outweighs: no mixture can be fitted, and that is said."""
    rng = np.random.default_rng(4)
    points = 8.0 + rng.standard_normal((different, 4))
    with pytest.raises(InputError, match="subspace"):
        fit_mixture(points[rng.integers(different, size=600)], rng)


def test_fewer_different_draws_than_components_are_no_obstacle():
    """Components beyond the different draws have nowhere to begin."""
    rng = np.random.default_rng(5)
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    x = points[rng.integers(3, size=600)]
    mixture = fit_mixture(x, rng, (1, 2, 4, 8))
    assert len(mixture.weights) <= 3
    assert np.isfinite(mixture.log_density(x)).all()

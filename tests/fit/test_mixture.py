"""The mixture that proposals are made of."""

import numpy as np

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

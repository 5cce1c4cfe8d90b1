"""What a discrepancy adds, by one straight step where the model hardly moves for it; and a posterior that is normal."""

import numpy as np
import pytest

from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.mismatch.search import ridge
from bayes_dea.mismatch.search.frame import own_index
from bayes_dea.mismatch.search.ridge import posterior
from bayes_dea.mismatch.where import discrepancy as discrepancies
from bayes_dea.mismatch.where.discrepancy import basis, discrepancy


@pytest.fixture
def named(diagnosed):
    return diagnosed("series_resistance", {"R_s_ohm": 1.2e5})


def test_a_straight_step_says_what_a_fit_with_the_discrepancy_does(named, monkeypatch):
    fit, prior = named.corrected, noise_prior(named.assembled)
    columns = basis(fit)
    refits = []
    refit = discrepancies.refit

    def counted(*args, **keys):
        refits.append(refit(*args, **keys))
        return refits[-1]

    monkeypatch.setattr(discrepancies, "refit", counted)
    straight = discrepancy(fit, columns, prior)
    few = len(refits)
    monkeypatch.setattr(discrepancies, "_STRAIGHT", -1.0)
    fitted = discrepancy(fit, columns, prior)
    assert few < len(refits) - few
    assert straight.gain == pytest.approx(fitted.gain, abs=0.3)
    assert straight.amplitude_m == fitted.amplitude_m


def test_a_normal_posterior_is_drawn_as_such(named, monkeypatch):
    """Its quantiles are those of many weighted draws; one that is not normal is not taken for it."""
    fit = named.corrected
    own = own_index(named.base, fit.problem.model)
    assert own.size == 1
    theta, w = posterior(fit, own, np.random.default_rng(1))
    assert len(theta) == ridge._DRAWN
    monkeypatch.setattr(ridge, "_NORMAL", 2.0)
    monkeypatch.setattr(ridge, "_ENOUGH", 1e9)
    many, weights = posterior(fit, own, np.random.default_rng(2))
    sd = np.sqrt(fit.covariance[own[0], own[0]])
    for share in (0.05, 0.5, 0.95):
        a, b = (x[np.argsort(x)][np.searchsorted(np.cumsum(v[np.argsort(x)]), share)]
                for x, v in ((theta[:, 0], w), (many[:, 0], weights)))
        assert abs(a - b) < 0.2 * sd


def test_what_is_not_normal_is_told_by_its_draws():
    rng = np.random.default_rng(3)
    centre, root = np.zeros(2), np.eye(2)
    proposal = ridge._Student(centre, 1.3 * root)
    theta = proposal.at(*ridge._even_points(rng, 64, 2))
    pool = ridge._Pool(np.empty((0, 2)), np.empty(0))
    z = np.sum(theta * theta, axis=1)
    assert ridge._as_normal(pool.with_draws(theta, -0.5 * z, proposal), centre, root) == pytest.approx(1.0)
    skew = -0.5 * z + 0.25 * theta[:, 0] ** 3 * (np.abs(theta[:, 0]) < 3)
    wide = -0.5 * np.sum((theta / [2.0, 1.0]) ** 2, axis=1)
    for other in (skew, wide):
        assert ridge._as_normal(pool.with_draws(theta, other, proposal), centre, root) < ridge._NORMAL

"""The noise of a model that is wrong by much ends where its bounds are, and the fit is the best under that noise."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.known import SLIGHT


@pytest.fixture(scope="module")
def wrong():
    """Hooke's law and three modes, where readings are 20 ms late."""
    problem, prior, q = problem_of(concealed({"acquisition_delay": {"T_d_s": 0.02}}, validate=False))
    return refit(problem, q, prior.start(), prior), prior


def test_it_ends_in_a_corner_of_its_bounds(wrong):
    fit, prior = wrong
    at = prior.coordinates(fit.noise, "displacement")
    assert np.abs(at) == pytest.approx(8.0, abs=1e-6)
    assert at[0] > 0.0  # louder


@pytest.mark.long
def test_descents_from_elsewhere_end_with_it(wrong):
    """Of 97,000 nats, but for less than what is no lead; one step after the noise had grown left 25 of them."""
    fit, prior = wrong
    sd = np.sqrt(np.diag(fit.covariance))
    rng = np.random.default_rng(3)
    begun = [fit.q + 3.0 * sd * rng.standard_normal(sd.size) for _ in range(8)]
    # a start may be so soft that the layers give way: it has no answer
    ends = [end for q in begun if (end := refit(fit.problem, q, prior.start(), prior)) is not None]
    assert len(ends) >= 6
    assert max(end.objective for end in ends) < fit.objective + SLIGHT
    assert min(end.objective for end in ends) > fit.objective - SLIGHT

"""What a fit promises by being moved along itself, before anything is added to it."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.descent import value_at
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.frame import Frame


def test_a_maximum_promises_nothing_and_what_was_moved_off_it_what_it_lost():
    problem, prior, q = problem_of(concealed(validate=False))
    fit = refit(problem, q, prior.start(), prior, fit_noise=False)
    assert 0.0 <= Frame(fit).unsettled < 0.01
    softer = fit.q.copy()
    softer[0] += 5e-4  # of the stiffness: a straight line for the predictions
    off = refit(problem, softer, prior.start(), prior, max_steps=0, fit_noise=False)
    lost = value_at(problem, off.q, off.noise) - value_at(problem, fit.q, fit.noise)
    assert lost > 1.0  # the premise
    assert Frame(off).unsettled == pytest.approx(lost, rel=0.05)
    assert np.array_equal(off.q, softer)

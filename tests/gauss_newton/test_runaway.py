"""A step that leads to where no number holds the answer: no value, and no word of it on the terminal."""

import warnings

import numpy as np
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.descent import value_at


def test_a_gain_beyond_all_bounds_has_no_value_and_says_nothing():
    problem, prior, q = problem_of(concealed())
    far = q.copy()
    far[-1] = 1e4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert value_at(problem, far, prior.start()) == np.inf
        assert np.isfinite(value_at(problem, q, prior.start()))

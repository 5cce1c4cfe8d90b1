"""A base that sits in the wrong place of its own model, before anything is weighed beside it."""

from dataclasses import replace

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.search.frame import Frame
from bayes_dea.mismatch.search.promising import settled


@pytest.fixture(scope="module")
def places():
    """The maximum of a model, and a place where two of its modes have met, from which no descent leads on."""
    problem, prior, q = problem_of(concealed())
    top = refit(problem, q, prior.start(), prior)
    met = top.q.copy()
    met[problem.model.coordinate_names.index("log T_3")] -= 6.0
    stuck = refit(problem, met, prior.start(), prior)
    assert stuck.objective > top.objective + 3.0
    return stuck, top, prior


def _frame(fit, prior, kind=""):
    return Frame(replace(fit, noise=prior.start()), kind=kind)


def test_it_goes_to_where_a_frame_promises_more(places):
    stuck, top, prior = places
    found = settled(stuck, [_frame(stuck, prior), _frame(top, prior, "slow")], prior)
    assert found.objective == pytest.approx(top.objective, abs=0.1)
    assert found.problem is stuck.problem


def test_it_stays_where_no_other_frame_promises_more(places):
    stuck, top, prior = places
    assert settled(top, [_frame(top, prior), _frame(stuck, prior, "slow")], prior) is top
    assert settled(stuck, [_frame(stuck, prior)], prior) is stuck

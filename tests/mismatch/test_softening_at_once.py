"""A softening that comes at once (b next to zero) is found: a ridge parts it from one that comes with the energy."""

import sys
from pathlib import Path

import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.bench.concealed import draw_case
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.grid import finding_points
from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
from bayes_dea.mismatch.search.weigh import own_index

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "runs" / "concealed"))

from study import campaign_of


def test_it_is_looked_for_at_both_ends_of_the_prior():
    campaign = concealed(scale=0.3)
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    model = extended(base.problem.model, ("mullins_softening",), effect_priors(("mullins_softening",), campaign))
    points = finding_points(model, own_index(base, model), base.values(), sparse=False)
    assert {round(float(p[2]), 6) for p in points} == {0.02, 0.5, 1.5}
    # of each slight share with each energy
    at_once = [tuple(p[:2]) for p in points if p[2] == pytest.approx(0.02)]
    assert len(at_once) == len(set(at_once)) == 3 * len({tuple(p[1:2]) for p in points})


@pytest.mark.long
def test_beside_readings_that_lead_the_command():
    """Alone the delay takes 72,000 nats, and the softening the next 1,700."""
    case = draw_case(1568000)
    s = diagnose(campaign_of(case), case.model, seed=1).summary
    assert s["verdict"] == case.truth == "mullins_softening"

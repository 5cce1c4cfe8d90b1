"""Flat priors between limits on parameters of the network, in whose place the modes are coordinates."""

import math

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.descent import bounds
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.models.model import build_model
from bayes_dea.priors import Prior


@pytest.fixture(scope="module")
def campaign():
    return concealed()


@pytest.fixture(scope="module")
def usual(campaign):
    problem, prior, q = problem_of(campaign)
    return refit(problem, q, prior.start(), prior).values()


@pytest.mark.parametrize(("name", "low", "high"), [("Y_Pa", 1e5, 1e7), ("k_3_Pa", 1e3, 1e6), ("tau_2_s", 1.0, 100.0)])
def test_limits_of_a_modulus_are_no_limits_of_a_compliance(campaign, usual, name, low, high):
    model = build_model("hooke+gm3", {name: Prior("loguniform", low, high)})
    problem, prior, q = problem_of(campaign, model)
    assert not np.isfinite(bounds(problem)[0]).any()
    values = refit(problem, q, prior.start(), prior).values()
    assert low < values[name] < high
    # the recordings say more than either prior
    assert values[name] == pytest.approx(usual[name], rel=0.1)
    assert math.log(values["Y_Pa"] / usual["Y_Pa"]) == pytest.approx(0.0, abs=0.02)


def test_a_prior_is_kept_all_the_same(campaign, usual):
    high = 0.98 * usual["Y_Pa"]
    problem, prior, q = problem_of(campaign, build_model("hooke+gm3", {"Y_Pa": Prior("loguniform", 1e5, high)}))
    assert refit(problem, q, prior.start(), prior).values()["Y_Pa"] <= high

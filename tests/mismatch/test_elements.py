"""Friction whose elements are not those of the model: counted, not called unknown."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.assemble import assemble
from bayes_dea.errors import InputError
from bayes_dea.gauss_newton.laws import COUNTS, laws_in, log_share
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.mismatch.diagnosis import diagnose
from bayes_dea.mismatch.search.elements import _nearer, counted
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.quest import Quest
from bayes_dea.mismatch.search.rivals import from_the_leader
from bayes_dea.mismatch.search.weigh import Weighed
from bayes_dea.mismatch.where.locate import ADEQUATE, scan
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import FRICTION_ELEMENTS, plant_of
from bayes_dea.priors import parse_override

FRICTION = "rate_independent_hysteresis"
STRONG = {"sigma_y_Pa": 6000.0, "eps_y": 3e-3}


@pytest.fixture(scope="module")
def twelve():
    """A diagnosis of strong friction in twelve elements."""
    return diagnose(concealed({FRICTION: {**STRONG, "elements": 12.0}}, scale=0.3), "hooke+gm3", seed=1)


def with_count(fit, count):
    """The problem of a fit with another count of elements."""
    laws = {p.name: p for p in fit.problem.model.parameters}
    name, prior = parse_override(f"friction_elements={count}")
    return fit.problem.with_model(build_model(fit.problem.model.name, {**laws, name: prior}))


@pytest.mark.long
def test_twelve_elements_are_counted(twelve):
    assert twelve.verdict == FRICTION
    assert twelve.summary["adequate"]
    found = twelve.summary["hypotheses"][0]["parameters"]
    for name, true in STRONG.items():
        assert found[name]["mean"] == pytest.approx(true, abs=4 * found[name]["sd"]), name
    # as the page prints it for calibrate
    ((name, text),) = twelve.summary["corrected_priors"].items()
    assert parse_override(f"{name}={text}")[1].a == 12.0
    assert build_model(twelve.summary["corrected_model"], dict([parse_override(f"{name}={text}")])).priors.fixed == {
        "friction_elements": 12.0
    }


@pytest.mark.long
def test_by_the_usual_count_these_recordings_are_not_explained(twelve):
    fit, prior = twelve.naming.best.weighed.fit, noise_prior(twelve.assembled)
    usual = refit(with_count(fit, 64), fit.q, prior.start(), prior)
    assert scan(usual, np.random.default_rng(1)).p_value < ADEQUATE < scan(fit, np.random.default_rng(1)).p_value
    assert fit.log_evidence > usual.log_evidence + 20.0
    # and from there twelve are found
    again = counted(replace(twelve.naming.best.weighed, fit=usual), twelve.base, prior)
    assert again.fit.problem.model.priors.fixed["friction_elements"] == 12.0
    assert again.log_evidence == pytest.approx(fit.log_evidence, abs=0.5)


@pytest.mark.long
def test_a_count_that_is_not_the_usual_one_pays_for_all_that_are_tried(twelve):
    fit = twelve.naming.best.weighed.fit
    assert laws_in(fit.problem.model, (FRICTION,)).keys() == {"friction_elements"}
    assert log_share(fit.problem.model) == pytest.approx(-np.log(len(COUNTS)))
    usual = with_count(fit, 64)
    assert log_share(usual.model) == 0.0
    difference = fit.problem.log_prior(fit.q)[0] - usual.log_prior(fit.q)[0]
    assert difference == pytest.approx(-np.log(len(COUNTS)))


@pytest.mark.long
def test_recordings_that_show_no_corners_keep_the_usual_count():
    usual = build_model(f"hooke+{FRICTION}").priors.fixed["friction_elements"]
    assert usual == FRICTION_ELEMENTS  # of a plant that is told nothing else
    weak = {"sigma_y_Pa": 300.0, "eps_y": 3e-3, "elements": 48.0}
    result = diagnose(concealed({FRICTION: weak}), "hooke+gm3", seed=1)
    assert result.verdict == FRICTION
    assert result.summary["corrected_priors"] == {}


@pytest.mark.parametrize("given", ["12.5", "uniform(2, 100)"])
def test_elements_are_whole_numbers(given):
    from bayes_dea.campaign.schema import Actuator

    model = build_model(f"hooke+{FRICTION}", dict([parse_override(f"friction_elements={given}")]))
    values = {"Y_Pa": 1e6, **STRONG} | ({} if model.priors.fixed else {"friction_elements": 40.3})
    actuator = Actuator("one", 399, 25e-6, 2.8, 7.56e-5, 1.145e-4, 10.3e-3, 1e-3, 1200.0, 100.0)
    with pytest.raises(InputError, match="elements are counted: give one whole number"):
        plant_of(model, values, actuator)


def test_a_count_that_does_the_work_of_another_effect_is_not_taken():
    """Stiffening beside friction: other elements take a little of what it leaves."""
    stiff = {FRICTION: {**STRONG, "elements": 48.0}, "strain_stiffening": {"beta": 120.0}}
    assembled = assemble(concealed(stiff, scale=0.3), build_model("hooke+gm3"), 1)
    prior = noise_prior(assembled)
    pieces = [p for p in reduce_campaign(assembled) if p.identify]
    problem = Problem.of(assembled, build_model(f"hooke+gm3+{FRICTION}"), pieces)
    start = np.zeros(problem.dimension)
    own = problem.model.priors.transform(np.full((1, problem.model.dimension), 0.5))
    start[: problem.model.dimension] = problem.model.from_prior_coordinates(own)[0]
    fit = refit(problem, start, prior.start(), prior)
    found = Weighed((FRICTION,), fit, fit.log_evidence, 0.1, 1e-5)
    other = _nearer(fit, "friction_elements", prior)
    assert other.objective < fit.objective - 20.0
    assert counted(found, fit, prior) is found


@pytest.mark.long
def test_elements_that_are_counted_for_one_explanation_are_counted_for_its_rivals():
    """Else what does as well looks worse by the nats that a wrong count costs."""
    campaign = concealed({FRICTION: {**STRONG, "elements": 12.0}, "stretch_dependent_permittivity": {"c_eps": -2.0}},
                         scale=0.3, validate=False)  # fmt: skip
    problem, prior, q = problem_of(campaign)
    base = refit(problem, q, prior.start(), prior)
    begun = {**dict(zip(base.problem.model.priors.names, base.q, strict=False)),
             "sigma_y_Pa": np.log(6000.0), "eps_y": np.log(3e-3), "c_eps": -2.0, "q_2_per_m": -200.0}

    def explained(second, count):
        model = extended(base.problem.model, second, {})
        problem = with_count(replace(base, problem=base.problem.with_model(model)), count)
        start = [begun[n] for n in problem.model.priors.names]
        fit = refit(problem, np.concatenate([start, base.q[base.problem.model.dimension :]]), prior.start(), prior)
        return Weighed(second, fit, fit.log_evidence, 0.1, 1e-6)

    leader = explained(("stretch_dependent_permittivity", FRICTION), 12)
    rival = explained((FRICTION, "sensor_nonlinearity"), 64)
    (found,) = from_the_leader(leader, [rival], Quest(base, (), {}, prior, np.random.default_rng(1)))
    assert found.effects == rival.effects
    assert found.fit.problem.model.priors.fixed["friction_elements"] == 12.0
    assert found.log_evidence > rival.log_evidence + 20.0
    assert found.size_m == rival.size_m

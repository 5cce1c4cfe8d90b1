"""A mass beside another effect is looked for on the network alone, where it costs little."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.mismatch.diagnosis import DiagnosisSettings
from bayes_dea.mismatch.first_fit import first_fit
from bayes_dea.mismatch.frame import Frame, insert
from bayes_dea.mismatch.grid import screen
from bayes_dea.mismatch.hypotheses import extended
from bayes_dea.mismatch.noise_prior import noise_prior
from bayes_dea.mismatch.problem import Problem
from bayes_dea.mismatch.reduced import reduce_campaign
from bayes_dea.mismatch.superposed import Superposed
from bayes_dea.models.model import build_model

HYSTERESIS = {"sigma_y_Pa": 2000.0, "eps_y": 2.25e-3}
MASS = {"f_1_Hz": 140.0, "zeta": 0.06}


@pytest.fixture(scope="module")
def frame():
    model = build_model("hooke+gm3+rate_independent_hysteresis")
    assembled = assemble(concealed({"rate_independent_hysteresis": HYSTERESIS, "inertia": MASS}), model)
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, model, [p for p in reduce_campaign(assembled) if p.identify])
    fit = first_fit(assembled, problem, prior, np.random.default_rng(1), DiagnosisSettings().map)
    return Frame(fit)


@pytest.fixture(scope="module")
def with_mass(frame):
    return extended(frame.fit.problem.model, ["inertia"], {})


def test_a_mass_is_found_beside_hysteresis_with_few_simulations_of_both(frame, with_mass, monkeypatch):
    dear = []
    tried = Frame.tried
    monkeypatch.setattr(Frame, "tried", lambda self, *a: dear.append(1) or tried(self, *a))
    found = screen([frame], with_mass, with_mass.spec.effects, sparse=True)
    assert len(dear) < 15  # ninety before
    best = found.points[0]
    assert np.exp(best.own[0]) == pytest.approx(MASS["f_1_Hz"], rel=0.1)
    assert found.gain > 1000.0
    # what is kept was simulated with both effects, not put together
    problem = frame.fit.problem.with_model(with_mass)
    q = insert(frame.fit, with_mass, best.own)
    assert best.likelihood == pytest.approx(frame.tried(problem, q, ["inertia"])[0])


def test_what_is_superposed_is_about_what_both_do_together(frame, with_mass):
    """Along the frequency: the same best one, and much of what both together gain there."""
    beside = Superposed(frame, with_mass, ["inertia"])
    problem = frame.fit.problem.with_model(with_mass)
    points = [np.log([f, MASS["zeta"]]) for f in np.geomspace(100.0, 200.0, 13)]
    about = np.array([beside.value(p) for p in points])
    exact = []
    for p in points:
        q = insert(frame.fit, with_mass, p)
        exact.append(frame.tried(problem, q, ["inertia"])[0] - with_mass.log_prior(q[None, : with_mass.dimension])[0])
    exact = np.array(exact)
    assert abs(int(np.argmin(about)) - int(np.argmin(exact))) <= 1
    here = frame.value(frame.fit.clean)[0]
    assert (here - about.min()) / (here - exact.min()) == pytest.approx(1.0, abs=0.3)

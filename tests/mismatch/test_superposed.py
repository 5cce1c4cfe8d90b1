"""A mass beside another effect or on a curved law is looked for on the linear network alone, where it costs little."""

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.assemble import assemble
from bayes_dea.gauss_newton.noise_prior import noise_prior
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.reduced import reduce_campaign
from bayes_dea.mismatch.diagnosis import DiagnosisSettings, diagnose
from bayes_dea.mismatch.search.first_fit import first_fit
from bayes_dea.mismatch.search.frame import Frame, insert
from bayes_dea.mismatch.search.grid import screen
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.superposed import Superposed
from bayes_dea.models.model import build_model
from bayes_dea.models.plant import plant_of, straightened
from bayes_dea.models.static import LAWS, stress

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


@pytest.fixture(scope="module")
def curved():
    """The base with a curved law on a stack that stiffens and rings."""
    model = build_model("yeoh+gm3")
    campaign = concealed({"strain_stiffening": {"beta": 60.0}, "inertia": {"f_1_Hz": 140.0, "zeta": 0.03}})
    assembled = assemble(campaign, model)
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, model, [p for p in reduce_campaign(assembled) if p.identify])
    return Frame(first_fit(assembled, problem, prior, np.random.default_rng(1), DiagnosisSettings().map))


@pytest.mark.long
def test_on_a_curved_law_a_mass_is_looked_for_on_a_straight_one(curved, monkeypatch):
    dear = []
    tried = Frame.tried
    monkeypatch.setattr(Frame, "tried", lambda self, *a: dear.append(1) or tried(self, *a))
    model = extended(curved.fit.problem.model, ["inertia"], {})
    found = screen([curved], model, model.spec.effects, sparse=True)
    assert len(dear) < 15  # ninety before
    assert np.exp(found.points[0].own[0]) == pytest.approx(140.0, rel=0.03)
    assert found.gain > 1000.0


def test_the_straight_law_keeps_the_mass_and_its_damper():
    model = build_model("yeoh+gm1+inertia")
    values = {"C1_Pa": 2e5, "C2_Pa": 3e5, "C3_Pa": 0.0, "k_1_Pa": 5e4, "tau_1_s": 3.0, "f_1_Hz": 140.0, "zeta": 0.05}
    plant = plant_of(model, values, concealed().actuator)
    straight = straightened(plant, 0.1)
    law = LAWS["yeoh"]
    assert float(stress(LAWS["hooke"], straight.law, 0.01)) == pytest.approx(
        100.0 * 0.01 * float(stress(law, plant.law, 0.105) - stress(law, plant.law, 0.095)), rel=1e-3
    )
    mass = [p.Y_Pa / (2.0 * np.pi * p.f_1_Hz) ** 2 for p in (plant, straight)]
    assert mass[1] == pytest.approx(mass[0])
    damper = [2.0 * p.zeta * np.sqrt(p.Y_Pa * m) for p, m in zip((plant, straight), mass, strict=True)]
    assert damper[1] == pytest.approx(damper[0])
    assert straight.branches == plant.branches
    assert straight.swings
    assert straightened(straight, 0.2) is straight


def test_a_law_in_series_is_straightened_with_what_is_behind_it():
    """About a strain that it has after a long time, a spring and the elements behind it have that of the spring."""
    model = build_model("yeoh+gkv2+inertia+extra_relaxation_mode")
    values = {"C1_Pa": 1e5, "C2_Pa": 3e5, "C3_Pa": 0.0, "k_1_Pa": 2e6, "tau_1_s": 3.0, "k_2_Pa": 3e6, "tau_2_s": 0.1,
              "f_1_Hz": 140.0, "zeta": 0.05, "k_x_Pa": 5e4, "tau_x_s": 0.4}
    plant = plant_of(model, values, concealed().actuator)
    straight = straightened(plant, 0.1)
    law = LAWS["yeoh"]
    spring = 0.1 * plant.Y_Pa / 6e5
    modulus = 1e3 * float(stress(law, plant.law[:6], spring + 5e-4) - stress(law, plant.law[:6], spring - 5e-4))
    assert straight.Y_Pa == pytest.approx(1.0 / (1.0 / modulus + 1.0 / 2e6 + 1.0 / 3e6), rel=1e-5)
    # at once all branches are springs: those of the network, and the one beside it
    assert straight.Y_Pa + sum(k for k, _ in straight.branches) == pytest.approx(modulus + 5e4, rel=1e-5)
    mass = [p.Y_Pa / (2.0 * np.pi * p.f_1_Hz) ** 2 for p in (plant, straight)]
    assert mass[1] == pytest.approx(mass[0])
    assert straight.swings


@pytest.mark.long
def test_a_mass_is_named_on_a_law_that_locks_in_the_upper_half_of_the_range():
    """Fitted to the lower half alone, Gent's law has no answer in the upper one: that start is left out."""
    s = diagnose(concealed({"inertia": {"f_1_Hz": 230.0, "zeta": 0.1}}), "gent+gm3", seed=1).summary
    assert s["verdict"] == "inertia"
    assert s["hypotheses"][0]["parameters"]["f_1_Hz"]["mean"] == pytest.approx(230.0, rel=0.03)

"""What a change of the parameters changes is worked out at few nodes; what is compared with readings is not."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.gauss_newton.laws import VARIANTS
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.refit import refit
from bayes_dea.gauss_newton.spread import Spread
from bayes_dea.likelihood.plant_group import smooth, straight
from bayes_dea.mismatch.search.hypotheses import extended
from bayes_dea.mismatch.search.nearby import Nearby
from bayes_dea.models import simulate_plant
from bayes_dea.models.effects import registered_effects
from bayes_dea.models.nodes import Nodes
from bayes_dea.models.plant import plant_of

#: what has corners of its own, or acts late and at once after a change of the command
AT_ALL_ROWS = ("supply_current_limit", "one_quadrant_supply", "supply_saturation", "inertia",
               "mullins_softening", "rate_independent_hysteresis", "acquisition_delay", "mains_pickup",
               "sensor_clipping")
#: of these, beside what sensitivities are known at few nodes; beside what nothing is, on no grid either
KNOWN_BESIDE, NOTHING_BESIDE = "supply_saturation", ("inertia",)
#: of these, what a sensor does: it acts at all rows on what few nodes know of the stack
SENSED = ("acquisition_delay", "mains_pickup", "sensor_clipping")
#: relative error of sensitivities: that of a curve read through few nodes; of a lag far below the sampling there is
#: next to nothing to be known
WRONG, COARSER, SPREAD = 0.03, {"series_resistance": 0.06}, 0.003
#: needs a column of its own
TEMPERATURE = "thermal_expansion"
GENTLE = [name for name, effect in registered_effects().items() if "voltage" in effect.acts_on
          and name not in (*AT_ALL_ROWS, TEMPERATURE)]


@pytest.fixture(scope="module")
def campaign():
    return problem_of(concealed({}))


def with_effect(problem, name, rng):
    """The problem and coordinates with an effect, or none, at a draw from its prior."""
    problem, _, q = problem
    model = extended(problem.model, [name], {}) if name else problem.model
    drawn = model.from_prior_coordinates(model.priors.draw(1, rng))[0]
    known = dict(zip(problem.model.priors.names, q, strict=False))
    start = [known.get(n, x) for n, x in zip(model.priors.names, drawn, strict=True)]
    return problem.with_model(model), np.concatenate([start, q[problem.model.dimension :]])


def with_effects(campaign, effects, at, given=None):
    """The problem and coordinates with effects whose parameters have the values `at`; given: priors of their laws."""
    problem, _, known = campaign
    model = extended(problem.model, effects, given or {})
    where = {**dict(zip(problem.model.priors.names, known, strict=False)),
             **{p.name: p.prior.to_coordinate(at[p.name]) for p in model.priors.free if p.name in at}}
    q = np.concatenate([[where[n] for n in model.priors.names], known[problem.model.dimension :]])
    return problem.with_model(model), q


def without_rough(problem: Problem) -> Problem:
    return replace(problem, pieces=tuple(replace(p, rough=None) for p in problem.pieces))


@pytest.mark.parametrize("name", ["", *GENTLE])
def test_sensitivities_by_few_nodes_are_those_by_many(campaign, name):
    problem, q = with_effect(campaign, name, np.random.default_rng(5))
    voltage = [(p, plant_at(problem, q, p)) for p in problem.pieces if p.nodes is not None]
    used = [p.nearby_reading(plant, plant) for p, plant in voltage]
    assert all(isinstance(r, Spread) if plant.is_sensed else r is p.rough
               for r, (p, plant) in zip(used, voltage, strict=True))
    few = sum(p.rough.where.size for p, _ in voltage)
    assert few < 0.4 * sum(p.reading(plant).where.size for p, plant in voltage)
    clean = problem.clean(q)
    rough, fine = problem.jacobian(q, clean), without_rough(problem).jacobian(q, clean)
    for j in range(len(rough[0])):
        wrong = np.sqrt(sum(np.sum((a[j] - b[j]) ** 2) for a, b in zip(rough, fine, strict=True)))
        size = np.sqrt(sum(np.sum(b[j] ** 2) for b in fine))
        assert wrong <= COARSER.get(name, WRONG) * size, problem.names[j]


def plant_at(problem, q, piece):
    values = {k: float(v[0]) for k, v in problem.model.physical(q[None, : problem.model.dimension]).items()}
    return plant_of(problem.model, values, piece.recording.actuator)


@pytest.mark.parametrize("name", AT_ALL_ROWS)
def test_what_comes_late_and_at_once_is_worked_out_where_it_comes(campaign, name):
    """What moves corners is known at all nodes; what is beside the end of the supply, and on a grid, by few; what a
    sensor cuts off or shows late by few nodes of the stack."""
    problem, q = with_effect(campaign, name, np.random.default_rng(5))
    for p in problem.pieces:
        plant = plant_at(problem, q, p)
        if name in SENSED:
            assert isinstance(p.nearby_reading(plant, plant), Spread)
            continue
        assert p.nearby_reading(plant, plant) is not p.rough
        assert (p.nearby_reading(plant, plant, corners_stay=True) is p.rough) == (name == KNOWN_BESIDE)
        looked = p.nearby_reading(plant, plant, to_look=True, corners_stay=True)
        assert (looked is p.rough) == (name not in NOTHING_BESIDE)
    assert not plant_at(*with_effect(campaign, TEMPERATURE, np.random.default_rng(5)), problem.pieces[0]).is_gentle()
    clean = problem.clean(q)
    rough, fine = problem.jacobian(q, clean), without_rough(problem).jacobian(q, clean)
    own = {p.name for p in registered_effects()[name].parameters}
    for j, p in enumerate(problem.model.priors.free):
        wrong = np.sqrt(sum(np.sum((a[j] - b[j]) ** 2) for a, b in zip(rough, fine, strict=True)))
        size = np.sqrt(sum(np.sum(b[j] ** 2) for b in fine))
        if p.name not in own and name in (KNOWN_BESIDE, *SENSED):
            assert 0.0 < wrong <= (SPREAD if name in SENSED else WRONG) * size, p.name
        else:
            assert wrong == 0.0, p.name


@pytest.mark.parametrize(("effects", "at"), [
    (("leakage", "acquisition_delay"), {"R_s_ohm": 2e5, "R_leak_ohm": 1e9, "T_d_s": 3e-4}),
    (("series_resistance", "sensor_lag"), {"R_s_ohm": 1e5, "tau_s_s": 5e-3}),
    (("strain_stiffening", "sensor_clipping"), {"beta": 50.0, "y_max_m": 1.5e-4}),
])
def test_beside_a_sensor_the_stack_is_worked_out_at_few_nodes(campaign, effects, at):
    """And all sensitivities are those at all nodes, as nearly as without a sensor."""
    problem, q = with_effects(campaign, effects, at)
    asked = []
    clean = problem.clean(q)
    for p in problem.pieces:
        plant = plant_at(problem, q, p)
        reading = p.nearby_reading(plant, plant)
        assert isinstance(reading, Spread)
        asked.append(reading.few.size / reading.where.size)
        # where it is known it is what it is known to be
        np.testing.assert_array_equal(reading.means(reading.output(reading.plant)), clean[problem.pieces.index(p)])
    assert np.mean(asked) < 0.3
    few, all_ = problem.jacobian(q, clean), without_rough(problem).jacobian(q, clean)
    for j in range(len(few[0])):
        wrong = np.sqrt(sum(np.sum((a[j] - b[j]) ** 2) for a, b in zip(few, all_, strict=True)))
        size = np.sqrt(sum(np.sum(b[j] ** 2) for b in all_))
        assert wrong <= WRONG * size, problem.names[j]


def test_a_plant_that_differs_by_its_sensor_alone_is_not_simulated_again(campaign, monkeypatch):
    problem, q = with_effect(campaign, "strain_stiffening", np.random.default_rng(5))
    piece = problem.pieces[0]
    plant, nodes = plant_at(problem, q, piece), piece.nodes
    runs = []
    strain = simulate_plant._strain
    monkeypatch.setattr(simulate_plant, "_strain", lambda *a, **k: runs.append(1) or strain(*a, **k))
    first = simulate_plant.simulate_nodes(plant, nodes)
    before = len(runs)
    for sensor in ({"T_d_s": 3e-4}, {"tau_s_s": 2e-3}, {"q_2_per_m": 50.0}, {"y_max_m": 1e-4}, {"drift_m_per_s": 1e-9}):
        late = simulate_plant.simulate_nodes(replace(plant, **sensor), nodes)
        assert np.abs(late - first).max() > 1e-9
    spoiled = simulate_plant.simulate_nodes(plant, nodes)
    spoiled[:] = 0.0  # whoever asks may do with it as they please
    np.testing.assert_array_equal(simulate_plant.simulate_nodes(plant, nodes), first)
    assert len(runs) == before
    stiffer = replace(plant, beta=2.0 * plant.beta)
    assert np.abs(simulate_plant.simulate_nodes(stiffer, nodes) - first).max() > 1e-9
    # nor is what came before it another one
    assert simulate_plant.simulate_nodes(plant, nodes, piece.nodes).shape == first.shape
    assert len(runs) == before + 2


@pytest.mark.parametrize("delay_s", [-4e-4, 2e-3, 30e-3])
def test_predictions_beside_a_delay_are_those_at_all_nodes(campaign, delay_s):
    """Late, at once or ahead: it is read off all nodes, and what a further effect changes is worked out at few."""
    _, prior, _ = campaign
    law = VARIANTS["acquisition_delay"] if delay_s < 0 else {}
    late, there = with_effects(campaign, ("acquisition_delay",), {"T_d_s": delay_s}, law)
    fit = refit(late, there, prior.start(), prior, max_steps=0, fit_noise=False)
    both = ("stretch_dependent_permittivity", "acquisition_delay")
    other, there = with_effects(campaign, both, {"T_d_s": delay_s, "c_eps": -1.5}, law)
    nearby = Nearby(fit)
    for a, b, c in zip(nearby.clean(other, there), other.clean(there), fit.clean, strict=True):
        assert 0.0 < np.sqrt(np.mean((a - b) ** 2)) <= 0.005 * np.sqrt(np.mean((b - c) ** 2))


@pytest.mark.parametrize(("damping", "few"), [(0.5, False), (0.9, True)])
def test_what_changes_beside_a_mass_that_hardly_swings_is_worked_out_at_few_nodes(campaign, damping, few):
    """But for what it swings at, whose corners move. With a curved law beside it a simulation takes ten times as long
    as at few nodes."""
    at = {"beta": 50.0, "f_1_Hz": 300.0, "zeta": damping}
    problem, q = with_effects(campaign, ("inertia", "strain_stiffening"), at)
    for p in problem.pieces:
        plant = plant_at(problem, q, p)
        assert (p.nearby_reading(plant, plant, corners_stay=True) is p.rough) == few
        assert p.nearby_reading(plant, plant) is not p.rough
    clean = problem.clean(q)
    some, every = problem.jacobian(q, clean), without_rough(problem).jacobian(q, clean)
    for j, name in enumerate(problem.names[: len(some[0])]):
        wrong = np.sqrt(sum(np.sum((a[j] - b[j]) ** 2) for a, b in zip(some, every, strict=True)))
        size = np.sqrt(sum(np.sum(b[j] ** 2) for b in every))
        assert 0.0 < wrong <= WRONG * size if few and name not in ("log f_1_Hz", "log zeta") else wrong == 0.0, name


def test_predictions_nearby_are_those_at_all_nodes(campaign):
    """But for five thousandths of what changes; at the fit they are its own to the last digit."""
    problem, prior, q = campaign
    fit = refit(problem, q, prior.start(), prior)
    nearby = Nearby(fit)
    for a, b in zip(nearby.clean(problem, fit.q), fit.clean, strict=True):
        np.testing.assert_array_equal(a, b)
    other, there = with_effect((problem, prior, fit.q), "dielectric_absorption", np.random.default_rng(5))
    for name, value in (("chi", 0.05), ("tau_d_s", 2.0)):
        there[other.model.priors.names.index(name)] = np.log(value)
    changed = 0.0
    for a, b, c in zip(nearby.clean(other, there), other.clean(there), fit.clean, strict=True):
        assert np.sqrt(np.mean((a - b) ** 2)) <= 0.005 * np.sqrt(np.mean((b - c) ** 2))
        changed = max(changed, float(np.abs(b - c).max()))
    assert changed > 1e-6
    part = nearby.clean(other, there, only=[0])
    assert part[0].size > 0
    assert all(x.size == 0 for x in part[1:])


def test_between_few_nodes_the_output_is_a_cubic_on_each_side_of_a_corner():
    row = np.array([0, 1, 2, 3, 5, 8, 12, 17, 23, 30, 38, 47])
    t = 1e-3 * np.arange(48)
    nodes = Nodes(t[row], 0.0 * row, row, 48, step_s=1e-3, corners=np.array([6]), unread=np.array([3, 9]))
    rows = np.arange(48)
    x = 40.0 * t

    def cubic(x):
        return 1.0 - x + 2.0 * x * x - 0.7 * x**3

    def read(between, y):
        at, weights = between(nodes, t, rows)
        assert np.abs(weights.sum(axis=0) - 1.0).max() < 1e-12
        used = np.unique(at[weights != 0.0])
        return (weights * y[at]).sum(axis=0), used

    y, used = read(smooth, cubic(x[row]))
    np.testing.assert_allclose(y, cubic(x), rtol=0, atol=1e-12)
    assert not {3, 9} & set(used.tolist())  # what is not read says nothing
    # a kink at row 12: either side by itself, where a straight line is 0.02 out
    kinked = np.where(x < x[12], cubic(x), cubic(x[12]) + 3.0 * (x - x[12]) + (x - x[12]) ** 2)
    y, _ = read(smooth, kinked[row])
    np.testing.assert_allclose(y, kinked, rtol=0, atol=1e-12)
    assert np.abs(read(straight, kinked[row])[0] - kinked).max() > 0.005


def test_softening_is_worked_out_at_few_nodes_where_one_looks_around_only(campaign):
    problem, prior, q = campaign
    fit = refit(problem, q, prior.start(), prior)
    nearby = Nearby(fit)
    other, there = with_effect((problem, prior, fit.q), "mullins_softening", np.random.default_rng(6))
    exact = other.clean(there)
    for a, b, c, d in zip(nearby.clean(other, there), exact, nearby.clean(other, there, to_look=True), fit.clean,
                          strict=True):
        np.testing.assert_array_equal(a, b)
        assert 0.0 < np.sqrt(np.mean((c - b) ** 2)) <= 0.1 * np.sqrt(np.mean((b - d) ** 2))

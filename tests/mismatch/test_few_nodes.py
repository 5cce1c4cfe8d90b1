"""A diagnosis works out slow commands at few nodes where the model allows it, and at every row where not."""

from dataclasses import replace

import numpy as np
import pytest

import bayes_dea as bd
from bayes_dea.assemble import assemble
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave
from bayes_dea.bench.simulate import simulate
from bayes_dea.gauss_newton.problem import Problem
from bayes_dea.gauss_newton.reduced import again, reduce_campaign, subset
from bayes_dea.mismatch.readings.reread import with_hold
from bayes_dea.models.model import build_model


@pytest.fixture(scope="module")
def assembled():
    plan = CampaignPlan("slow", (RecordingPlan("creep.csv", Creep(900.0, 20.0, 0), "identify"),
                                 RecordingPlan("sine.csv", Wave("sine", 0.1, cycles=2), "identify")))
    g = plan.geometry
    actuator = bd.Actuator(g.name, g.layers, g.layer_thickness_m, g.relative_permittivity, g.electrode_area_m2,
                           g.total_area_m2, g.stack_height_m, g.layer_mass_kg, g.max_voltage_V, g.max_frequency_Hz)
    recordings = [bd.recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator)
                  for s in simulate(plan, 1)]
    sensors = {"displacement": bd.Sensor(4.7e-6, 19.4e-6, 0.15e-6)}
    return assemble(bd.campaign_from_recordings(recordings, sensors, actuator, name="slow"), build_model("hooke+gm2"))


def middle_of(problem):
    """Coordinates in the middle of the priors."""
    model = problem.model
    middle = model.priors.transform(np.full((1, model.dimension), 0.5))
    return np.concatenate([model.from_prior_coordinates(middle)[0], problem.zero_mean, np.zeros(problem.gain_sd.size)])


@pytest.mark.parametrize(("effect", "smooth"), [("", True), ("+leakage", True), ("+sensor_clipping", False)])
def test_few_nodes_for_smooth_models_alone(assembled, effect, smooth):
    model = build_model("hooke+gm2" + effect)
    pieces = reduce_campaign(assembled)
    problem = Problem.of(assembled, model, pieces)
    every = replace(problem, pieces=tuple(replace(p, few=None) for p in pieces))
    q = middle_of(problem)
    few = [reading.where.time_s.size for reading, _ in problem._outputs(q)]
    full = [reading.where.time_s.size for reading, _ in every._outputs(q)]
    assert few[0] == full[0]
    assert (few[1] < 0.25 * full[1]) is smooth
    for x, y in zip(problem.clean(q), every.clean(q), strict=True):
        assert np.abs(x - y).max() <= (1e-4 * np.abs(y).max() if smooth else 0.0)


def test_what_is_made_of_a_piece_keeps_its_few_nodes(assembled):
    piece = reduce_campaign(assembled)[1]
    keep = np.arange(piece.blocks.n) % 2 == 0
    made = subset(piece, keep), again(piece, piece.prepared), with_hold(piece, "start"), with_hold(piece, "linear")
    for other in made:
        assert other.few.averaging.shape == (other.blocks.n, other.few.where.size)
        assert other.few.where.size < 0.25 * other.nodes.size
        # weights of every block sum to one
        np.testing.assert_allclose(other.few.averaging.sum(axis=1), 1.0, rtol=0, atol=1e-12)


def test_rows_are_read_off_few_nodes_as_their_means_are(assembled):
    """To a hundred thousandth of a stroke of what every row gives: straight between few nodes it is three and more."""
    model = build_model("hooke+gm2")
    problem = Problem.of(assembled, model, reduce_campaign(assembled))
    every = replace(problem, pieces=tuple(replace(p, few=None) for p in problem.pieces))
    q = middle_of(problem)
    (_, few), (_, full) = problem.rows(q), every.rows(q)
    reading, answer = problem._outputs(q)[1]
    straight = np.interp(problem.pieces[1].recording.time_s, reading.where.time_s, answer)
    size = np.ptp(full)
    assert np.abs(few - full).max() < 1e-5 * size
    assert np.abs(straight - full).max() > 3e-5 * size
    (_, means), (_, known) = problem.clean(q), every.clean(q)
    assert np.abs(means - known).max() < 1e-5 * size


def test_a_sensor_that_is_fine_has_every_row_of_what_comes_late(assembled):
    pieces = reduce_campaign(assembled)
    fine = tuple(replace(p, prepared=replace(p.prepared, quiet_sd=1e-8)) for p in pieces)
    model = build_model("hooke+gm2+series_resistance")
    for made, all_rows in ((pieces, False), (fine, True)):
        problem = Problem.of(assembled, model, made)
        reading, _ = problem._outputs(middle_of(problem))[1]
        assert (reading.where is made[1].nodes) is all_rows

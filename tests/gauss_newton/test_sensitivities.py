"""Sensitivities are differences of predictions, each worked out where it belongs."""

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of


@pytest.mark.parametrize("model", ["hooke+gm3+series_resistance+inertia", "yeoh+gkv2"])
def test_plants_of_many_places_are_those_of_each(model):
    problem, _, q = problem_of(concealed(pressed=True), model)
    places = q + np.diag(problem.steps(q))[: problem.model.dimension]
    together = problem.plants_at(places)
    assert [[p.key for p in plants] for plants in together] == [[p.key for p in problem.plants(x)] for x in places]


def test_they_are_differences_of_predictions_for_parameters_and_zeros():
    problem, _, q = problem_of(concealed(pressed=True), "yeoh+gm2")
    assert problem.zero_mean.size
    clean, steps = problem.clean(q), problem.steps(q)
    slopes = problem.jacobian(q, clean)
    for j in range(problem.model.dimension + problem.zero_mean.size):
        moved = q.copy()
        moved[j] += steps[j]
        for piece, slope, before, after in zip(problem.pieces, slopes, clean, problem.clean(moved), strict=True):
            expected = (after - before) / steps[j]
            # few nodes miss a few hundredths of a change at worst
            assert np.abs(slope[j] - expected).max() <= 0.03 * np.abs(expected).max() + 1e-12, (piece.name, j)

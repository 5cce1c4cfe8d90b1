"""A force is large or small by the steps of its own sensor."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed

from bayes_dea.mismatch.where.size import effect_size


@pytest.fixture(scope="module")
def pressed():
    """A fit of a campaign with a compression, and the same with all forces 5 mN larger in its second half."""
    from bayes_dea.mismatch.diagnosis import diagnose

    fit = diagnose(concealed(pressed=True), "hooke+gm3", seed=1).base
    clean = [np.array(x) for x in fit.clean]
    for x, piece in zip(clean, fit.problem.pieces, strict=True):
        if piece.channel == "force":
            x[x.size // 2 :] += 5e-3
    return fit, replace(fit, clean=clean)


def with_resolution(fit, newton):
    """The same where the force sensor has this resolution."""
    pieces = [
        p if p.channel != "force" else
        replace(p, prepared=replace(p.prepared, sensor=replace(p.prepared.sensor, resolution=newton)))
        for p in fit.problem.pieces
    ]
    return replace(fit, problem=replace(fit.problem, pieces=tuple(pieces)))


def test_a_step_of_the_force_counts_as_one_of_the_displacement(pressed):
    before, after = pressed
    (force,) = [p for p in before.problem.pieces if p.channel == "force"]
    share = force.blocks.count / force.blocks.count.sum()
    late = share[share.size // 2 :].sum()
    gain = before.problem.beside(before.q)[1][force.group]
    rms = (1.0 + gain) * 5e-3 * np.sqrt(late * (1.0 - late))
    assert effect_size(before, after) == pytest.approx(rms / 1e-3 * 0.15e-6, rel=1e-9)
    coarse = with_resolution(after, 0.01)
    assert effect_size(before, coarse) == pytest.approx(rms / 0.01 * 0.15e-6, rel=1e-9)


def test_without_a_resolution_a_force_is_what_it_moves_a_stack_by(pressed):
    before, after = pressed
    finest = effect_size(before, with_resolution(after, None))
    # by its own law and geometry
    actuator = before.problem.pieces[0].recording.actuator
    stiffness = after.values()["Y_Pa"] * actuator.total_area_m2 / actuator.stack_height_m
    assert stiffness == pytest.approx(13e3, rel=0.1)
    assert finest == pytest.approx(effect_size(before, after) * 1e-3 / 0.15e-6 / stiffness, rel=1e-9)

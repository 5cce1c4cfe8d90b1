"""A sensor whose steps are coarser than its noise: rounding is an error of the mean of a block whatever its rows."""

from dataclasses import replace

import numpy as np
import pytest
from concealed_campaigns import concealed, problem_of

from bayes_dea.mismatch.diagnosis import diagnose

STEP = 5e-6


def coarse(step=STEP, noise=0.4e-6):
    """Readings of an encoder: those of a quiet sensor in steps of 5 um."""
    c = concealed(scale=0.085)
    sensors = {**c.sensors, "displacement": replace(c.sensors["displacement"], fluctuation=noise, resolution=step)}
    recordings = tuple(
        replace(r, columns={**r.columns, "displacement_m": step * np.round(r.columns["displacement_m"] / step)})
        for r in c.recordings
    )
    return replace(c, recordings=recordings, sensors=sensors)


def test_a_block_on_one_step_is_off_by_rounding_however_many_rows_it_has():
    problem, _, _ = problem_of(coarse())
    for piece in problem.pieces:
        assert piece.rounding == STEP
        b = piece.blocks
        of_mean = piece.further_variance / b.count
        y = piece.prepared.y
        spans = np.array([np.ptp(y[i:j]) for i, j in zip(b.start, b.stop, strict=True)])
        level = spans == 0.0
        assert level.any()
        assert of_mean[level] == pytest.approx(STEP**2 / 12.0)
        assert (of_mean[~level] <= STEP**2 / 48.0 * (1 + 1e-9)).all()


def test_of_a_fine_sensor_rounding_is_noise():
    problem, _, _ = problem_of(concealed())
    assert all(p.rounding == 0.0 and not p.further_variance.any() for p in problem.pieces)


@pytest.mark.long
def test_steps_are_no_physics_and_no_gains():
    s = diagnose(coarse(), "hooke+gm3", seed=1).summary
    assert s["verdict"] == "none"
    assert not any("gain differs" in w for w in s["warnings"])

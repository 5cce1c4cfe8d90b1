"""Which of position and force is held in a recording, told from the recording alone."""

import numpy as np
import pytest

from bayes_dea.importing.shapes import mechanical_shape

STEP_S = 0.01


def held_and_answering(hold_s, ramp_s, drift, noise, seed):
    """(imposed, answering), both (n,) with a span of about 1: a ramp, then a hold in which the answer goes on."""
    rng = np.random.default_rng(seed)
    t = np.arange(round((1.0 + ramp_s + hold_s) / STEP_S)) * STEP_S
    imposed = np.clip((t - 1.0) / ramp_s, 0.0, 1.0)
    since = np.maximum(t - 1.0 - ramp_s, 0.0)
    answer = imposed * (1.0 - drift * (1.0 - np.exp(-since / (hold_s / 3))))
    return imposed + noise * rng.standard_normal(t.size), answer + noise * rng.standard_normal(t.size)


@pytest.mark.parametrize(("hold_s", "ramp_s"), [(8.0, 0.35), (8.0, 0.05), (120.0, 0.5), (30.0, 5.0)])
@pytest.mark.parametrize("drift", [0.05, -0.05, 0.4])
@pytest.mark.parametrize("noise", [2e-4, 3e-3])
def test_the_one_that_stays_where_it_is_was_held(hold_s, ramp_s, drift, noise):
    for seed in range(5):
        imposed, answer = held_and_answering(hold_s, ramp_s, drift, noise, seed)
        assert mechanical_shape(imposed, answer).kind == "relaxation"
        assert mechanical_shape(answer, imposed).kind == "load"


def test_where_both_move_all_the_time_nothing_was_held():
    t = np.arange(0.0, 20.0, STEP_S)
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * 0.2 * t)
    assert mechanical_shape(wave, wave**2).kind == "compression"

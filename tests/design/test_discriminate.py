"""What few draws add to the expected information about the name is taken off, and no more."""

from itertools import pairwise

import numpy as np
import pytest

from bayes_dea.design.discriminate import Simulated, expected_telling, telling_of_draws
from bayes_dea.design.gain import coordinates, linear_after, shrinkage

HALF = np.array([0.5, 0.5])


def rivals(apart, seed=1, draws=3000):
    """Joint draws (N, 4) of two hypotheses and their answers (N, 60), linear in them, in sds of the noise."""
    rng = np.random.default_rng(seed)
    slope = rng.standard_normal((4, 60))
    joints = [rng.standard_normal((draws, 4)) for _ in range(2)]
    shift = apart * rng.standard_normal(60) / np.sqrt(60)
    return joints, [joints[0] @ slope, joints[1] @ slope + shift]


@pytest.mark.parametrize("apart", [0.7, 1.5, 3.0])
def test_a_hundred_draws_tell_what_all_of_them_tell(apart):
    joints, answers = rivals(apart)
    whole = expected_telling(answers, HALF, np.random.default_rng(3), 2000)
    rows = np.arange(0, len(joints[0]), 25)
    few = [Simulated.of(j, rows) for j in joints]
    told = telling_of_draws(few, [a[rows] for a in answers], HALF, (1, 2))
    assert abs(told.nats - whole.nats) < 3.0 * np.hypot(told.se, whole.se) + 0.01
    assert told.se < 0.05


def test_a_longer_experiment_tells_no_less():
    """Its first readings are those of the shorter one."""
    joints, answers = rivals(1.0)
    rows = np.arange(0, len(joints[0]), 25)
    few = [Simulated.of(j, rows) for j in joints]
    told = [telling_of_draws(few, [a[rows, :n] for a in answers], HALF, (1, 2)) for n in (20, 40, 60)]
    for shorter, longer in pairwise(told):
        assert longer.nats > shorter.nats - 2.0 * np.hypot(shorter.se, longer.se)


def test_widths_of_what_is_linear_do_not_depend_on_which_draws_are_simulated():
    """The mean of those that are is another one than that of all."""
    rng = np.random.default_rng(5)
    joint = rng.standard_normal((4000, 3))
    slope = np.array([1.0, -0.5, 2.0])
    after = linear_after(10.0 * np.eye(3))
    expected = np.sqrt(slope @ after @ slope / (slope @ slope))
    some = np.flatnonzero(joint[:, 0] > 0.0)[:144]
    at = coordinates(joint, 3, some)
    got = shrinkage(at, {"x": joint[some] @ slope}, after)["x"]
    assert got == pytest.approx(expected, rel=0.1)

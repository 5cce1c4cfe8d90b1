"""A sensor that loses its target for a moment, in a stream."""

import numpy as np
import pytest
from stream import Session, learner, played


def learned(rows):
    """What is believed after the rows (n, 3), the alarms on the way, and how many readings did not count."""
    one = learner(particles=400, longest_s=600.0)
    alarms = []
    for part in np.array_split(rows, 20):
        one.feed(Session(1, zeroed=True), part)
        while one.ready():
            alarms += one.update().alarms
    return one.latest, alarms, one.masked


@pytest.fixture(scope="module")
def clean():
    return learned(played(seed=3))


@pytest.mark.parametrize(("value", "length", "found"), [
    (-1e-3, 6, 3), (-1e-3, 39, 3), (0.75e-3, 25, 3), (0.0, 12, 2),
])
def test_held_values_of_a_lost_target_do_not_count_and_are_said(clean, value, length, found):
    """Three bursts, shorter than what is called stuck; 0 is a value that readings are near at one of them."""
    rows = played(seed=3)
    for start in (900, 1500, 2000):
        rows[start : start + length, 2] = value
    believed, alarms, masked = learned(rows)
    assert masked == found * length
    for name in ("Y_Pa", "k_1_Pa", "tau_1_s", "sigma_displacement_m"):
        before = clean[0][name]
        assert abs(believed[name]["mean"] - before["mean"]) < before["sd"], name
        assert believed[name]["sd"] < 1.5 * before["sd"], name
    assert any(a.what.startswith("drop-outs: ") for a in alarms)
    assert not any(a.what.startswith("delay") for a in alarms)


def test_readings_without_a_lost_target_all_count(clean):
    _, alarms, masked = clean
    assert masked == 0
    assert not alarms


@pytest.mark.long
def test_a_move_that_no_delay_makes_is_not_called_one(clean):
    """All readings of one block lie a millimetre off: a delay that did this would be longer than the block."""
    rows = played(seed=3)
    rows[1400:1500, 2] += 1e-3
    alarms = learned(rows)[1]
    assert alarms
    assert not any(a.what.startswith("delay") for a in alarms)

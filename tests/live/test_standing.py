"""A sensor that stands still is no measurement."""

import numpy as np
from stream import Session, learner, played

from bayes_dea.live.standing import LEAST, standing_still


def test_only_long_runs_of_equal_readings_stand_still():
    y = np.random.default_rng(1).standard_normal(300)
    y[50 : 50 + LEAST] = 1.0
    y[200 : 200 + LEAST - 1] = 2.0
    still = standing_still(y)
    assert still[50 : 50 + LEAST].all()
    assert still.sum() == LEAST
    assert not standing_still(np.ones(LEAST - 1)).any()
    assert not standing_still(np.full(100, np.nan)).any()


def test_a_sensor_that_gets_stuck_is_said_and_does_not_count():
    rows = played()
    rows[1600:, 2] = rows[1600, 2]
    one = learner(particles=300, longest_s=600.0)
    one.feed(Session(1, zeroed=True), rows)
    alarms = []
    while one.ready():
        update = one.update()
        alarms += update.alarms
        if update.samples == 1600:
            before = dict(one.latest["Y_Pa"])
    assert any(a.what.startswith("stuck: ") and abs(a.time_s - rows[1600, 0]) < 1.0 for a in alarms)
    assert one.masked >= len(rows) - 1600 - one.block - 12
    assert one.latest["Y_Pa"]["sd"] > 0.8 * before["sd"]


def test_a_sensor_that_never_moved_breaks_nothing():
    rows = played()
    rows[:, 2] = 0.0
    one = learner(particles=300, longest_s=600.0)
    one.feed(Session(1, zeroed=True), rows)
    alarms = []
    while one.ready():
        alarms += one.update().alarms
    assert alarms
    assert all(a.what.startswith("stuck: ") for a in alarms)
    assert one.masked == one.samples

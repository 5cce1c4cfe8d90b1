"""Alarms: rare while nothing changes, soon when something does."""

import numpy as np
import pytest
from stream import device, rows_of

from bayes_dea.live.learner import Session
from bayes_dea.live.monitor import Cusum, Monitor, MonitorSettings


def test_false_alarms_are_as_rare_as_stated():
    """Thirty hours of blocks of half a second with four sums on either side (the scatter on one)."""
    settings = MonitorSettings()
    rng = np.random.default_rng(1)
    cusum = Cusum.new(settings, 4)
    alarms = 0
    for z in rng.standard_normal((30 * 7200, 4)):
        z[3] = max(z[3], -settings.drift)
        if cusum.add(z).max() > settings.threshold:
            alarms += 1
            cusum.reset()
    assert alarms <= 3
    assert settings.false_alarms_per_hour(0.5) * 30 < 3


def test_the_stated_rate_is_right_where_it_can_be_counted():
    settings = MonitorSettings(threshold=2.5)
    rng = np.random.default_rng(2)
    cusum = Cusum.new(settings, 4)
    alarms = 0
    hours = 8
    for z in rng.standard_normal((hours * 7200, 4)):
        z[3] = max(z[3], -settings.drift)
        over = cusum.add(z) > settings.threshold
        alarms += int(over.sum())
        cusum.high[over] = cusum.low[over] = 0.0
    assert 0.6 < alarms / (hours * settings.false_alarms_per_hour(0.5)) < 1.6


def test_sums_add_up_what_lasts():
    cusum = Cusum.new(MonitorSettings(), 1)
    for _ in range(4):
        largest = cusum.add(np.array([2.0]))
    assert largest[0] == 4.0
    cusum.reset()
    assert cusum.add(np.array([-3.0]))[0] == 2.0


def followed(faults, rate_Hz=200.0, cycles=28):
    """Alarms of a learner that follows a 0.5 Hz rectangle; the change comes at 24 s."""
    from stream import learner

    machine = device(rate_Hz, faults)
    machine.hear("ZERO")
    machine.hear("START")
    one = learner(particles=600)
    alarms = []
    level = [900, 300]
    for i in range(cycles):
        machine.hear(f"V {level[i % 2]}")
        one.feed(Session(1, zeroed=True), rows_of(machine.produce(int(rate_Hz))))
        while one.ready():
            alarms += one.update().alarms
    return alarms


@pytest.mark.long
@pytest.mark.parametrize(("fault", "word"), [
    ("stiffness=22.3:1.05", "stroke"), ("stiffness=22.3:0.95", "stroke"), ("delay=22.3:0.015", ""),
])
def test_a_change_is_found_within_five_seconds(fault, word):
    alarms = followed([fault])
    assert alarms
    assert 22.3 < alarms[0].time_s < 27.3
    assert any(word in a.what for a in alarms)


@pytest.mark.long
def test_nothing_is_said_while_nothing_changes():
    assert followed([]) == []


def test_drop_outs_that_appear_are_named():
    monitor = Monitor(MonitorSettings(), 1e-3)
    assert [a for i in range(200) for a in monitor.dropouts(i % 50 == 0, 500, 0.5 * i)] == []
    found = monitor.dropouts(15, 500, 100.0)
    assert len(found) == 1
    assert "drop-outs: 15 of 500" in found[0].what
    assert monitor.dropouts(15, 500, 100.5) == []  # said once

"""Two effects in readings that come a part of a sample early or late, as they were drawn when they were not found."""

import sys
from pathlib import Path

import pytest

from bayes_dea.bench.concealed import draw_case
from bayes_dea.mismatch.diagnosis import diagnose

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "runs" / "concealed"))

from study import campaign_of


@pytest.mark.long
@pytest.mark.parametrize("seed", [1566302, 1566355, 1566359])
def test_both_are_found(seed):
    """A mode and a mass; a dead zone and absorption; a softening and a mass: unknown, 635, 181 and 26,700 nats behind.
    """
    case = draw_case(seed)
    summary = diagnose(campaign_of(case), case.model, seed=1).summary
    assert summary["verdict"] == case.truth


@pytest.mark.long
def test_a_mode_that_a_damper_sets_free_is_put_where_it_is_needed():
    """A fractional relaxation and a damper, read 0.6 ms early: unknown, 54 nats behind.

    One of three modes was the damper, at 0.3 ms, and lay beside another one once a mass did that work; with that mode
    back at 170 s a mass with much damping leaves nothing, and the damper is 11 nats ahead of that.
    """
    case = draw_case(1567883)
    summary = diagnose(campaign_of(case), case.model, seed=1).summary
    assert set(summary["indistinguishable"]) == {
        "fractional_relaxation+parallel_damper", "fractional_relaxation+sensor_lag",
    }  # fmt: skip


@pytest.mark.long
def test_beside_the_second_of_two_another_is_looked_for_as_well():
    """A curved sensor that drifts, read 0.5 ms early: stiffening led alone, and stayed with the drift, 68 nats behind.
    """
    case = draw_case(1568481)
    summary = diagnose(campaign_of(case), case.model, seed=1).summary
    assert case.truth == "sensor_nonlinearity+sensor_drift"
    assert summary["verdict"] == case.truth

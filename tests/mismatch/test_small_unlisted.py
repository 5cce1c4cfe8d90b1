"""What is on no list is held against what it stands beside, and below one resolution step it is not told."""

from types import SimpleNamespace

import pytest

from bayes_dea.mismatch import judge

STEP_M = 1e-7
SIZES = {"bare": 3e-7, "leakage": 0.4e-7, "late": 0.2e-7, "lost": 0.0}


def weighed(fit, refitted=True):
    return SimpleNamespace(fit=fit, refitted=refitted)


@pytest.mark.parametrize(("beside", "nothing", "small"), [
    ("none", None, False),  # three steps, against the model alone
    ("leakage", None, True),
    ("inertia", None, False),  # not weighed: it counts
    ("sensor_lag", None, False),  # told by a grid alone, whose fit is not its own
    ("none", weighed("late"), True),  # where nothing is claimed, against that with its shift below a sample
])  # fmt: skip
def test_it_is_held_against_what_it_stands_beside(monkeypatch, beside, nothing, small):
    monkeypatch.setattr(judge, "repair_size", lambda fit, repaired: SIZES[fit])
    naming = SimpleNamespace(
        none=SimpleNamespace(weighed=weighed("bare", refitted=False)),
        weighed={"leakage": weighed("leakage"), "sensor_lag": weighed("lost", refitted=False)},
    )
    found = SimpleNamespace(beside=beside, repaired=None)
    assert judge._below_a_step(found, nothing, naming, STEP_M) is small

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

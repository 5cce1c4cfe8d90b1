"""Small campaigns for designs."""

import pytest
from bench_campaigns import SENSORS, bench_campaign

from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave

CREEP = RecordingPlan("creep.csv", Creep(900.0, 20.0, conditioning_steps=0), "identify", 50.0)
SINE = RecordingPlan("sine.csv", Wave("sine", 1.0, offset_V=500.0, amplitude_V=300.0, cycles=4), "identify", 100.0)


@pytest.fixture(scope="package")
def campaign():
    """Two voltage recordings; the bench has plates, too."""
    return bench_campaign(CampaignPlan("small", (CREEP, SINE)))


@pytest.fixture(scope="package")
def electric():
    """The same without sensors for plates."""
    return bench_campaign(CampaignPlan("small", (CREEP, SINE)), sensors={"displacement": SENSORS["displacement"]})

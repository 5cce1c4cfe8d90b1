"""Small campaigns for comparisons."""

import pytest
from bench_campaigns import ACTUATOR, SENSORS, bench_campaign

from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Relaxation, Wave

CREEP = RecordingPlan("creep.csv", Creep(1000.0, 20.0, conditioning_steps=0), "identify", 50.0)
SINE = RecordingPlan("sine.csv", Wave("sine", 1.0, cycles=4), "identify", 100.0)
PRESS = RecordingPlan("relax.csv", Relaxation(hold_s=8.0), "identify", 50.0)
KEPT = RecordingPlan("kept.csv", Creep(800.0, 10.0, conditioning_steps=0), "validate", 50.0)
PRESSED = RecordingPlan("pressed.csv", Relaxation(hold_s=5.0), "validate", 50.0)


@pytest.fixture(scope="package")
def campaign():
    """Voltage recordings and a relaxation to identify, one of each kept for validation."""
    return bench_campaign(CampaignPlan("small", (CREEP, SINE, PRESS, KEPT, PRESSED)))


@pytest.fixture(scope="package")
def voltage_campaign():
    """Three voltage recordings, one of them kept."""
    return bench_campaign(CampaignPlan("voltage", (CREEP, SINE, KEPT)))


@pytest.fixture(scope="package")
def compared(campaign):
    """A comparison of small structures, done once."""
    from bayes_dea.comparison.run import compare

    return compare(campaign, "hooke,hooke+gm1,hooke+gm2,hooke+gkv2,neohooke+gm1", seed=2)


__all__ = ["ACTUATOR", "SENSORS"]

"""Ready-made campaigns of the virtual bench."""

from __future__ import annotations

from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import WAVE_SHAPES, Compression, Creep, Relaxation, Wave


def _creep(voltage_V: float, role: str, sampling_Hz: float, conditioning_s: float,
           hold_s: float) -> RecordingPlan:
    protocol = Creep(voltage_V, hold_s, conditioning_on_s=conditioning_s, conditioning_off_s=conditioning_s)
    return RecordingPlan(f"creep_{voltage_V:04.0f}V.csv", protocol, role, sampling_Hz, zeroed=True)


def _wave(shape: str, frequency_Hz: float, cycles: float, role: str, sampling_Hz: float) -> RecordingPlan:
    return RecordingPlan(f"{shape}_{frequency_Hz:g}Hz.csv", Wave(shape, frequency_Hz, cycles=cycles), role,
                         sampling_Hz)


def quickstart() -> CampaignPlan:
    """The paper's protocols shortened: 0.9 million samples, generated in seconds."""
    holds = ((400.0, "identify"), (700.0, "identify"), (1000.0, "identify"), (1200.0, "identify"),
             (900.0, "validate"))
    return CampaignPlan("quickstart", (
        *(_creep(voltage, role, 500.0, 10.0, 300.0) for voltage, role in holds),
        _wave("sine", 1.0, 10.0, "identify", 500.0),
        RecordingPlan("relaxation.csv", Relaxation(), "identify", 100.0),
        _wave("rectangle", 1.0, 10.0, "validate", 500.0),
        _wave("triangle", 0.1, 3.0, "validate", 500.0)))


def paper() -> CampaignPlan:
    """Twelve voltages of 720 s and nine waves at 1 kHz, as the paper recorded them: 8.8 million samples."""
    cycles = {0.1: 3.0, 1.0: 10.0, 10.0: 50.0}
    return CampaignPlan("paper", (
        *(_creep(100.0 * i, "identify", 1000.0, 30.0, 600.0) for i in range(1, 13)),
        *(_wave(shape, frequency, n, "validate", 1000.0) for shape in WAVE_SHAPES
          for frequency, n in cycles.items())))


def mechanical() -> CampaignPlan:
    """The paper's compression and relaxation experiments, between plates."""
    return CampaignPlan("mechanical", (
        RecordingPlan("compression.csv", Compression(), "identify", 200.0),
        RecordingPlan("relaxation.csv", Relaxation(), "identify", 100.0)))


def small() -> CampaignPlan:
    """A few seconds of each kind, for tests: too short to say anything about the slow branches."""
    return CampaignPlan("small", (
        _creep(800.0, "identify", 200.0, 1.0, 8.0),
        _creep(1100.0, "identify", 200.0, 1.0, 8.0),
        _wave("sine", 1.0, 4.0, "identify", 200.0),
        RecordingPlan("compression.csv", Compression(0.1, speed_m_per_s=1e-3, cycles=2), "identify", 100.0),
        RecordingPlan("relaxation.csv", Relaxation(hold_s=8.0), "identify", 100.0),
        _creep(1000.0, "validate", 200.0, 1.0, 8.0),
        _wave("rectangle", 1.0, 4.0, "validate", 200.0)))


PRESETS = {"quickstart": quickstart, "paper": paper, "mechanical": mechanical, "small": small}

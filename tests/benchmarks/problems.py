"""The recordings that are timed: the virtual bench's creep and waves, in memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import bayes_dea as bd
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave
from bayes_dea.bench.rig import Geometry, Material
from bayes_dea.bench.simulate import simulate as bench_simulate

Array = NDArray[np.float64]
SENSOR = {"displacement": bd.Sensor(4.7e-6, 19.4e-6, 0.15e-6)}
BRANCHES = 3
TRUTH = Material().parameters()


@dataclass(frozen=True)
class Piece:
    """A stretch of the command without a jump or a corner: volts(t) for start <= t <= stop (s)."""

    start: float
    stop: float
    volts: Callable[[float], float]


@dataclass(frozen=True)
class Signal:
    """One command as recorded (rows) and as the continuous function it was (pieces)."""

    name: str
    recording: bd.Recording
    pieces: tuple[Piece, ...]


def actuator() -> bd.Actuator:
    """The reference actuator as the tool knows it."""
    g = Geometry()
    return bd.Actuator(
        g.name,
        g.layers,
        g.layer_thickness_m,
        g.relative_permittivity,
        g.electrode_area_m2,
        g.total_area_m2,
        g.stack_height_m,
        g.layer_mass_kg,
        g.max_voltage_V,
        g.max_frequency_Hz,
    )


def creep(scale: float = 1.0, voltage_V: float = 900.0) -> Creep:
    """The paper's creep protocol of 720 s times `scale`."""
    return Creep(
        voltage_V,
        hold_s=599.0 * scale,
        conditioning_on_s=30.0 * scale,
        conditioning_off_s=30.0 * scale,
        rest_s=1.0 * scale,
    )


def waves(shape: str, scale: float = 1.0) -> tuple[Wave, ...]:
    """0.1, 1 and 10 Hz: 40, 10 and 1.25 s, together 51,250 samples at 1 kHz when scale is 1."""
    if scale < 1:
        return tuple(Wave(shape, f, cycles=1.0, rest_s=0.5 / f * scale, tail_s=0.0) for f in (0.1, 1.0, 10.0))
    return (
        Wave(shape, 0.1, cycles=3.0, rest_s=1.0, tail_s=9.0),
        Wave(shape, 1.0, cycles=8.0, rest_s=1.0, tail_s=1.0),
        Wave(shape, 10.0, cycles=10.0, rest_s=0.25, tail_s=0.0),
    )


def signal(protocol: Creep | Wave, rate_Hz: float = 1000.0) -> Signal:
    """A noise-free recording of `protocol`; a row on an edge reads the command that was in force until then."""
    t = np.arange(round(protocol.duration_s * rate_Hz)) / rate_Hz
    name = f"{protocol.kind} {protocol.frequency_Hz:g} Hz" if isinstance(protocol, Wave) else protocol.kind
    recording = bd.recording_from_arrays(
        name,
        protocol.kind,
        {"time_s": t, "voltage_V": protocol.command(t - 1e-9), "displacement_m": np.zeros(t.size)},
        actuator=actuator(),
    )
    return Signal(name, recording, _pieces(protocol))


def _pieces(protocol: Creep | Wave) -> tuple[Piece, ...]:
    cuts = [0.0, protocol.rest_s]
    if isinstance(protocol, Creep):
        for i in range(protocol.conditioning_steps):
            begin = protocol.rest_s + i * (protocol.conditioning_on_s + protocol.conditioning_off_s)
            cuts += [
                begin,
                begin + protocol.conditioning_on_s,
                begin + protocol.conditioning_on_s + protocol.conditioning_off_s,
            ]
    else:
        period = 1.0 / protocol.frequency_Hz
        corners = {"sine": (), "triangle": (0.25, 0.75), "rectangle": (0.5, 1.0)}[protocol.shape]
        cuts += [protocol.rest_s + (i + c) * period for i in range(int(protocol.cycles)) for c in corners]
        cuts.append(protocol.rest_s + protocol.cycles * period)
    cuts.append(protocol.duration_s)
    edges = np.unique(np.round(cuts, 9))
    edges = edges[edges <= protocol.duration_s + 1e-9]
    return tuple(Piece(float(a), float(b), _volts(protocol, float(a), float(b))) for a, b in pairwise(edges))


def _volts(protocol: Creep | Wave, a: float, b: float) -> Callable[[float], float]:
    inside = np.array([a + 0.25 * (b - a), a + 0.75 * (b - a)])
    low, high = (float(v) for v in protocol.command(inside))
    middle = 0.5 * (a + b)
    if (
        isinstance(protocol, Wave)
        and protocol.shape == "sine"
        and protocol.rest_s <= middle < (protocol.rest_s + protocol.cycles / protocol.frequency_Hz)
    ):
        w, offset, amplitude, t0 = (
            2 * math.pi * protocol.frequency_Hz,
            protocol.offset_V,
            protocol.amplitude_V,
            protocol.rest_s,
        )
        return lambda t: offset + amplitude * math.sin(w * (t - t0))
    slope = (high - low) / (0.5 * (b - a))
    if slope == 0.0:
        return lambda t: low
    return lambda t: low + slope * (t - inside[0])


def noisy_campaign(scale: float = 1.0, seed: int = 3, rate_Hz: float = 1000.0) -> bd.Campaign:
    """One creep and three sine waves of the virtual bench with noise, offsets and gain; 771,250 samples at scale 1."""
    plan = CampaignPlan(
        "benchmark",
        (
            RecordingPlan("creep.csv", creep(scale), "identify", rate_Hz, zeroed=True),
            *(RecordingPlan(f"sine_{w.frequency_Hz:g}Hz.csv", w, "identify", rate_Hz) for w in waves("sine", scale)),
        ),
    )
    return _campaign(plan, seed)


def thirteen_recordings(scale: float = 1.0, seed: int = 3) -> bd.Campaign:
    """Four creeps at 100 Hz and nine waves at 1 kHz, for nonlinear laws."""
    plan = CampaignPlan(
        "thirteen",
        (
            *(
                RecordingPlan(f"creep_{v:.0f}V.csv", creep(scale, v), "identify", 100.0, zeroed=True)
                for v in (300.0, 600.0, 900.0, 1200.0)
            ),
            *(
                RecordingPlan(f"{shape}_{w.frequency_Hz:g}Hz.csv", w, "identify", 1000.0)
                for shape in ("sine", "triangle", "rectangle")
                for w in waves(shape, scale)
            ),
        ),
    )
    return _campaign(plan, seed)


def _campaign(plan: CampaignPlan, seed: int) -> bd.Campaign:
    recordings = [
        bd.recording_from_arrays(
            s.plan.file, s.plan.protocol.kind, s.columns, actuator=actuator(), zeroed=s.plan.zeroed
        )
        for s in bench_simulate(plan, seed)
    ]
    return bd.campaign_from_recordings(recordings, SENSOR, actuator(), name=plan.name)

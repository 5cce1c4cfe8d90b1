"""Carries a plan out: protocol -> rig -> sensors, one recording after the other."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.nuisance import draw_gain, quantise, record
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave, sample_times
from bayes_dea.bench.rig import Rig

Array = NDArray[np.float64]

#: positions of the plates between two rows, so that corners and contact fall where they are
_FINE = 10
#: step of the commanded voltage
_COMMAND_V = 1e-3


@dataclass(frozen=True)
class Simulated:
    """One recording as a recorder would have written it, and what was true of it."""

    plan: RecordingPlan
    columns: dict[str, Array]
    truth: dict[str, Any]


@dataclass(frozen=True)
class _Clean:
    time_s: Array
    command: Array  # voltage in V or true position in m
    answer: Array  # true displacement in m or true force in N
    contact_m: float


def _rng(seed: int, *what: str) -> np.random.Generator:
    """A generator of its own for each thing drawn, whatever else the plan contains."""
    return np.random.default_rng([seed, zlib.crc32("/".join(what).encode())])


def _clean(plan: CampaignPlan, recording: RecordingPlan, seed: int) -> _Clean:
    rng = _rng(seed, "rig", recording.specimen, recording.file)
    geometry = plan.geometry_of(recording)
    rig, protocol = Rig(geometry, plan.material), recording.protocol
    unevenness, rate = plan.faults.clock_unevenness, recording.sampling_Hz
    if isinstance(protocol, Creep | Wave):
        time_s = sample_times(protocol.duration_s, rate, unevenness, rng)
        voltage = quantise(protocol.command(time_s), _COMMAND_V)
        return _Clean(time_s, voltage, rig.drive(time_s, voltage), float("nan"))
    assert isinstance(protocol, Compression | Relaxation)
    contact = float(rng.uniform(*plan.slack_m))
    travel = contact + protocol.strain * geometry.stack_height_m
    time_s = sample_times(protocol.length_s(travel), rate, unevenness, rng)
    rows = np.arange(time_s.size)
    fine = np.interp(np.arange((time_s.size - 1) * _FINE + 1) / _FINE, rows, time_s)
    force = rig.press(fine, protocol.position(fine, travel), contact)[::_FINE]
    return _Clean(time_s, protocol.position(time_s, travel), force, contact)


def _gains(plan: CampaignPlan, seed: int) -> dict[tuple[str, str], float]:
    """Gain errors by (specimen, channel), from the largest signal each channel sees on that specimen."""
    largest: dict[tuple[str, str], float] = {}
    for recording in plan.recordings:
        clean = _clean(plan, recording, seed)
        electric = isinstance(recording.protocol, Creep | Wave)
        seen = {"displacement": clean.answer}
        if not electric:
            seen = {"force": clean.answer, "position": clean.command}
        for channel, signal in seen.items():
            key = (recording.specimen, channel)
            largest[key] = max(largest.get(key, 0.0), float(np.abs(signal).max(initial=0.0)))
    return {key: draw_gain(getattr(plan.sensors, key[1]), value, _rng(seed, "gain", *key))
            for key, value in largest.items()}


def simulate(plan: CampaignPlan, seed: int) -> Iterator[Simulated]:
    """The recordings of `plan`, in its order. The same plan and seed give the same numbers."""
    gains = _gains(plan, seed)
    for recording in plan.recordings:
        clean = _clean(plan, recording, seed)
        truth: dict[str, Any] = {"file": recording.file, "specimen": recording.specimen}

        def read(channel: str, true: Array, *, recording: RecordingPlan = recording, clean: _Clean = clean,
                 truth: dict[str, Any] = truth) -> Array:
            # only the instrument that reads the answer is zeroed; the zero of the plates stays unknown
            zeroed = recording.zeroed and channel != "position"
            rng = _rng(seed, "sensor", channel, recording.specimen, recording.file)
            y, known = record(true, clean.time_s, getattr(plan.sensors, channel),
                              getattr(plan.faults, channel), gains[recording.specimen, channel], zeroed, rng)
            truth[channel] = asdict(known)
            return y

        if isinstance(recording.protocol, Creep | Wave):
            columns = {"time_s": clean.time_s, "voltage_V": clean.command,
                       "displacement_m": read("displacement", clean.answer)}
        else:
            columns = {"time_s": clean.time_s, "position_m": read("position", clean.command),
                       "force_N": read("force", clean.answer)}
            truth["contact_m"] = clean.contact_m
        yield Simulated(recording, columns, truth)

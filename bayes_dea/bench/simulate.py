"""Carries a plan out: protocol -> rig -> sensing -> sensors, one recording after the other."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.nuisance import draw_gain, quantise, record
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave, sample_times
from bayes_dea.bench.rig import Rig
from bayes_dea.bench.sensing import distort

Array = NDArray[np.float64]

#: positions of the plates between two rows, so that corners and contact fall where they are
_FINE = 10
#: step of the commanded voltage, and of the thermometer
_COMMAND_V = 1e-3
_THERMOMETER_K = 0.01
#: rows up to which the answers of all recordings are kept between the two passes over them
_KEEP_ROWS = 3_000_000


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
    answer: Array  # displacement that the sensor is given in m, or true force in N
    contact_m: float
    temperature_C: Array | None = None


def stream(seed: int, *what: str) -> np.random.Generator:
    """A generator of its own for each thing drawn, whatever else the plan contains."""
    return np.random.default_rng([seed, zlib.crc32("/".join(what).encode())])


def room_temperature(time_s: Array, mean_C: float, swing_K: float, rng: np.random.Generator) -> Array:
    """Temperature (n,) of a room in deg C: two slow waves of 100 to 1000 s, within +- `swing_K` of the mean."""
    course = np.zeros(time_s.size)
    for share in (0.7, 0.3):
        period = np.exp(rng.uniform(np.log(100.0), np.log(1000.0)))
        course += share * np.sin(2.0 * np.pi * (time_s / period + rng.random()))
    return mean_C + swing_K * course


def stiffness_of(plan: CampaignPlan, recording: RecordingPlan) -> tuple[float, float, float]:
    """Factors on the stiffness before and after a moment in s: a module that is lost stays lost."""
    if "module_lost" not in plan.effects:
        return 1.0, 1.0, np.inf
    p = plan.effects["module_lost"]
    place, when = plan.recordings.index(recording), round(p["recording"])
    after = p["stiffness_factor"]
    if place != when:
        return (1.0, 1.0, np.inf) if place < when else (after, after, np.inf)
    protocol = recording.protocol
    length = (protocol.duration_s if isinstance(protocol, Creep | Wave)
              else protocol.length_s(protocol.strain * plan.geometry_of(recording).stack_height_m))
    return 1.0, after, p["after_part"] * length


def rig_of(plan: CampaignPlan, recording: RecordingPlan) -> Rig:
    """The actuator that `recording` is taken on."""
    return Rig(plan.geometry_of(recording), plan.material, plan.effects, stiffness_of(plan, recording))


def _clean(plan: CampaignPlan, recording: RecordingPlan, seed: int) -> _Clean:
    rng = stream(seed, "rig", recording.specimen, recording.file)
    geometry = plan.geometry_of(recording)
    rig, protocol = rig_of(plan, recording), recording.protocol
    unevenness, rate = plan.faults.clock_unevenness, recording.sampling_Hz
    if isinstance(protocol, Creep | Wave):
        time_s = sample_times(protocol.duration_s, rate, unevenness, rng)
        voltage = quantise(protocol.command(time_s), _COMMAND_V)
        temperature = None
        if plan.swing_K > 0.0:
            room = stream(seed, "room", recording.specimen, recording.file)
            temperature = quantise(room_temperature(time_s, plan.temperature_C, plan.swing_K, room), _THERMOMETER_K)
        seen = distort(time_s, rig.drive(time_s, voltage), voltage, temperature, plan.effects,
                       stream(seed, "sensing", recording.specimen, recording.file), plan.faults.displacement_late_s)
        return _Clean(time_s, voltage, seen, float("nan"), temperature)
    assert isinstance(protocol, Compression | Relaxation)
    contact = float(rng.uniform(*plan.slack_m))
    travel = contact + protocol.strain * geometry.stack_height_m
    time_s = sample_times(protocol.length_s(travel), rate, unevenness, rng)
    rows = np.arange(time_s.size)
    fine = np.interp(np.arange((time_s.size - 1) * _FINE + 1) / _FINE, rows, time_s)
    force = rig.press(fine, protocol.position(fine, travel), contact)[::_FINE]
    return _Clean(time_s, protocol.position(time_s, travel), force, contact)


def _rows(plan: CampaignPlan) -> float:
    total = 0.0
    for recording in plan.recordings:
        protocol = recording.protocol
        seconds = (protocol.duration_s if isinstance(protocol, Creep | Wave)
                   else protocol.length_s(plan.slack_m[1] + protocol.strain * plan.geometry.stack_height_m))
        total += seconds * recording.sampling_Hz
    return total


def _gains(plan: CampaignPlan, cleans: Iterator[_Clean], seed: int) -> dict[tuple[str, str], float]:
    """Gain errors by (specimen, channel), from the largest signal each channel sees on that specimen."""
    largest: dict[tuple[str, str], float] = {}
    for recording, clean in zip(plan.recordings, cleans, strict=True):
        electric = isinstance(recording.protocol, Creep | Wave)
        seen = {"displacement": clean.answer}
        if not electric:
            seen = {"force": clean.answer, "position": clean.command}
        for channel, signal in seen.items():
            key = (recording.specimen, channel)
            largest[key] = max(largest.get(key, 0.0), float(np.abs(signal).max(initial=0.0)))
    return {key: draw_gain(getattr(plan.sensors, key[1]), value, stream(seed, "gain", *key))
            for key, value in largest.items()}


def simulate(plan: CampaignPlan, seed: int) -> Iterator[Simulated]:
    """The recordings of `plan`, in its order. The same plan and seed give the same numbers."""
    def cleans() -> Iterator[_Clean]:
        return (_clean(plan, recording, seed) for recording in plan.recordings)

    kept = list(cleans()) if _rows(plan) <= _KEEP_ROWS else None
    gains = _gains(plan, cleans() if kept is None else iter(kept), seed)
    faults = plan.faults
    if "mains_pickup" in plan.effects:
        p = plan.effects["mains_pickup"]
        laser = replace(faults.displacement, mains_amplitude=p["mains_m"], mains_frequency_Hz=p["mains_Hz"])
        faults = replace(faults, displacement=laser)
    clipping = plan.effects.get("sensor_clipping", {"y_max_m": np.inf, "clip_noise": 1.0})
    for recording, clean in zip(plan.recordings, cleans() if kept is None else kept, strict=True):
        truth: dict[str, Any] = {"file": recording.file, "specimen": recording.specimen}

        def read(channel: str, true: Array, *, recording: RecordingPlan = recording, clean: _Clean = clean,
                 truth: dict[str, Any] = truth) -> Array:
            # only the instrument that reads the answer is zeroed; the zero of the plates stays unknown
            zeroed = recording.zeroed and channel != "position"
            rng = stream(seed, "sensor", channel, recording.specimen, recording.file)
            highest = clipping["y_max_m"] if channel == "displacement" else np.inf
            if clipping["clip_noise"] == 0.0:
                true, highest = np.minimum(true, highest), np.inf
            y, known = record(true, clean.time_s, getattr(plan.sensors, channel), getattr(faults, channel),
                              gains[recording.specimen, channel], zeroed, rng, highest)
            truth[channel] = asdict(known)
            return y

        if isinstance(recording.protocol, Creep | Wave):
            columns = {"time_s": clean.time_s, "voltage_V": clean.command,
                       "displacement_m": read("displacement", clean.answer)}
            if clean.temperature_C is not None:
                columns["temperature_C"] = clean.temperature_C
        else:
            columns = {"time_s": clean.time_s, "position_m": read("position", clean.command),
                       "force_N": read("force", clean.answer)}
            truth["contact_m"] = clean.contact_m
        yield Simulated(recording, columns, truth)

"""Recordings as they are written: with gain, offset, noise, drop-outs and the sensor's steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from .draw import Case
from .recordings import Array, PressRecording, Recording, VoltageRecording
from .sheets import FORCE_ACCURACY_N, FORCE_FLUCTUATION_N, POSITION_FLUCTUATION_M, RESOLUTION_M

_THERMOMETER_K = 0.002
#: what is off by a drop-out
_SPIKE_M = (10e-6, 500e-6)


@dataclass(frozen=True, eq=False)
class Column:
    """Values (n,) of a column, and how they are printed."""

    name: str
    form: str
    values: Array


@dataclass(frozen=True, eq=False)
class Observed:
    """A recording with its columns; offset in the unit of what is measured."""

    recording: Recording
    columns: list[Column]
    offset: float


def correlated(white: Array, rho: float) -> Array:
    """White noise (n,) made AR(1), the variance kept; it begins as if it had always gone on."""
    if rho == 0:
        return white
    return np.asarray(lfilter([math.sqrt(1 - rho * rho)], [1, -rho], white, zi=[rho * white[0]])[0])


def _displacement(case: Case, rec: VoltageRecording, steps: int, rng: np.random.Generator) -> list[Column]:
    noise = case.noise
    y = case.specimen.voltage(rec, case.effects, steps, bool(noise.clip_last)) * noise.gain
    y = y + rec.offset_m + noise.sigma_m * correlated(rng.standard_normal(y.size), noise.rho)
    if noise.spikes > 0:
        rows = np.flatnonzero(rng.uniform(size=y.size) < noise.spikes)
        sizes = np.exp(rng.uniform(np.log(_SPIKE_M[0]), np.log(_SPIKE_M[1]), rows.size))
        y[rows] += sizes * rng.choice([-1, 1], rows.size)
    if noise.clip_last:
        y = np.minimum(y, case.effects["sensor_clipping"]["max_m"])
    y = np.round(y / RESOLUTION_M) * RESOLUTION_M
    columns = [
        Column("time_s", "%.3f", rec.time_s),
        Column("voltage_V", "%.3f", rec.voltage_V),
        Column("displacement_m", "%.8f", y),
    ]
    if case.temperature_column:
        read = np.round(rec.temperature_C + rng.normal(0, _THERMOMETER_K, y.size), 3)
        columns.append(Column("temperature_C", "%.3f", read))
    return columns


def _force(case: Case, rec: PressRecording, rng: np.random.Generator) -> tuple[list[Column], float]:
    noise = case.noise
    force = case.specimen.press_force(rec.strain, rec.step_s, case.effects)
    offset = float(rng.uniform(-FORCE_ACCURACY_N, FORCE_ACCURACY_N))
    scatter = FORCE_FLUCTUATION_N * noise.sigma_force_factor * rng.standard_normal(force.size)
    force = force * noise.gain_force + offset + scatter
    position = rec.position_m * noise.gain_position + POSITION_FLUCTUATION_M * rng.standard_normal(force.size)
    columns = [
        Column("time_s", "%.2f", rec.time_s),
        Column("position_m", "%.8f", position),
        Column("force_N", "%.5f", force),
    ]
    return columns, offset


def observe(case: Case, steps: int) -> list[Observed]:
    """Every recording of a case, simulated with `steps` internal steps a row."""
    rng = np.random.default_rng(case.noise.seed)
    out = [Observed(r, _displacement(case, r, steps, rng), r.offset_m) for r in case.recordings]
    return out + [Observed(r, *_force(case, r, rng)) for r in case.presses]

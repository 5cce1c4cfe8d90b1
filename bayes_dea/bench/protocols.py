"""The experiments of the reference paper as command signals: creep, waves, compression, relaxation.

Commands are functions of time; an edge at time t acts on rows with time >= t. Each begins with a quiet
stretch, because the noise is read from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.rig import check_positive
from bayes_dea.errors import InputError

Array = NDArray[np.float64]

#: edges and time stamps are compared on this grid, so that 0.1 + 0.2 s is 0.3 s
_TICK_S = 1e-9
WAVE_SHAPES = ("sine", "triangle", "rectangle")


def _since(time_s: Array, start_s: float) -> Array:
    """Time since `start_s`, rounded to whole nanoseconds."""
    return np.round((time_s - start_s) / _TICK_S) * _TICK_S


@dataclass(frozen=True)
class Creep:
    """Conditioning steps with pauses, then one long hold, all at one voltage."""

    voltage_V: float
    hold_s: float = 600.0
    conditioning_steps: int = 2
    conditioning_on_s: float = 30.0
    conditioning_off_s: float = 30.0
    rest_s: float = 1.0

    def __post_init__(self) -> None:
        check_positive("creep protocol", voltage_V=self.voltage_V, hold_s=self.hold_s)
        if self.conditioning_steps:
            check_positive("creep protocol", conditioning_steps=self.conditioning_steps,
                           conditioning_on_s=self.conditioning_on_s,
                           conditioning_off_s=self.conditioning_off_s)

    @property
    def kind(self) -> str:
        """Kind of recording (CONTRACT 1)."""
        return "creep"

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return (self.rest_s + self.conditioning_steps * (self.conditioning_on_s + self.conditioning_off_s)
                + self.hold_s)

    @property
    def largest_V(self) -> float:
        """Largest magnitude of the command."""
        return abs(self.voltage_V)

    def command(self, time_s: Array) -> Array:
        """Voltage (n,) in V at `time_s` (n,)."""
        t = _since(time_s, self.rest_s)
        period = self.conditioning_on_s + self.conditioning_off_s
        conditioning = self.conditioning_steps * period
        on = t >= conditioning - 0.5 * _TICK_S
        if self.conditioning_steps:
            within = _since(t, 0.0) - period * np.floor(t / period + 1e-12)
            on |= (t >= 0.0) & (within < self.conditioning_on_s - 0.5 * _TICK_S)
        return np.where(on, self.voltage_V, 0.0)


@dataclass(frozen=True)
class Wave:
    """Sine, triangle or rectangle around an offset; 0 V before and after.

    Sine and triangle begin at the offset and rise; the rectangle begins high.
    """

    shape: str
    frequency_Hz: float
    offset_V: float = 650.0
    amplitude_V: float = 400.0
    cycles: float = 10.0
    rest_s: float = 0.5
    tail_s: float = 0.5

    def __post_init__(self) -> None:
        if self.shape not in WAVE_SHAPES:
            raise InputError(f"wave protocol: shape {self.shape!r} is unknown; "
                             f"use one of {', '.join(WAVE_SHAPES)}")
        check_positive("wave protocol", frequency_Hz=self.frequency_Hz, cycles=self.cycles)

    @property
    def kind(self) -> str:
        """Kind of recording (CONTRACT 1)."""
        return self.shape

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return self.rest_s + self.cycles / self.frequency_Hz + self.tail_s

    @property
    def largest_V(self) -> float:
        """Largest magnitude of the command."""
        return abs(self.offset_V) + abs(self.amplitude_V)

    def command(self, time_s: Array) -> Array:
        """Voltage (n,) in V at `time_s` (n,)."""
        t = _since(time_s, self.rest_s)
        # a phase on a fine grid keeps edges on their sample when period and step do not divide in binary
        phase = np.round(t * self.frequency_Hz, 9)
        if self.shape == "sine":
            wave = np.sin(2.0 * np.pi * phase)
        elif self.shape == "triangle":
            wave = 1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5)
        else:
            wave = np.where(phase % 1.0 < 0.5, 1.0, -1.0)
        running = (t >= 0.0) & (phase < self.cycles - 1e-9)
        return np.where(running, self.offset_V + self.amplitude_V * wave, 0.0)


@dataclass(frozen=True)
class Compression:
    """Slow cycles between plates: from the start past contact to `strain` and back at constant speed."""

    strain: float = 0.20
    speed_m_per_s: float = 1e-5
    cycles: int = 3
    rest_s: float = 1.0

    def __post_init__(self) -> None:
        check_positive("compression protocol", strain=self.strain, speed_m_per_s=self.speed_m_per_s,
                       cycles=self.cycles)

    @property
    def kind(self) -> str:
        """Kind of recording (CONTRACT 1)."""
        return "compression"

    def length_s(self, travel_m: float) -> float:
        """Length in s when one stroke is `travel_m` long."""
        return self.rest_s + 2.0 * self.cycles * travel_m / self.speed_m_per_s

    def position(self, time_s: Array, travel_m: float) -> Array:
        """Position (n,) in m of the plate at `time_s` (n,)."""
        stroke_s = travel_m / self.speed_m_per_s
        t = np.clip(time_s - self.rest_s, 0.0, 2.0 * self.cycles * stroke_s)
        return travel_m - self.speed_m_per_s * np.abs(t % (2.0 * stroke_s) - stroke_s)


@dataclass(frozen=True)
class Relaxation:
    """One fast stroke between plates to `strain`, then held."""

    strain: float = 0.15
    speed_m_per_s: float = 5e-3
    hold_s: float = 300.0
    rest_s: float = 1.0

    def __post_init__(self) -> None:
        check_positive("relaxation protocol", strain=self.strain, speed_m_per_s=self.speed_m_per_s,
                       hold_s=self.hold_s)

    @property
    def kind(self) -> str:
        """Kind of recording (CONTRACT 1)."""
        return "relaxation"

    def length_s(self, travel_m: float) -> float:
        """Length in s when the stroke is `travel_m` long."""
        return self.rest_s + travel_m / self.speed_m_per_s + self.hold_s

    def position(self, time_s: Array, travel_m: float) -> Array:
        """Position (n,) in m of the plate at `time_s` (n,)."""
        return np.clip((time_s - self.rest_s) * self.speed_m_per_s, 0.0, travel_m)


VoltageProtocol = Creep | Wave
MechanicalProtocol = Compression | Relaxation
Protocol = VoltageProtocol | MechanicalProtocol


def sample_times(duration_s: float, sampling_Hz: float, unevenness: float,
                 rng: np.random.Generator) -> Array:
    """Time stamps (n,) in s from 0; each is off by up to +- half of `unevenness` (0 to below 1) steps."""
    check_positive("sampling of the bench", sampling_Hz=sampling_Hz, duration_s=duration_s)
    if not 0.0 <= unevenness < 1.0:
        raise InputError(f"sampling of the bench: clock unevenness is {unevenness}; give a part of a step, "
                         "from 0 to below 1, so that time keeps rising")
    count = np.arange(int(np.floor(duration_s * sampling_Hz + 1e-6)), dtype=float)
    if unevenness == 0.0:
        return count / sampling_Hz
    count[1:] += unevenness * rng.uniform(-0.5, 0.5, count.size - 1)
    # stamps are written with a nanosecond; what is simulated is what is written
    return np.round(count / sampling_Hz, 9)

"""What the device can play by itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.protocols import Creep, Wave

Array = NDArray[np.float64]


class Programme(Protocol):
    """A command as a function of the time since its start."""

    @property
    def duration_s(self) -> float:
        """Length in s."""

    @property
    def largest_V(self) -> float:
        """Largest magnitude."""

    def command(self, time_s: Array) -> Array:
        """Voltage (n,) in V at `time_s` (n,)."""


@dataclass(frozen=True)
class Series:
    """Programmes one after the other."""

    parts: tuple[Programme, ...]

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return sum(p.duration_s for p in self.parts)

    @property
    def largest_V(self) -> float:
        """Largest magnitude of the command."""
        return max(p.largest_V for p in self.parts)

    def command(self, time_s: Array) -> Array:
        """Voltage (n,) in V at `time_s` (n,)."""
        out = np.zeros(time_s.size)
        start = 0.0
        for part in self.parts:
            inside = (time_s >= start) & (time_s < start + part.duration_s)
            if inside.any():
                out[inside] = part.command(time_s[inside] - start)
            start += part.duration_s
        return out


def built_in() -> dict[str, Programme]:
    """Programmes by the name that `PLAY` takes."""
    def steps(voltage_V: float, hold_s: float) -> Creep:
        return Creep(voltage_V, hold_s, conditioning_steps=1, conditioning_on_s=2.0, conditioning_off_s=2.0)

    out: dict[str, Programme] = {
        "demo": Series((steps(600.0, 10.0), Wave("sine", 1.0, cycles=10.0), steps(1000.0, 10.0),
                        Wave("rectangle", 0.5, cycles=5.0))),
        "short": Series((steps(1000.0, 3.0), Wave("sine", 1.0, cycles=4.0))),
    }
    for shape, frequency, cycles in (("sine", 0.1, 3.0), ("sine", 1.0, 10.0), ("sine", 10.0, 50.0),
                                     ("triangle", 0.1, 3.0), ("triangle", 1.0, 10.0),
                                     ("rectangle", 0.1, 3.0), ("rectangle", 1.0, 10.0), ("rectangle", 10.0, 50.0)):
        out[f"{shape}_{frequency:g}Hz"] = Wave(shape, frequency, cycles=cycles)
    for voltage in range(100, 1300, 100):
        out[f"creep_{voltage:04d}V"] = Creep(float(voltage), 600.0)
    return out

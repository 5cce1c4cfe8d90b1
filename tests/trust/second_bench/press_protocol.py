"""Draws the travels of the press: a compression and a relaxation."""

from __future__ import annotations

import numpy as np

from .protocol import FULL, ProtocolSettings
from .recordings import PressRecording

_RATE = 100  # rows a second


def _ramp(
    rng: np.random.Generator, height_m: float, slack_m: float, settings: ProtocolSettings
) -> tuple[list[float], list[float]]:
    """Times s and positions m of the corners of a relaxation."""
    position = float(rng.uniform(0.08, 0.15)) * height_m + slack_m
    ramp = float(rng.uniform(0.1, 0.5))
    shortest, longest = settings.hold_s
    hold = float(rng.integers(shortest, longest + 1))
    return [0, 1.0, 1 + ramp, 1 + ramp + hold], [0, 0, position, position]


def _cycles(top_m: float, half_s: float, cycles: int) -> tuple[list[float], list[float]]:
    """Times s and positions m of the corners of a compression."""
    times: list[float] = [0, 1.0]
    positions: list[float] = [0, 0]
    for _ in range(cycles):
        times += [times[-1] + half_s, times[-1] + 2 * half_s]
        positions += [top_m, 0]
    return [*times, times[-1] + 1], [*positions, 0]


def draw_press(rng: np.random.Generator, height_m: float, settings: ProtocolSettings = FULL) -> list[PressRecording]:
    """A compression of one to three cycles and a relaxation of a stack of height_m; the plate begins above it."""
    top = float(rng.uniform(0.12, 0.20))
    half = float(rng.uniform(5, 20))
    cycles = int(rng.integers(1, 4))
    out = []
    for kind in ("compression", "relaxation"):
        slack = float(rng.uniform(0, 0.3e-3))
        if kind == "compression":
            times, positions = _cycles(top * height_m + slack, half, cycles)
            role = "identify" if rng.uniform() < 0.7 else "validate"
        else:
            times, positions = _ramp(rng, height_m, slack, settings)
            role = "identify"
        time_s = np.arange(round(times[-1] * _RATE) + 1) * 0.01
        position_m = np.interp(time_s, times, positions)
        strain = (position_m - slack) / height_m
        out.append(PressRecording(f"{kind}.csv", kind, role, time_s, position_m, strain, slack))
    return out

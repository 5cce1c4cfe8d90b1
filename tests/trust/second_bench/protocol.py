"""Draws the commands of the voltage recordings: four creep steps and nine waves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .draws import log_uniform
from .recordings import Array, VoltageRecording

#: rows a second
_RATE = 1000
_CREEPS, _WAVES = 4, 9


@dataclass(frozen=True)
class ProtocolSettings:
    """How long things take: holds of creep steps and of a relaxation from, to; rests after a hold; longest wave."""

    hold_s: tuple[int, int] = (60, 300)
    recovery_s: tuple[int, ...] = (0, 0, 20, 60)
    longest_wave_s: float = 50.0


FULL = ProtocolSettings()
#: seconds instead of minutes: to try things out, too short for a study
SHORT = ProtocolSettings(hold_s=(4, 9), recovery_s=(0, 0, 1, 2), longest_wave_s=2.0)


def _steps(rng: np.random.Generator) -> Array:
    """Four different voltages (4,) V, lowest first."""
    low = rng.uniform(300, 600)
    high = rng.uniform(950, 1200)
    steps = np.round(np.sort(np.r_[low, high, rng.uniform(low, high, 2)]) / 10) * 10
    for i in range(1, _CREEPS):
        if steps[i] - steps[i - 1] < 40:
            steps[i] = min(1200, steps[i - 1] + 40)
    return steps


def _creeps(rng: np.random.Generator, settings: ProtocolSettings) -> list[tuple[str, str, Array]]:
    """File, kind and command of every creep step."""
    voltages = _steps(rng)
    shortest, longest = settings.hold_s
    hold = float(rng.integers(shortest, longest + 1))
    recovery = float(rng.choice(settings.recovery_s))
    all_alike = rng.uniform() < 0.6
    out = []
    for voltage in voltages:
        rest = float(rng.integers(1, 6))
        held = hold if all_alike else float(rng.integers(shortest, longest + 1))
        command = np.concatenate(
            [
                np.zeros(int(rest * _RATE) + 1),
                np.full(int(held * _RATE), voltage),
                np.zeros(int(recovery * _RATE)),
            ]
        )
        out.append((f"creep_{int(voltage):04d}V.csv", "creep", command))
    return out


def _shape(name: str, phase: Array, step: float) -> Array:
    """A wave (n,) between -1 and 1 at phases (n,) in periods; step: the phase of one row."""
    if name == "sine":
        return np.asarray(np.sin(2 * np.pi * phase))
    if name == "triangle":
        return np.asarray(1 - 4 * np.abs((phase + 1e-12) % 1 - 0.5))
    return np.where((phase - step + 1e-9) % 1 < 0.5, 1.0, -1.0)


def _waves(rng: np.random.Generator, settings: ProtocolSettings) -> list[tuple[str, str, Array]]:
    """File, kind and command of every wave; one mean, one amplitude and one rest before are common to all."""
    usual_frequencies = rng.uniform() < 0.5
    mean, amplitude = 650.0, 400.0
    if rng.uniform() < 0.3:
        mean = float(rng.integers(550, 701))
        amplitude = float(rng.integers(250, 401))
    rest = float(rng.choice([0.0, 0.5, 1.0]))
    out = []
    for shape in ("sine", "triangle", "rectangle"):
        for decade in range(3):
            # all three are drawn whichever is used: the seeds of written campaigns count on it
            frequencies = [0.1, 1.0, 10.0]
            if not usual_frequencies:
                frequencies = [log_uniform(rng, 0.1, 0.4), log_uniform(rng, 0.5, 3), log_uniform(rng, 4, 10)]
            frequency = round(frequencies[decade], 2)
            periods = [rng.integers(2, 6), rng.integers(5, 21), rng.integers(10, 101)][decade]
            duration = min(settings.longest_wave_s, periods / frequency)
            time_s = np.arange(1, int(duration * _RATE) + 1) * 1e-3
            wave = mean + amplitude * _shape(shape, frequency * time_s, 1e-3 * frequency)
            command = np.concatenate([np.zeros(int(rest * _RATE) + 1), wave])
            out.append((f"{shape}_{frequency:g}Hz.csv", shape, command))
    return out


def _roles(rng: np.random.Generator) -> list[str]:
    """Roles of the creep steps and the waves; at least one wave is there to validate."""
    roles = np.array(["identify"] * (_CREEPS + _WAVES), dtype=object)
    creeps = int(rng.integers(0, 4))
    roles[rng.choice(_CREEPS, creeps, replace=False)] = "validate"
    waves = int(rng.integers(1 if creeps else 2, 7))
    roles[_CREEPS + rng.choice(_WAVES, waves, replace=False)] = "validate"
    return [str(role) for role in roles]


def draw_protocol(rng: np.random.Generator, settings: ProtocolSettings = FULL) -> list[VoltageRecording]:
    """Creep steps and waves with their roles, in the order in which they are written; the room is at 0 degC yet."""
    commands = _creeps(rng, settings) + _waves(rng, settings)
    out = []
    for i, ((file, kind, command), role) in enumerate(zip(commands, _roles(rng), strict=True)):
        voltage_V = np.round(command, 3)
        voltage_V[0] = 0.0
        time_s = np.arange(voltage_V.size) * 1e-3
        out.append(VoltageRecording(file, kind, role, i, time_s, voltage_V, np.zeros(time_s.size)))
    order = rng.permutation(len(out)) if rng.uniform() < 0.3 else np.arange(len(out))
    return [out[i] for i in order]

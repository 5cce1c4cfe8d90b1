"""Draws a campaign: actuator, protocol, noise, what is concealed and how strongly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .actuator import Actuator, Material
from .draws import log_uniform
from .names import check_kind, draw_names, truth_of
from .press_protocol import draw_press
from .priors import Around
from .protocol import FULL, ProtocolSettings, draw_protocol
from .recordings import Array, Effects, PressRecording, VoltageRecording
from .sheets import ACCURACY_M, FLUCTUATION_M, RESOLUTION_M
from .sizing import Run, Sizer
from .specimen import Specimen
from .strengths import DroppedError, allowed, find_strength, most_steps

#: beside the seed of a campaign, so that no other program draws the same
_STREAM = 20240617
_ATTEMPTS = 60
_COARSE, _FINE = 3, 12
#: what rings or jumps needs finer steps while its strength is sought
_QUICK = ("inertia", "amp_ringing", "quadratic_damper")


class NoStrengthError(Exception):
    """Nothing that was drawn could be given a size within the limits; the message is one line."""


@dataclass(frozen=True)
class Noise:
    """Scatter, gains and drop-outs of a campaign; clip_last is None where no sensor has a limit."""

    sigma_factor: float
    rho: float
    gain: float
    gain_force: float
    gain_position: float
    spikes: float
    sigma_force_factor: float
    sigma_m: float
    seed: int
    clip_last: bool | None = None


@dataclass(frozen=True)
class Size:
    """How large a concealed effect is on the recording that it shows in most."""

    crude_m: float
    refit_m: float
    on: str
    crude_steps: float
    refit_steps: float


@dataclass(frozen=True, eq=False)
class Case:
    """A drawn campaign. redrawn: why earlier draws of what is concealed were dropped."""

    seed: int
    kind: str
    specimen: Specimen
    recordings: list[VoltageRecording]
    presses: list[PressRecording]
    noise: Noise
    effects: Effects
    truth: str
    sizes: dict[str, Size]
    temperature_column: bool
    redrawn: list[str]


def _actuator(rng: np.random.Generator) -> Actuator:
    base = Actuator()
    name = f"specimen-{rng.integers(10000):04d}"
    layers = int(rng.choice([399, 399, 399, 380, 420]))
    return replace(
        base,
        name=name,
        layers=layers,
        relative_permittivity=round(float(rng.uniform(2.6, 3.0)), 2),
        electrode_area_m2=round(base.electrode_area_m2 * float(rng.uniform(0.95, 1.05)), 9),
        total_area_m2=round(base.total_area_m2 * float(rng.uniform(0.97, 1.03)), 9),
        stack_height_m=round(layers * 25.72e-6 * float(rng.uniform(0.99, 1.015)), 6),
    )


def _material(rng: np.random.Generator) -> Material:
    Y = log_uniform(rng, 0.8e6, 1.8e6)
    k = tuple(Y * log_uniform(rng, 0.03, 0.10) for _ in range(3))
    return Material(Y, k, (log_uniform(rng, 100, 600), log_uniform(rng, 8, 40), log_uniform(rng, 0.5, 2)))


def _noise(rng: np.random.Generator) -> Noise:
    factor = log_uniform(rng, 0.5, 2.0)
    return Noise(
        sigma_factor=factor,
        rho=float(rng.uniform(0.2, 0.8)) if rng.uniform() < 0.5 else 0.0,
        gain=float(rng.uniform(0.99, 1.01)),
        gain_force=float(rng.uniform(0.99, 1.01)),
        gain_position=float(rng.uniform(0.999, 1.001)),
        spikes=log_uniform(rng, 1e-4, 1e-3) if rng.uniform() < 0.25 else 0.0,
        sigma_force_factor=log_uniform(rng, 0.5, 1.5),
        sigma_m=FLUCTUATION_M * factor,
        seed=int(rng.integers(1 << 40)),
    )


@dataclass(frozen=True)
class _Room:
    """A room's temperature: a slow sinusoid mixed with a random walk."""

    amplitude_K: float
    period_s: float
    phase: float
    mix: float
    seed: int
    mean_C: float

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> _Room:
        return cls(
            log_uniform(rng, 0.2, 2.0),
            log_uniform(rng, 30, 600),
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0, 1),
            int(rng.integers(1 << 30)),
            float(rng.uniform(20, 24)),
        )

    def temperature_C(self, time_s: Array) -> Array:
        """(n,) degC at times (n,) s; the walk has a step each ten seconds."""
        grid = np.arange(int(time_s[-1] // 10) + 2) * 10.0
        steps = np.random.default_rng(self.seed).standard_normal(grid.size)
        walk = np.interp(time_s, grid, np.cumsum(steps) * 0.25)
        wave = self.mix * np.sin(2 * np.pi * time_s / self.period_s + self.phase)
        walked = (1 - self.mix) * walk / max(1.0, np.abs(walk).max())
        return np.asarray(np.round(self.mean_C + self.amplitude_K * (wave + walked), 3))


def _without(name: str, effects: Effects) -> Effects:
    """What is left when one of the effects is taken away; a leak leaves the resistance that it acts through."""
    out = {n: q for n, q in effects.items() if n != name}
    if name == "leakage" and "series_resistance" not in effects:
        out["series_resistance"] = {"R_s_ohm": effects[name]["R_s_ohm"]}
    if name == "series_resistance" and "leakage" in effects:
        out["leakage"] = {**effects["leakage"], "R_s_ohm": 1e5}
    return out


def _strong_enough(name: str, effects: Effects, sizer: Sizer, run: Run) -> Size:
    """The size of one of the effects beside the others; DroppedError where it is none that may be."""
    sizes = sizer.sizes(effects, _without(name, effects), run)
    crude, refit = float(sizes.crude_m.max()), float(sizes.refit_m.max())
    if not allowed(crude, refit, most_steps(name, list(effects))):
        raise DroppedError(f"{name} beside the other: {crude / RESOLUTION_M:.2f}")
    on = sizer.recordings[int(sizes.crude_m.argmax())].file
    return Size(crude, refit, on, crude / RESOLUTION_M, refit / RESOLUTION_M)


def _effects(
    rng: np.random.Generator, names: list[str], around: Around, sizer: Sizer, run: Run
) -> tuple[Effects, dict[str, Size]]:
    """Parameters of the named effects, of sizes that are drawn, and what those sizes are."""
    effects: Effects = {}
    for name in names:
        target = RESOLUTION_M * log_uniform(rng, 1.3, 180) * most_steps(name, names) / 200
        # a leak is sized behind the resistance that it acts through, everything else alone
        behind = {n: effects[n] for n in ("series_resistance",) if name == "leakage" and n in effects}
        effects[name] = find_strength(rng, name, around, sizer, run, behind, target)
    return effects, {name: _strong_enough(name, effects, sizer, run) for name in names}


def draw(seed: int, kind: str, settings: ProtocolSettings = FULL) -> Case:
    """A whole campaign; kind is none, single, pair, unknown, or names joined by +.

    The order of the draws is part of what a seed means: campaigns that were judged are found again by it.
    """
    check_kind(kind)
    rng = np.random.default_rng([_STREAM, int(seed)])
    actuator = _actuator(rng)
    specimen = Specimen(actuator, _material(rng))
    recordings = draw_protocol(rng, settings)
    presses = draw_press(rng, actuator.stack_height_m, settings) if rng.uniform() < 0.3 else []
    noise = _noise(rng)
    offsets = [float(rng.uniform(-ACCURACY_M, ACCURACY_M)) for _ in recordings]
    share = float(rng.uniform(0.6, 0.95))
    temperature_column = rng.uniform() < 0.25
    rooms = [_Room.drawn(rng) for _ in recordings]
    rng.uniform()  # not used, but what follows counts on it
    recordings = [
        replace(r, offset_m=offset, gain=noise.gain, temperature_C=room.temperature_C(r.time_s))
        for r, offset, room in zip(recordings, offsets, rooms, strict=True)
    ]
    sizer = Sizer(specimen, recordings)
    around = Around(
        layer_m=actuator.layer_thickness_m,
        Y_Pa=specimen.material.Y_Pa,
        most_V=max(r.voltage_V.max() for r in recordings),
        most_m=max(y.max() for y in sizer.simulated({}, Run())),
        most_s=max(r.time_s[-1] for r in recordings),
        share=share,
    )
    dropped: list[str] = []
    for _ in range(_ATTEMPTS):
        names = draw_names(rng, kind)
        # half of the sensors limit the analogue signal with all that is on it, half before tare and noise
        clip_last = bool(rng.uniform() < 0.5)
        clipped = "sensor_clipping" in names
        run = Run(_FINE if any(n in names for n in _QUICK) else _COARSE, clip_last and clipped)
        try:
            effects, sizes = _effects(rng, names, replace(around, names=tuple(names)), sizer, run)
        except DroppedError as why:
            dropped.append(str(why))
            continue
        return Case(
            seed=int(seed),
            kind=kind,
            specimen=specimen,
            recordings=recordings,
            presses=presses,
            noise=replace(noise, clip_last=clip_last if clipped else None),
            effects=effects,
            truth=truth_of(names),
            sizes=sizes,
            temperature_column=bool(temperature_column or "thermal_expansion" in names),
            redrawn=dropped,
        )
    raise NoStrengthError(f"--kind {kind}, --seed {seed}: no strength was found; the last draws: {dropped[-3:]}")

"""Campaigns with something left out, drawn at random: what a diagnosis has to find, and how sure it may be.

`draw_case` draws actuator, protocols, roles, noise and what acts beside the plain model; `case_campaign` carries the
case out in memory, `write_case` as a folder with the truth in a file outside of it. Nothing that a campaign says of
itself depends on what was concealed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.effects import ALL, DISTURBANCES, EFFECTS, Effects, truth_name
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import WAVE_SHAPES, Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Geometry, Material
from bayes_dea.bench.simulate import simulate
from bayes_dea.bench.sizes import Probe, Size
from bayes_dea.bench.strengths import Context, Strength, draw_strength
from bayes_dea.errors import InputError

#: shares of the kinds of cases where none is asked for
SHARES = {"none": 0.25, "single": 0.5, "unknown": 0.15, "pair": 0.1}
#: sizes that are aimed at, in resolution steps: barely above one step to strong
TARGET_STEPS = {"single": (1.3, 200.0), "pair": (5.0, 200.0), "unknown": (5.0, 200.0)}
#: elements of friction: a distribution of yield strains is filled by few or by many, and no one knows by how many
FRICTION, ELEMENTS = "rate_independent_hysteresis", (8, 128)
#: share of the campaigns whose waves begin after little rest, and that rest in s; and of those with a press in which
#: sizes are those of the voltage recordings: a law may do far more in a press, which goes through five times the strain
HASTY, RESTS_S, FREE_OF_PRESS = 0.3, (0.005, 0.2), 0.5
#: share of the campaigns whose displacement is read beside its command, in parts of a sample either way: timing, and no
#: physics; not where something was left out that is told from it by its shape alone
SAMPLING_HZ, BESIDE, BESIDE_SAMPLES = 1000.0, 0.3, 1.0
LIKE_TIMING = ("acquisition_delay", "sensor_lag", "supply_current_limit")
_BRANCHES = {2: 0.1, 3: 0.8, 4: 0.1}
_TRIES = 12


@dataclass(frozen=True)
class Case:
    """One concealed campaign.

    `truth`: "none", names of CONTRACT 3 joined by +, or "unknown:NAME". `model`: the structure that a diagnosis
    should begin with; without the effects it is exact. `sizes`: of each effect alone, and of all together under
    "all", after the refit of everything else (see `sizes`).
    """

    seed: int
    truth: str
    model: str
    effects: Effects
    plan: CampaignPlan
    sizes: Mapping[str, Size] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """The answer that is right: `truth`, with "unknown" whatever the disturbance.

        "none" where all of it together stays below one resolution step (CONTRACT 1).
        """
        if self.truth != "none" and self.sizes["all"].steps < 1.0:
            return "none"
        return "unknown" if self.truth.startswith("unknown:") else self.truth

    @property
    def parameters(self) -> dict[str, float]:
        """True parameters by name: of the material, then of the effects (R_s_ohm of the circuit, once)."""
        out = self.plan.material.parameters()
        for name in reversed(list(self.effects)):
            out |= {p: v for p, v in self.effects[name].items() if np.isfinite(v)}
        return out

    def truth_table(self) -> dict[str, Any]:
        """Everything that was true, as plain types."""
        laser = self.plan.faults.displacement
        return {
            "about": "what was concealed in a simulated campaign, to check a diagnosis; never read by the tool",
            "seed": self.seed, "truth": self.truth, "verdict": self.verdict, "model": self.model,
            "effects": {n: {p: v if np.isfinite(v) else None for p, v in e.items()} for n, e in self.effects.items()},
            "parameters": self.parameters,
            "noise": {"sigma_m": laser.noise_scale * self.plan.sensors.displacement.fluctuation,
                      "correlation": laser.noise_correlation, "dropout_probability": laser.dropout_probability,
                      "mains_m": laser.mains_amplitude, "gaps": laser.gaps,
                      "late_s": self.plan.faults.displacement_late_s},
            "sizes": {n: {"steps": s.steps, "nats": s.nats, "rms": dict(s.rms)} for n, s in self.sizes.items()},
        }


def _rng(seed: int, what: int) -> np.random.Generator:
    return np.random.default_rng([seed, 0xC0CEA1, what])


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _geometry(rng: np.random.Generator) -> Geometry:
    base = Geometry()

    def about(value: float) -> float:
        return float(f"{value * rng.uniform(0.95, 1.05):.5g}")

    return replace(base, name=f"stack-{rng.integers(1000, 9999)}",
                   layers=round(base.layers * rng.uniform(0.95, 1.05)),
                   layer_thickness_m=about(base.layer_thickness_m), electrode_area_m2=about(base.electrode_area_m2),
                   total_area_m2=about(base.total_area_m2), stack_height_m=about(base.stack_height_m),
                   layer_mass_kg=about(base.layer_mass_kg))


def _material(rng: np.random.Generator) -> Material:
    drawn = Material.drawn(rng)
    branches = int(rng.choice(list(_BRANCHES), p=list(_BRANCHES.values())))
    k, tau = list(drawn.k_Pa), list(drawn.tau_s)
    if branches == 2:
        del k[1], tau[1]
    if branches == 4:
        k.append(float(60e3 * np.exp(0.3 * rng.standard_normal())))
        tau.append(float(tau[-1] * rng.uniform(0.08, 0.2)))
    return Material(drawn.Y_Pa, tuple(k), tuple(tau))


def _channel(rng: np.random.Generator, **more: float) -> ChannelFaults:
    colour = 0.0 if rng.random() < 0.5 else float(rng.uniform(0.1, 0.8))
    return ChannelFaults(noise_scale=_log(rng, 0.5, 2.0), noise_correlation=colour, **more)  # type: ignore[arg-type]


def _faults(rng: np.random.Generator, resolution_m: float) -> Faults:
    dropouts = _log(rng, 1e-4, 1e-3) if rng.random() < 0.25 else 0.0
    # below one resolution step: noise like any other
    mains = float(rng.uniform(0.05, 0.95)) * resolution_m if rng.random() < 0.15 else 0.0
    gaps = int(rng.integers(1, 3)) if rng.random() < 0.1 else 0
    laser = _channel(rng, dropout_probability=dropouts, mains_amplitude=mains, gaps=gaps,
                     gap_length_s=float(rng.uniform(0.05, 0.5)))
    return Faults(displacement=laser, force=_channel(rng), position=ChannelFaults(noise_scale=_log(rng, 0.5, 2.0)))


def _recordings(rng: np.random.Generator) -> tuple[RecordingPlan, ...]:
    """Four creep steps, nine waves, sometimes compression and relaxation; roles at random."""
    voltages = np.sort(rng.choice(np.arange(300, 1201, 100), 4, replace=False))
    voltages[-1] = max(voltages[-1], 900)
    conditioning = int(rng.integers(1, 3)) if rng.random() < 0.3 else 0
    on = float(rng.integers(10, 31))
    zeroed = bool(rng.random() < 0.5)
    fitted = set(rng.permutation(4)[:rng.choice((1, 2, 3), p=(0.2, 0.5, 0.3))].tolist())
    out = []
    for i, voltage in enumerate(voltages):
        protocol = Creep(float(voltage), float(10 * rng.integers(6, 31)), conditioning, on, on)
        out.append(RecordingPlan(f"creep_{voltage:04d}V.csv", protocol, "identify" if i in fitted else "validate",
                                 SAMPLING_HZ, zeroed=zeroed))
    usual = rng.random() < 0.6
    waves: list[tuple[str, float]] = []
    for shape in WAVE_SHAPES:
        frequencies = {0.1, 1.0, 10.0} if usual else set()
        while len(frequencies) < 3:
            frequencies.add(float(f"{_log(rng, 0.1, 10.0):.2g}"))
        waves += [(shape, f) for f in sorted(frequencies)]
    fitted = set(rng.permutation(9)[:int(rng.integers(3, 7))].tolist())
    for i, (shape, frequency) in enumerate(waves):
        wave = Wave(shape, frequency, cycles=float(max(3, round(5 * frequency))))
        out.append(RecordingPlan(f"{shape}_{frequency:g}Hz.csv", wave, "identify" if i in fitted else "validate",
                                 SAMPLING_HZ))
    if rng.random() < 0.3:
        strain = float(np.round(rng.uniform(0.08, 0.2), 3))
        press = Compression(strain, speed_m_per_s=_log(rng, 5e-5, 2e-4), cycles=int(rng.integers(2, 4)))
        hold = Relaxation(float(np.round(rng.uniform(0.08, 0.15), 3)), hold_s=float(10 * rng.integers(6, 31)))
        for file, mechanical in (("compression.csv", press), ("relaxation.csv", hold)):
            role = "identify" if rng.random() < 0.75 else "validate"
            out.append(RecordingPlan(file, mechanical, role, 100.0))
    return tuple(out)


def _hasty(recordings: tuple[RecordingPlan, ...], rng: np.random.Generator) -> tuple[RecordingPlan, ...]:
    """The same; in some campaigns every wave begins after a rest too short to tell the noise from."""
    if rng.random() >= HASTY:
        return recordings
    rest = _log(rng, *RESTS_S)
    return tuple(
        replace(r, protocol=replace(r.protocol, rest_s=float(np.round(rest, 3)), tail_s=float(np.round(rest, 3))))
        if isinstance(r.protocol, Wave) else r
        for r in recordings
    )  # fmt: skip


def _late_s(rng: np.random.Generator, names: list[str]) -> float:
    """How late the displacement stands beside the command (s); below zero where it is early."""
    late = float(rng.uniform(-BESIDE_SAMPLES, BESIDE_SAMPLES)) / SAMPLING_HZ
    return late if rng.random() < BESIDE and not set(names) & set(LIKE_TIMING) else 0.0


def _plan(seed: int) -> CampaignPlan:
    rng = _rng(seed, 1)
    recordings = _hasty(_recordings(rng), _rng(seed, 6))
    base = CampaignPlan("concealed", recordings, geometry=_geometry(rng), material=_material(rng))
    # whether the room is logged must not tell what was left out
    swing = _log(rng, 0.2, 2.0) if rng.random() < 0.2 else 0.0
    return replace(base, faults=_faults(rng, base.sensors.displacement.resolution), temperature_swing_K=swing,
                   temperature_C=float(np.round(rng.uniform(19.0, 25.0), 1)),
                   relative_humidity_pct=float(np.round(rng.uniform(25.0, 60.0), 1)))


def _names(rng: np.random.Generator, kind: str | None) -> tuple[str, list[str]]:
    """Kind of case and names of what acts, from what was asked for."""
    if kind is None:
        kind = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    listed, others = list(EFFECTS), list(DISTURBANCES)
    if kind == "none":
        return "none", []
    if kind == "single":
        return "single", [listed[rng.integers(len(listed))]]
    if kind == "unknown":
        return "unknown", [others[rng.integers(len(others))]]
    if kind == "pair":
        return "pair", [listed[i] for i in sorted(rng.permutation(len(listed))[:2])]
    names = kind.removeprefix("unknown:").split("+")
    wrong = [n for n in names if n not in ALL]
    if wrong or len(set(names)) < len(names):
        raise InputError(f"concealed case: kind {kind!r} is unknown; use none, single, pair, unknown, unknown:NAME or "
                         f"names joined by + out of {', '.join(ALL)}")
    if any(n in DISTURBANCES for n in names):
        return "unknown", names
    return ("single" if len(names) == 1 else "pair"), [n for n in EFFECTS if n in names]


def _aimed_at(size: Size, free: bool) -> float:
    """Steps that are aimed at: of what a voltage drove alone where a press does not count."""
    return size.driven_steps if free else size.steps


def _strength(name: str, strength: Strength, probe: Probe, target: float, free: bool) -> tuple[dict[str, float], Size]:
    """Parameters whose size is about `target` steps, within the range of the strength."""
    def measure(s: float) -> tuple[dict[str, float], Size]:
        made = strength.make(s)
        return made, probe.size({name: made}, strength.against(s) if strength.against else None)

    low, high = float(np.log(strength.low)), float(np.log(strength.high))
    x = 0.5 * (low + high)
    best: tuple[float, dict[str, float], Size] | None = None
    for _ in range(6):
        made, size = measure(float(np.exp(x)))
        off = float(np.log(max(_aimed_at(size, free), 1e-6) / target))
        if best is None or abs(off) < abs(best[0]):
            best = (off, made, size)
        if abs(off) < 0.15:
            break
        if off > 0.0:
            high = min(high, x)
        else:
            low = max(low, x)
        # size goes about as strength; where that leads out of what is left, halve
        x = x - off if low < x - off < high else 0.5 * (low + high)
        if high - low < 1e-3:
            break
    assert best is not None
    return best[1], best[2]


def _draw_effect(name: str, rng: np.random.Generator, probe: Probe, context: Context, span: tuple[float, float],
                 resolution_m: float, free: bool) -> tuple[dict[str, float], Size]:
    """One effect of a size in `span` (resolution steps); its other parameters are drawn again where none fits.

    free: sizes are those of what a voltage drove, whatever a press does.
    """
    target = _log(rng, *span)
    for _ in range(_TRIES):
        strength = draw_strength(name, rng, context)
        if name == "mains_pickup":
            made = strength.make(_log(rng, strength.low, strength.high))
            return made, Size({}, made["mains_m"] / resolution_m, 0.0, made["mains_m"] / resolution_m)
        if strength.searched:
            made, size = _strength(name, strength, probe, target, free)
        else:
            made = strength.make(_log(rng, strength.low, strength.high))
            size = probe.size({name: made})
        if _aimed_at(size, free) >= 1.0:
            return made, size
    return made, size


def draw_case(seed: int, kind: str | None = None) -> Case:
    """The concealed case of `seed`; the same seed and kind give the same case.

    `kind`: None (drawn by `SHARES`), "none", "single", "pair", "unknown", one or more names of CONTRACT 3 joined by
    +, or "unknown:NAME". Actuator, recordings, roles and noise depend on the seed alone; readings stand at their
    command where something was left out that is told from timing by its shape alone. Raises InputError for an unknown
    kind.
    """
    if seed < 0:
        raise InputError(f"concealed case: seed is {seed}; give zero or a positive number")
    rng = _rng(seed, 2)
    plan = _plan(seed)
    group, names = _names(rng, kind)
    plan = replace(plan, faults=replace(plan.faults, displacement_late_s=_late_s(_rng(seed, 8), names)))
    effects: dict[str, dict[str, float]] = {}
    sizes: dict[str, Size] = {}
    if names:
        if "thermal_expansion" in names and plan.temperature_swing_K == 0.0:
            plan = replace(plan, temperature_swing_K=_log(rng, 0.2, 2.0))
        if "mains_pickup" in names:
            laser = replace(plan.faults.displacement, mains_amplitude=0.0)
            plan = replace(plan, faults=replace(plan.faults, displacement=laser))
        probe = Probe(plan, seed)
        free = bool(_rng(seed, 7).random() < FREE_OF_PRESS)
        largest_V = max(r.protocol.largest_V for r in plan.recordings if isinstance(r.protocol, Creep | Wave))
        context = Context(plan.material, largest_V, probe.largest_m, len(plan.recordings))
        for name in names:
            effects[name], sizes[name] = _draw_effect(name, rng, probe, context, TARGET_STEPS[group],
                                                      plan.sensors.displacement.resolution, free)
        if FRICTION in effects:  # drawn on its own, so that everything else of a seed stays what it was
            effects[FRICTION]["elements"] = float(round(_log(_rng(seed, 5), *ELEMENTS)))
            sizes[FRICTION] = probe.size({FRICTION: effects[FRICTION]})
        if "series_resistance" in effects and "leakage" in effects:
            effects["leakage"]["R_s_ohm"] = effects["series_resistance"]["R_s_ohm"]
        sizes["all"] = probe.size(effects) if len(names) > 1 else sizes[names[0]]
    plan = replace(plan, effects=effects)
    return Case(seed, truth_name(effects), f"hooke+gm{len(plan.material.k_Pa)}", plan.effects, plan, sizes)


def case_campaign(case: Case) -> list[tuple[RecordingPlan, dict[str, NDArray[np.float64]]]]:
    """Recordings of `case` as (plan, columns), columns named as in CONTRACT 1; exactly what the files would hold."""
    return [(s.plan, s.columns) for s in simulate(case.plan, case.seed)]


def case_table(case: Case) -> dict[str, Any]:
    """What campaign.toml says of `case`, as plain tables: nothing of what was concealed."""
    from bayes_dea.bench.campaign_writer import campaign_table

    table = campaign_table(case.plan, case.seed)
    del table["meta"]["seed"]  # with it anybody could draw the case again
    return table


def write_case(case: Case, folder: str | Path, truth: str | Path | None = None,
               progress: Callable[[int, int, str], None] | None = None) -> Path:
    """Write the campaign of `case` into `folder` and what was concealed into the file `truth`; return `folder`.

    `truth`: by default FOLDER.truth.json beside the folder. Raises InputError where it would lie inside the folder,
    or where either cannot be written.
    """
    from bayes_dea.bench.campaign_writer import write_folder
    from bayes_dea.results import write_text

    folder = Path(folder)
    where = Path(truth) if truth is not None else folder.parent / f"{folder.resolve().name}.truth.json"
    if where.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"--truth {where}: lies inside the campaign {folder}, where a diagnosis could read it; "
                         "give a file outside")
    if where.is_dir():
        raise InputError(f"--truth {where}: is a folder; give a file")
    known = write_folder(folder, case.plan, case.seed, case_table(case), None, progress)
    write_text(where, json.dumps(case.truth_table() | {"recordings": known}, indent=1) + "\n")
    return folder

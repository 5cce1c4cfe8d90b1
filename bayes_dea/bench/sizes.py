"""How large an effect is in a campaign once everything else was fitted again, in fractions of a second.

Each recording is probed on few rows, without noise, dense after edges. The difference that the effect makes is
projected on what the plain model can mend: moduli and time constants, the sensor's gain, an offset of each recording,
the position of contact, and when the readings were taken where that is not at their command. What remains, as RMS over
the recording, is the size; linear, so rough where an effect is strong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.effects import Effects, checked
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Compression, Creep, Relaxation, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.bench.sensing import distort
from bayes_dea.bench.simulate import rig_of, room_temperature, stream

Array = NDArray[np.float64]

#: rows at full rate after each edge of a creep recording, then growing steps up to this many s
_DENSE_ROWS = 250
_LONGEST_S = 1.0
#: share of a parameter by which sensitivities are taken
_STEP = 1e-3
#: delay (s) by which its sensitivity is taken
_LATE_S = 1e-4
#: a size need not be known to the nanometre
_ROUGHNESS = 20.0
#: where the plates touch
_SLACK_M = 2e-4


@dataclass(frozen=True)
class _Rows:
    recording: RecordingPlan
    time_s: Array
    command: Array
    weight: Array  # rows of the recording that each of these stands for
    temperature_C: Array | None


@dataclass(frozen=True)
class Size:
    """What an effect leaves after the refit: RMS by file in m or N, the largest in resolution steps, and nats.

    `nats`: expected gain in log likelihood at the true noise, all recordings together; with correlated noise as if
    the difference were slow. `driven_steps`: the largest on a recording that a voltage drove.
    """

    rms: Mapping[str, float]
    steps: float
    nats: float
    driven_steps: float


def _creep_rows(time_s: Array, command: Array) -> NDArray[np.intp]:
    picked = [np.zeros(1, dtype=np.intp)]
    rate = 1.0 / (time_s[1] - time_s[0])
    edges = [0, *(np.flatnonzero(np.diff(command)) + 1), time_s.size]
    for a, b in pairwise(edges):
        growing = np.cumsum(np.minimum(np.exp(0.04 * np.arange(2000)), _LONGEST_S * rate)).astype(np.intp)
        rows = a + np.concatenate([np.arange(_DENSE_ROWS), _DENSE_ROWS + growing])
        picked.append(np.append(rows[rows < b], b - 1))
    return np.unique(np.concatenate(picked))


def _probe(plan: CampaignPlan, recording: RecordingPlan, room: np.random.Generator) -> _Rows:
    protocol, rate = recording.protocol, recording.sampling_Hz
    if isinstance(protocol, Creep | Wave):
        time_s = np.arange(int(protocol.duration_s * rate)) / rate
        command = protocol.command(time_s)
        if isinstance(protocol, Creep):
            rows = _creep_rows(time_s, command)
        else:
            # some hundred rows a cycle are enough, but every row about an edge, so that it stays where it is
            every = max(1, int(rate / max(100.0, 200.0 * protocol.frequency_Hz)))
            changes = np.flatnonzero(np.abs(np.diff(command)) > 50.0) + 1
            near = (changes[:, None] + np.arange(-1, 60)[None, :]).ravel() if changes.size else np.empty(0, dtype=int)
            rows = np.unique(np.concatenate([np.arange(0, time_s.size, every), near[near < time_s.size]]))
        temperature = None
        if plan.swing_K > 0.0:
            temperature = room_temperature(time_s, plan.temperature_C, plan.swing_K, room)[rows]
        return _Rows(recording, time_s[rows], command[rows], np.diff(rows, prepend=-1).astype(float), temperature)
    assert isinstance(protocol, Compression | Relaxation)
    travel = protocol.strain * plan.geometry_of(recording).stack_height_m + _SLACK_M
    every = max(1, round(rate / 25.0)) if isinstance(protocol, Compression) else 1
    time_s = np.arange(int(protocol.length_s(travel) * rate)) / rate
    rows = np.arange(0, time_s.size, every)
    return _Rows(recording, time_s[rows], protocol.position(time_s[rows], travel), np.full(rows.size, float(every)),
                 None)


class Probe:
    """Sizes of effects in the campaign of `plan` (whose own effects are passed over), for its material."""

    def __init__(self, plan: CampaignPlan, seed: int = 0) -> None:
        self._plan = replace(plan, effects={})
        self._seed = seed
        self._rows = [_probe(plan, r, stream(seed, "room", r.specimen, r.file)) for r in plan.recordings]
        self._plain = self._answers({})
        self.largest_m = max((float(a.max()) for a, r in zip(self._plain, self._rows, strict=True)
                              if isinstance(r.recording.protocol, Creep | Wave)), default=0.0)
        columns = [self._flat(self._changed(material)) for material in self._materials()]
        columns.append(self._flat([a if self._electric(i) else 0.0 * a for i, a in enumerate(self._plain)]))
        if plan.faults.displacement_late_s != 0.0:  # a fit has to allow for that
            late = self._answers(checked({"acquisition_delay": {"T_d_s": _LATE_S}}))
            columns.append(self._flat([a - b for a, b in zip(late, self._plain, strict=True)]))
        for i in range(len(self._rows)):
            if not self._electric(i):
                moved = [0.0 * a for a in self._plain]
                moved[i] = self._answer(i, {}, contact=_SLACK_M + 1e-6) - self._plain[i]
                columns.append(self._flat(moved))
        A = np.stack(columns, axis=1)
        scale = np.sqrt((A**2).sum(axis=0))
        self._A = A / np.where(scale > 0.0, scale, 1.0)
        self._gram = self._A.T @ self._A + 1e-12 * np.eye(A.shape[1])

    def _electric(self, i: int) -> bool:
        return isinstance(self._rows[i].recording.protocol, Creep | Wave)

    def _materials(self) -> list[Material]:
        m, up = self._plan.material, 1.0 + _STEP
        out = [replace(m, Y_Pa=m.Y_Pa * up)]
        for j in range(len(m.k_Pa)):
            scaled = [up if i == j else 1.0 for i in range(len(m.k_Pa))]
            out.append(replace(m, k_Pa=tuple(k * s for k, s in zip(m.k_Pa, scaled, strict=True))))
            out.append(replace(m, tau_s=tuple(t * s for t, s in zip(m.tau_s, scaled, strict=True))))
        return out

    def _answer(self, i: int, effects: Effects, material: Material | None = None, contact: float = _SLACK_M) -> Array:
        rows = self._rows[i]
        plan = replace(self._plan, effects=effects, material=material or self._plan.material)
        rig = replace(rig_of(plan, rows.recording), roughness=_ROUGHNESS)
        if not self._electric(i):
            return rig.press(rows.time_s, rows.command, contact)
        seen = distort(rows.time_s, rig.drive(rows.time_s, rows.command), rows.command, rows.temperature_C,
                       plan.effects, np.random.default_rng([self._seed, i]))
        return np.minimum(seen, plan.effects.get("sensor_clipping", {"y_max_m": np.inf})["y_max_m"])

    def _answers(self, effects: Effects) -> list[Array]:
        return [self._answer(i, effects) for i in range(len(self._rows))]

    def _changed(self, material: Material) -> list[Array]:
        return [self._answer(i, {}, material) - plain for i, plain in enumerate(self._plain)]

    def _noise(self, i: int) -> float:
        faults, sensors = self._plan.faults, self._plan.sensors
        if self._electric(i):
            return faults.displacement.noise_scale * sensors.displacement.fluctuation
        return faults.force.noise_scale * sensors.force.fluctuation

    def _flat(self, differences: list[Array]) -> Array:
        """All recordings after one another, without their offsets, in standard deviations of the noise."""
        parts = []
        for i, (difference, rows) in enumerate(zip(differences, self._rows, strict=True)):
            mean = np.average(difference, weights=rows.weight)
            parts.append((difference - mean) * np.sqrt(rows.weight) / self._noise(i))
        return np.concatenate(parts)

    def size(self, effects: Effects, against: Effects | None = None) -> Size:
        """Size of `effects`, over the plain actuator or over one that has the effects `against`."""
        with_them = self._answers(checked(effects))
        without = self._plain if not against else self._answers(checked(against))
        r = self._flat([a - b for a, b in zip(with_them, without, strict=True)])
        r = r - self._A @ np.linalg.solve(self._gram, self._A.T @ r)
        rms: dict[str, float] = {}
        pressed, driven, nats, at = 0.0, 0.0, 0.0, 0
        for i, rows in enumerate(self._rows):
            n = rows.time_s.size
            power = float(np.sum(r[at:at + n] ** 2))
            at += n
            value = self._noise(i) * float(np.sqrt(power / rows.weight.sum()))
            sensors, faults = self._plan.sensors, self._plan.faults
            sheet, channel = ((sensors.displacement, faults.displacement) if self._electric(i)
                              else (sensors.force, faults.force))
            rho = channel.noise_correlation
            rms[rows.recording.file] = value
            steps = value / sheet.resolution if sheet.resolution > 0.0 else np.inf
            if self._electric(i):
                driven = max(driven, steps)
            else:
                pressed = max(pressed, steps)
            nats += 0.5 * power * (1.0 - rho) / (1.0 + rho)
        return Size(rms, float(max(pressed, driven)), float(nats), float(driven))

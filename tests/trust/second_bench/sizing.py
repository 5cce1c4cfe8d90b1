"""How large an effect is on each recording, after what a fit would take away of it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .recordings import Array, Effects, VoltageRecording
from .specimen import Specimen

#: simulations that are kept beside the one of nothing concealed
_KEPT = 6
#: a parameter of the material is changed by this factor for its slope
_CHANGE = 1.05


@dataclass(frozen=True)
class Run:
    """How a case is simulated while strengths are sought: internal steps a row, and where a sensor's limit acts."""

    steps: int = 3
    clip_last: bool = False


@dataclass(frozen=True, eq=False)
class Sizes:
    """RMS (recordings,) m that an effect adds: after a gain and offsets, and after a linear refit of everything."""

    crude_m: Array
    refit_m: Array


def _crude(ys: Sequence[Array], bases: Sequence[Array]) -> Array:
    """RMS (recordings,) of what differs after one gain for the campaign and an offset a recording."""
    with_it = [y - y.mean() for y in ys]
    without = [b - b.mean() for b in bases]
    pairs = list(zip(with_it, without, strict=True))
    above = below = 0.0
    for y, b in pairs:
        above += y @ b
        below += b @ b
    gain = above / below
    return np.array([np.sqrt(np.mean((y - gain * b) ** 2)) for y, b in pairs])


def _slopes(specimen: Specimen, recordings: Sequence[VoltageRecording]) -> list[list[Array]]:
    """Change of every recording (n,) m per 5 % of each branch's stiffness, then of each time constant."""
    base = [specimen.voltage(r, {}, 1) for r in recordings]
    m = specimen.material
    out: list[list[Array]] = []
    for group, values in (("k_Pa", m.k_Pa), ("tau_s", m.tau_s)):
        for i in range(len(values)):
            changed = (*values[:i], values[i] * _CHANGE, *values[i + 1 :])
            material = replace(m, k_Pa=changed) if group == "k_Pa" else replace(m, tau_s=changed)
            other = replace(specimen, material=material)
            out.append([other.voltage(r, {}, 1) - b for r, b in zip(recordings, base, strict=True)])
    return out


def _inverse(gram: Array, scale: Array) -> Array:
    return np.asarray(np.linalg.pinv(gram * scale[:, None] * scale, rcond=1e-10) * scale[:, None] * scale)


class Sizer:
    """Sizes of effects on one campaign.

    The linear refit moves modulus and gain (one and the same here), stiffness and time constant of the branches,
    offsets, and all readings by at most one sample. Slopes are worked out once; the latest simulations are kept.
    """

    def __init__(self, specimen: Specimen, recordings: Sequence[VoltageRecording]) -> None:
        self.specimen, self.recordings = specimen, recordings
        self._kept: dict[str, list[Array]] = {}
        base = self.simulated({}, Run())
        shift = [np.concatenate([b[:1], b[:-1]]) - b for b in base]  # one sample later
        columns = [*_slopes(specimen, recordings), base, shift]
        self._design = [np.stack([c[i] - c[i].mean() for c in columns], 1) for i in range(len(recordings))]
        self._gram = np.asarray(sum(x.T @ x for x in self._design))
        scale = 1 / np.sqrt(np.diag(self._gram))
        self._inverse = _inverse(self._gram, scale)
        self._inverse_unshifted = _inverse(self._gram[:-1, :-1], scale[:-1])

    def simulated(self, effects: Effects, run: Run) -> list[Array]:
        """Every recording (n,) m with effects."""
        key = json.dumps([effects, run.steps, run.clip_last], sort_keys=True)
        if key not in self._kept:
            if len(self._kept) > _KEPT:
                self._kept.pop(list(self._kept)[1])  # the first is the one of nothing concealed
            self._kept[key] = [self.specimen.voltage(r, effects, run.steps, run.clip_last) for r in self.recordings]
        return self._kept[key]

    def sizes(self, effects: Effects, without: Effects, run: Run) -> Sizes:
        """What `effects` add to the recordings with those of `without`."""
        ys, bases = self.simulated(effects, run), self.simulated(without, run)
        added = [(y - b) - (y - b).mean() for y, b in zip(ys, bases, strict=True)]
        projected = np.asarray(sum(x.T @ d for x, d in zip(self._design, added, strict=True)))
        w = self._inverse @ projected
        if abs(w[-1]) > 1.0:  # timing explains one sample at most
            shift = np.sign(w[-1])
            w = np.append(self._inverse_unshifted @ (projected[:-1] - shift * self._gram[:-1, -1]), shift)
        left = [np.sqrt(np.mean((d - x @ w) ** 2)) for x, d in zip(self._design, added, strict=True)]
        return Sizes(_crude(ys, bases), np.array(left))

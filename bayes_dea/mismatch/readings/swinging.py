"""What swings at a frequency of its own while nothing moves: a building, a fan, a loop of the supply.

The noise of a sensor has no lines but those of the mains: its spectrum at rest is flat or falls, as that of AR(1) does.
What stands out of it narrowly is no noise, however well a larger and more correlated one would take it in. Looked at
are rows of the recordings to identify at which the command stands still, less the best explanation: what rings or
creeps there by a law is in that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend, periodogram
from scipy.stats import gamma

from ...campaign.rhythm import with_a_reading
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...models.electrostatics import filled_input
from ...noise.quiet import still_windows, stillness

Array = NDArray[np.float64]

#: rows of a segment at least, and segments of a recording at most
_SEGMENT, _MOST = 1024, 200
#: share of a segment's rows that has to be observed; the rest is bridged
_OBSERVED = 0.98
#: bins around one that do not count as its neighbours, bins that do, and of these on one side to count by themselves
_OWN, _AROUND, _SIDE = 4, 24, 6
#: times its neighbours that a bin has to be, and the chance of it in all bins below which it is no chance
_TIMES, _CHANCE = 4.0, 1e-6
#: half-width around mains lines and their multiples (bins), and as a share of these: what mains is off by
_MAINS, _OFF = 2, 0.002
#: and up to which these are loud enough to be seen where slow sampling folds them back
_HEARD_Hz = 500.0


@dataclass(frozen=True)
class _Look:
    """Segments of lasts_s (s), of which `after` are left out behind a change of the command and `least` have to be
    there in all. slow: bins that a slow drift may fill; most_Hz: up to where lines are looked for."""

    lasts_s: float
    after: int
    least: int
    slow: int
    most_Hz: float = np.inf


#: bins of 1 Hz, so that there is room between multiples of mains; and what is slower, as buildings are, whose segments
#: have next to no creep in them from 0.6 Hz on
_LOOKS = (_Look(1.024, 2, 20, 4), _Look(16.384, 1, 8, 10, 8.0))


@dataclass(frozen=True)
class Swinging:
    """A line at rest: frequency (Hz), amplitude (m), power over that of its neighbours, chance, where most of it is."""

    frequency_Hz: float
    amplitude_m: float
    ratio: float
    p_value: float
    recording: str

    def note(self) -> str:
        """One line on it."""
        return (
            f"readings swing at {self.frequency_Hz:.3g} Hz by {1e6 * self.amplitude_m:.2g} um where the command stands "
            "still; noise of a sensor does not, so something shakes that is on no list: the stand, a fan, a supply"
        )


    def repair(self, partial: str) -> dict[str, Any]:
        """The "repair" of diagnosis.json (see `unknown.repair`); partial: the best explanation of everything else."""
        what = f"a swing at {self.frequency_Hz:.3g} Hz"
        term = {"term": what, "mean": self.amplitude_m, "sd": self.amplitude_m / self.ratio**0.5, "unit": "m",
                "inclusion_probability": 1.0 - self.p_value}  # fmt: skip
        return {
            "stage": "sensor",
            "acts_on": "time alone, also where the command stands still",
            "form": f"{1e6 * self.amplitude_m:.2g} um x ({what})",
            "terms": [term],
            "partial": partial,
        }


def swinging(fit: Fit, resolution: float) -> Swinging | None:
    """The strongest line at rest in what a fit leaves; None where there is none of at least the resolution (m)."""
    rows = fit.problem.rows(fit.q)
    _, gains = fit.problem.beside(fit.q)
    by_kind: dict[tuple[_Look, float], list[tuple[str, Array]]] = {}
    rho: dict[float, float] = {}
    for piece, x in zip(fit.problem.pieces, rows, strict=True):
        if piece.channel == "displacement":
            step = round(piece.prepared.reading_step_s, 7)
            left = piece.prepared.y - (1.0 + gains[piece.group]) * x
            # of a slow sensor both are of the same length, and the first has all
            for n, look in {_rows(look, step): look for look in reversed(_LOOKS)}.items():
                found = _segments(piece, left, n, look.after)
                if len(found):
                    by_kind.setdefault((look, step), []).append((piece.name, found))
            rho[step] = fit.noise.of(piece)[1]
    lines = [_line(look, step, parts, rho[step]) for (look, step), parts in by_kind.items()]
    seen = [line for line in lines if line is not None and line.amplitude_m >= resolution]
    return max(seen, key=lambda line: line.amplitude_m) if seen else None


def _rows(look: _Look, step_s: float) -> int:
    """Rows of a segment."""
    return max(_SEGMENT, round(look.lasts_s / step_s))


def _segments(piece: Piece, left: Array, n: int, after: int) -> Array:
    """Power densities (k, bins) of stretches of n rows in which the command stands still, less their straight lines;
    m^2 row. after: stretches that are left out behind a change."""
    p = piece.prepared
    read = with_a_reading(p.y)
    u, observed, left = filled_input(p.recording.columns["voltage_V"])[read], p.observed[read], left[read]
    starts = still_windows(u, np.ones(u.size, dtype=bool), stillness(u), n, after * n)
    rows = np.arange(n)
    parts = []
    for begin in starts[:_MOST]:
        seen, v = observed[begin : begin + n], left[begin : begin + n]
        if seen.mean() > _OBSERVED:
            parts.append(np.where(seen, v, np.interp(rows, rows[seen], v[seen])))
    if not parts:
        return np.empty((0, 0))
    return np.asarray(periodogram(detrend(np.array(parts)), window="hann", detrend=False)[1], dtype=float)


def _line(look: _Look, step_s: float, parts: list[tuple[str, Array]], rho: float) -> Swinging | None:
    """What stands out most of the mean periodogram of recordings at one sampling step, whose noise has this rho."""
    every = np.concatenate([found for _, found in parts])
    count = len(every)
    if count < look.least:
        return None
    power, rows = every.mean(axis=0), _rows(look, step_s)
    width_Hz = 1.0 / (rows * step_s)
    usable = np.ones(power.size, dtype=bool)
    usable[: look.slow], usable[-2:] = False, False
    if look.most_Hz < np.inf:
        usable[round(look.most_Hz / width_Hz) :] = False
    for mains in (50.0, 60.0):
        for line in np.arange(mains, max(0.5 / step_s, _HEARD_Hz) + 1.0, mains):
            seen_Hz = abs(line - round(line * step_s) / step_s)  # what is faster than is sampled is folded back
            at, reach = round(seen_Hz / width_Hz), max(_MAINS, round(_OFF * line / width_Hz))
            usable[max(at - reach, 0) : at + reach + 1] = False
    # neighbours of a line lie on the noise's own slope, which is steep where it is correlated over tens of milliseconds
    slope = 1.0 / np.abs(1.0 - rho * np.exp(-2j * np.pi * np.arange(power.size) / rows)) ** 2
    ratios = np.zeros(power.size)
    for at in map(int, np.flatnonzero(usable)):
        near = np.arange(max(at - _AROUND, look.slow), min(at + _AROUND + 1, power.size - 2))
        near = near[(np.abs(near - at) > _OWN) & usable[near]]
        if near.size < _AROUND // 2:
            continue
        # what falls from one side of a bin to the other, as creep does, is no line
        sides = [near, *(side for side in (near[near < at], near[near > at]) if side.size >= _SIDE)]
        floor = max(float(np.median(power[side] / slope[side])) for side in sides)
        ratios[at] = power[at] / max(float(slope[at]) * floor, 1e-300)
    k = int(np.argmax(ratios))
    ratio = float(ratios[k])
    p_value = min(float(gamma.sf(count * ratio, count)) * power.size, 1.0)
    if ratio < _TIMES or p_value > _CHANCE:
        return None
    # a swing of amplitude a has the variance a^2/2, in bins one segment's inverse wide
    own = slice(max(k - _OWN, 0), k + _OWN + 1)
    amplitude = np.sqrt(2.0 * np.sum(np.maximum(power[own] - power[k] / ratio, 0.0)) / rows)
    most = max(parts, key=lambda part: float(part[1][:, k].mean()))[0]
    return Swinging(k * width_Hz, float(amplitude), ratio, max(p_value, 1e-300), most)

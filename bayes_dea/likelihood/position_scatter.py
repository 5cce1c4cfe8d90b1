"""What an error of a measured position comes out as in the force of a press: its stiffness at every block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from ..noise.blocks import Blocks
from .prepare import Prepared

Array = NDArray[np.float64]

#: parts of a ramp by which its stiffness is read: share of the travel, blocks that it may last, fewest of them
_RAMP_SHARE, _RAMP_BLOCKS, _RAMP_PAIRS = 0.03, 60, 5
#: blocks on either side that a slope is taken over, how far they have to move (sd, share of the travel), and how many
#: times it may be that of the ramps
_NEIGHBOURS, _SEEN_TRAVEL, _STIFFEST = 4, 0.0015, 5.0
#: pairs and strains from which on the stiffness of ramps is a curve, the part of its middle that it does not fall
#: below, and passes of its robust fit
_CURVED_PAIRS, _CURVED_STRAIN, _FLATTEST, _REWEIGHTED = 12, 0.02, 0.01, 8
#: rows at rest before plates move, the sds of a reading and the part of the largest force below which none is seen
_AT_REST, _UNSEEN, _NO_FORCE = 20, 8.0, 1e-4
#: part of a ramp's stiffness below which plates that move are apart
_APART = 0.3


@dataclass(frozen=True)
class Stiffness:
    """Change of force with position at the blocks in N/m; zero where plates do not touch.

    ramps (nb,): along ramps, a smooth curve over the strain. here (nb,): with what friction adds after a reversal.
    """

    ramps: Array
    here: Array

    def by_scale(self, x: Array, force: Array, rest_N: float) -> Array:
        """What a wrong scale of the position adds to a force beyond a gain of that: column (nb,) in N.

        A scale 1 + g adds g (x - x0) dF/dx, with x0 where the plates touch; the part in proportion to the force is a
        gain of it already. x, force (nb,): means over the blocks; rest_N: force before anything moves.

        That force is the one of the stiffness, not what was measured: its noise would make a column by which the noise
        can be made smaller, and every effect that goes with a wrong scale would gain by that.
        """
        touching = self.ramps > 0.0
        if not touching.any():
            return np.zeros(x.size)
        least = np.argmin(np.where(touching, np.abs(force - rest_N), np.inf))
        order = np.flatnonzero(touching)[np.argsort(x[touching], kind="stable")]
        elastic = np.zeros(x.size)
        elastic[order] = cumulative_trapezoid(self.ramps[order], x[order], initial=0)
        return np.where(touching, self.ramps * (x - x[least]) - (elastic - elastic[least]), 0.0)


def stiffness(p: Prepared, blocks: Blocks, x: Array, force: Array, start_m: float) -> Stiffness:
    """Stiffness at the blocks: what the scatter and the scale of a position are multiplied by.

    x, force (nb,): means over the blocks, in m and N; start_m: position before anything moves.

    Like that of an incompressible Hookean block, 1/(1 - e)^2: the same strain makes the same stress, on a growing area.
    Its size is that of the ramps in contact, unloading or loading, where the material has no time to relax: a curve
    over the strain, as stacks may stiffen by far.
    Zero where the plates do not touch.
    """
    height = p.recording.actuator.stack_height_m
    e = np.clip((x - start_m) / height, -0.9, 0.9) if height else np.zeros(x.size)
    slopes = slopes_of(x, force, _SEEN_TRAVEL * float(np.ptp(x)))
    near = _near_rest(p, force, blocks)
    ramps = _along_ramps(x, force, e, near)
    if _apart(near, slopes, ramps):
        ramps = np.where(near, 0.0, ramps)
    return Stiffness(ramps, np.clip(slopes, ramps, _STIFFEST * ramps))


def _along_ramps(x: Array, force: Array, e: Array, near: NDArray[np.bool_]) -> Array:
    """Stiffness (nb,) in N/m that the ramps in contact show at the strains e (nb,), a smooth curve through all."""
    travel = float(np.ptp(x))
    strain, found = [], []
    for i in np.flatnonzero(~near):
        later = slice(i + 1, i + 1 + _RAMP_BLOCKS)
        far = np.flatnonzero(np.abs(x[later] - x[i]) > _RAMP_SHARE * travel)
        j = i + 1 + int(far[0]) if far.size else i
        if j > i and not near[j]:
            strain.append(0.5 * (e[i] + e[j]))
            found.append(abs(force[j] - force[i]) / abs(x[j] - x[i]) * (1.0 - strain[-1]) ** 2)
    if len(found) < _RAMP_PAIRS:
        return np.full(x.size, float(np.ptp(force)) / max(travel, 1e-9)) / (1.0 - e) ** 2
    at, size = np.array(strain), np.array(found)
    middle = float(np.median(size))
    if len(found) < _CURVED_PAIRS or np.ptp(at) < _CURVED_STRAIN:
        return middle / (1.0 - e) ** 2
    curve = _robust_parabola(at, size)
    return np.maximum(np.polyval(curve, np.clip(e, at.min() - 0.5 * _CURVED_STRAIN, at.max() + 0.5 * _CURVED_STRAIN)),
                      _FLATTEST * middle) / (1.0 - e) ** 2


def _robust_parabola(x: Array, y: Array) -> Array:
    """Coefficients (3,) of the parabola of least absolute deviations, by reweighting."""
    weight = np.ones(x.size)
    curve = np.zeros(3)
    for _ in range(_REWEIGHTED):
        curve = np.polyfit(x, y, 2, w=weight)
        off = np.abs(y - np.polyval(curve, x))
        weight = 1.0 / np.sqrt(np.maximum(off, 1e-3 * float(np.median(np.abs(y))) + 1e-300))
    return curve


def at_rest(force: Array, blocks: Blocks) -> float:
    """Force in N before anything moves: mean of the first rows."""
    first = slice(0, int(np.searchsorted(np.cumsum(blocks.count), _AT_REST)) + 1)
    return float(np.average(force[first], weights=blocks.count[first]))


def _near_rest(p: Prepared, force: Array, blocks: Blocks) -> NDArray[np.bool_]:
    """Blocks (nb,) whose force is that of the beginning."""
    unseen = _UNSEEN * p.quiet_sd / np.sqrt(blocks.count) + _NO_FORCE * float(np.max(np.abs(force)))
    return np.asarray(np.abs(force - at_rest(force, blocks)) < unseen)


def _apart(near: NDArray[np.bool_], slopes: Array, ramps: Array) -> bool:
    """Whether plates are apart where the force is `near` that of the beginning: they move and it stays.

    A line through one stroke, of which they are apart for a part, would have its error pinned to nothing by that part
    if it were thought to come out as force there.
    """
    moving = near & (slopes > 0.0)
    return bool(moving.any() and float(np.median(slopes[moving] / ramps[moving])) < _APART)


def slopes_of(x: Array, force: Array, least_m: float) -> Array:
    """Size of the slope of the force by the position (nb,) about every block; zero where these hardly move.

    Friction makes a stack several times stiffer for some hundredths of its travel after every reversal.
    """
    ones = np.ones(2 * _NEIGHBOURS + 1)

    def around(v: Array) -> Array:
        return np.convolve(v, ones, mode="same")

    n = around(np.ones(x.size))
    x, force = x - x.mean(), force - force.mean()
    spread = around(x * x) - around(x) ** 2 / n
    together = around(x * force) - around(x) * around(force) / n
    moving = spread > n * least_m**2
    return np.where(moving, np.abs(together) / np.where(moving, spread, 1.0), 0.0)

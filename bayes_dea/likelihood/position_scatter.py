"""What the scatter of a measured position comes out as in the force of a press: its stiffness at every block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import Blocks
from .prepare import Prepared

Array = NDArray[np.float64]

#: parts of a ramp by which its stiffness is read: share of the travel, blocks that it may last, fewest of them
_RAMP_SHARE, _RAMP_BLOCKS, _RAMP_PAIRS = 0.03, 60, 5
#: blocks on either side that a slope is taken over, how far they have to move (sd, share of the travel), and how many
#: times it may be that of the ramps
_NEIGHBOURS, _SEEN_TRAVEL, _STIFFEST = 4, 0.0015, 5.0
#: rows at rest before plates move, the sds of a reading and the part of the largest force below which none is seen
_AT_REST, _UNSEEN, _NO_FORCE = 20, 8.0, 1e-3
#: part of a ramp's stiffness below which plates that move are apart
_APART = 0.3


def stiffness(p: Prepared, blocks: Blocks, x: Array, force: Array, start_m: float) -> Array:
    """Change of force with position at the blocks (nb,) in N/m: what the scatter of a position is multiplied by.

    x, force (nb,): means over the blocks, in m and N; start_m: position before anything moves.

    Like that of an incompressible Hookean block, 1/(1 - e)^2: the same strain makes the same stress, on a growing area.
    Its size is the median over the ramps in contact, unloading or loading, where the material has no time to relax.
    Zero where the plates do not touch.
    """
    height = p.recording.actuator.stack_height_m
    e = np.clip((x - start_m) / height, -0.9, 0.9) if height else np.zeros(x.size)
    travel, most = float(np.ptp(x)), float(np.max(np.abs(force)))
    found = []
    for i in range(x.size):
        near = slice(i + 1, i + 1 + _RAMP_BLOCKS)
        far = np.flatnonzero(np.abs(x[near] - x[i]) > _RAMP_SHARE * travel)
        if far.size and min(abs(force[i]), abs(force[i + 1 + far[0]])) > 0.1 * most:
            j = i + 1 + int(far[0])
            found.append((force[j] - force[i]) / (x[j] - x[i]) * (1.0 - 0.5 * (e[i] + e[j])) ** 2)
    at_rest = float(np.median(found)) if len(found) >= _RAMP_PAIRS else float(np.ptp(force)) / max(travel, 1e-9)
    ramps = abs(at_rest) / (1.0 - e) ** 2
    slopes = slopes_of(x, force, _SEEN_TRAVEL * travel)
    return np.where(_apart(p, force, blocks, slopes, ramps), 0.0, np.clip(slopes, ramps, _STIFFEST * ramps))


def _apart(p: Prepared, force: Array, blocks: Blocks, slopes: Array, ramps: Array) -> NDArray[np.bool_]:
    """Blocks (nb,) in which the plates do not touch.

    Where they move and the force stays that of the beginning they are apart. A line through one stroke, of which they
    are apart for a part, would have its error pinned to nothing by that part otherwise.
    """
    first = slice(0, int(np.searchsorted(np.cumsum(blocks.count), _AT_REST)) + 1)
    rest = float(np.average(force[first], weights=blocks.count[first]))
    unseen = _UNSEEN * p.quiet_sd / np.sqrt(blocks.count) + _NO_FORCE * float(np.max(np.abs(force)))
    near = np.abs(force - rest) < unseen
    moving = near & (slopes > 0.0)
    if not moving.any() or float(np.median(slopes[moving] / ramps[moving])) > _APART:
        return np.zeros(near.size, dtype=bool)
    return near


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

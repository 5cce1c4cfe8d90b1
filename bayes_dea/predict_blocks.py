"""What the draws predict for the blocks of a recording, a portion of blocks at a time.

A portion holds (S, portion) numbers of S draws, so that a long sine with a million blocks needs no more room than a
short one. Of such a recording only some of the blocks are kept with all their draws.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .campaign.scratch import BLOCK, pieces

Array = NDArray[np.float64]
#: simulated block means (S, portion) of a portion of the blocks
Simulated = Callable[[slice], Array]
#: numbers in a portion, of recordings of up to BLOCK rows and of longer ones
_NUMBERS, _NUMBERS_LONG = 1 << 24, 1 << 21
#: blocks of a longer recording that are kept with their draws
_KEPT = 50_000


@dataclass(frozen=True)
class BlockPrediction:
    """mean, parameter_var (nb,) of the draws after offset and gain; offset_var of the offset, given a draw.

    rows (m,): blocks that are kept, draws (S, m): what the draws predict for them, without noise.
    """

    mean: Array
    parameter_var: Array
    offset_var: float
    rows: NDArray[np.int64]
    draws: Array


def predict_blocks(
    simulated: Simulated,
    gain: Array,
    gain_var: Array,
    y: Array,
    disturbance: Array,
    count: NDArray[np.int64],
    information: Array,
    precision: float,
    n: int,
    rng: np.random.Generator,
) -> BlockPrediction:
    """Average over the draws.

    gain, gain_var (S,): posterior mean and variance of the gain given each draw. y, disturbance, count (nb,): data,
    mains line and number of samples. information (S,): what one sample says about the offset, 1/unit^2; precision: what
    its prior says. n: rows of the recording, which decide the portions. rng: says which blocks of a long one are kept.
    """
    S, nb = gain.size, y.size
    portion = max(1, (_NUMBERS if n <= BLOCK else _NUMBERS_LONG) // S)
    level, weights, missing = np.zeros(S), np.zeros(S), np.zeros(S)
    for part in pieces(nb, portion):
        X = simulated(part)
        weight = count[None, part] * information[:, None]
        weights += weight.sum(axis=1)
        missing += np.sum(weight * (y[part] - disturbance[part] - (1 + gain)[:, None] * X), axis=1)
        level += (X * count[part]).sum(axis=1)
    level /= count.sum()
    offset_var = 1.0 / (weights + precision)
    offset = offset_var * missing
    rows = kept_blocks(nb, n, rng)
    mean, parameter_var, draws = np.empty(nb), np.empty(nb), np.empty((S, rows.size))
    for part in pieces(nb, portion):
        X = simulated(part)
        f = (1 + gain)[:, None] * X + offset[:, None] + disturbance[part]
        # offset and gain scatter around their conditional means as well
        centred = X - level[:, None]
        mean[part] = f.mean(axis=0)
        parameter_var[part] = f.var(axis=0) + offset_var.mean() + np.mean(gain_var[:, None] * centred**2, axis=0)
        first, last = np.searchsorted(rows, [part.start, part.stop])
        draws[:, first:last] = f[:, rows[first:last] - part.start]
    return BlockPrediction(mean, parameter_var, float(offset_var.mean()), rows, draws)


def kept_blocks(nb: int, n: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Blocks that are kept, rising: all, or of a recording longer than BLOCK rows one of every few neighbours."""
    every = -(-nb // _KEPT) if n > BLOCK else 1
    if every == 1:
        return np.arange(nb)
    # not every k-th one: against a periodic input that would make a wave of its own
    first = np.arange(0, nb - every + 1, every)
    return first + rng.integers(0, every, first.size)

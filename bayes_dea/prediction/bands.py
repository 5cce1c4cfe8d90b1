"""Bands of the answer at every row, from draws, a stretch of rows at a time.

Two bands (reference: parameters, then systematic terms, then noise): that of the parameters alone, which is what the
actuator does; and that of one reading of the sensor, with its gain as calibrated, the offset of a new recording and
the noise of one sample. Neighbouring rows order the draws alike, so that sorting starts from the order before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from ..compiled import njit
from .simulators import Simulator

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
#: rows at once
CHUNK = 4096

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """What the sensor adds, one value a draw: y = (1 + gain) x + sd * standard normal."""

    gain: Array
    sd: Array


@dataclass(frozen=True)
class Bands:
    """mean (n,); parameters and reading (5, n), the quantiles LEVELS; reading is None without a sensor."""

    mean: Array
    parameters: Array
    reading: Array | None


@njit(cache=True, nogil=True)
def _quantiles(x, order, place, weight, out):
    """Quantiles of each row of x (rows, S) into out (levels, rows); `order` (S,) is where sorting starts."""
    rows, S = x.shape
    v = np.empty(S)
    for i in range(rows):
        for k in range(S):
            value, which = x[i, order[k]], order[k]
            j = k - 1
            while j >= 0 and v[j] > value:
                v[j + 1] = v[j]
                order[j + 1] = order[j]
                j -= 1
            v[j + 1] = value
            order[j + 1] = which
        for q in range(place.size):
            a = place[q]
            b = min(a + 1, S - 1)
            out[q, i] = v[a] + weight[q] * (v[b] - v[a])


@njit(cache=True, nogil=True)
def _readings(x, gain, shift, out):
    """Both signs of each draw's deviate: chance correlation of deviates and draws cancels."""
    rows, S = x.shape
    for i in range(rows):
        for s in range(S):
            y = (1.0 + gain[s]) * x[i, s]
            out[i, 2 * s] = y + shift[s]
            out[i, 2 * s + 1] = y - shift[s]


def places(size: int) -> tuple[NDArray[np.int64], Array]:
    """Where the quantiles LEVELS lie among `size` sorted values, and the weight of the next (numpy's default)."""
    at = np.array(LEVELS) * (size - 1)
    low = np.floor(at).astype(np.int64)
    return low, at - low


def stretch(simulators: Sequence[Simulator], start: int, stop: int, pool: ThreadPoolExecutor) -> Array:
    """Outputs (rows, S) of all simulators' draws, side by side, the draws of a row one after another in memory.

    numpy sums a row in an order that depends on how it lies in memory; so it must lie the same way however many
    simulators there are.
    """
    return np.ascontiguousarray(np.concatenate(list(pool.map(lambda s: s.rows(start, stop), simulators)), axis=1))


def bands(
    simulators: Sequence[Simulator],
    n: int,
    reading: Reading | None,
    rng: np.random.Generator,
    report: Callable[[int, int], None] = lambda done, of: None,
) -> Bands:
    """Mean and quantiles of all simulators' draws at rows 0..n-1; each simulator runs on a thread of its own.

    The deviates of the noise are normal scores that stay with their draw: only quantiles of single rows are asked
    for, and so the bands are as smooth as the answer.
    """
    mean, parameters = np.empty(n), np.empty((len(LEVELS), n))
    read = None if reading is None else np.empty((len(LEVELS), n))
    shift = np.empty(0)
    if reading is not None:
        S = reading.gain.size
        shift = reading.sd * rng.permutation(ndtri((np.arange(S) + 0.5) / S))

    def rows(job: tuple[int, int, Array]) -> None:
        start, stop, x = job
        mean[start:stop] = x.mean(axis=1)
        S = x.shape[1]
        _quantiles(x, np.arange(S), *places(S), parameters[:, start:stop])
        if reading is not None and read is not None:
            y = np.empty((len(x), 2 * S))
            _readings(x, reading.gain, shift, y)
            _quantiles(y, np.argsort(y[0]), *places(2 * S), read[:, start:stop])

    with ThreadPoolExecutor(len(simulators)) as pool:
        for start in range(0, n, CHUNK):
            stop = min(start + CHUNK, n)
            x = stretch(simulators, start, stop, pool)
            cuts = np.linspace(start, stop, len(simulators) + 1).astype(int)
            list(pool.map(rows, [(a, b, x[a - start : b - start]) for a, b in pairwise(cuts) if a < b]))
            report(stop, n)
    return Bands(mean, parameters, read)

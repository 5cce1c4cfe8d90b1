"""Stretches in which a sensor repeats itself: stuck, or clipped at the end of its range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.scratch import BLOCK, beside, pieces

#: repeats from which on a run can be too long, and the share of repeats from which on steps are coarser than noise
_SHORTEST, _COARSE = 5, 0.5
#: chance in a recording of noise alone
FALSE_ALARM = 1e-6

#: first rows and numbers of repeats of the runs of `_SHORTEST` repeats or more, and the repeats of all runs
Runs = tuple[NDArray[np.int64], NDArray[np.int64], int]


@dataclass(frozen=True)
class Flat:
    """Rows start..stop-1 hold one value. kind: "stuck", or "clipped" at the extreme of the recording."""

    start: int
    stop: int
    value: float
    kind: str


def find_flat(y: ArrayLike, *, false_alarm: float = FALSE_ALARM) -> tuple[Flat, ...]:
    """Runs of equal readings that are too long to be chance.

    With p the share of readings equal to the one before (long runs left out), a run of k repeats has a
    chance of about n p^k; runs below `false_alarm` are reported. Data that scarcely ever change (a
    resolution much coarser than the noise) give p near one, and nothing is reported.

    Parameters
    ----------
    y : output, shape (n,); nan cells end a run.
    """
    x = np.asarray(y, dtype=float)
    return _too_long(x, _runs(x), false_alarm)


def _too_long(x: NDArray[np.float64], runs: Runs, false_alarm: float, least: float = 0.0) -> tuple[Flat, ...]:
    """Those of all runs that are too long to be chance. least: share of repeats where the readings stand still."""
    first, length, repeats = runs
    if x.size < 16 or first.size == 0:
        return ()
    limit = math.inf
    # long runs raise the share that they are judged by: leave out what was found and judge again
    for _ in range(3):
        long = int(length[length >= limit].sum())
        share = max(least, (repeats - long + 1) / max(1, x.size - long))
        if share >= 0.999:
            return ()
        limit = max(float(_SHORTEST), math.log(false_alarm / x.size) / math.log(share))
    found = []
    low, high = float(np.nanmin(x)), float(np.nanmax(x))
    for a, k in zip(first[length >= limit], length[length >= limit], strict=True):
        value = float(x[a])
        kind = "clipped" if value in (low, high) and low < high else "stuck"
        found.append(Flat(int(a), int(a + k) + 1, value, kind))
    return tuple(found)


def _runs(x: NDArray[np.float64]) -> Runs:
    starts, lengths, total = [], [], 0
    row, before = 0, math.nan  # the first row and value of the run that is going on
    for part in pieces(x.size, BLOCK):
        v = x[part]
        new = np.empty(v.size, dtype=bool)
        new[0] = v[0] != before
        new[1:] = ~(v[1:] == v[:-1])  # nan is a run of its own
        total += v.size - int(new.sum())
        at = np.concatenate([[row], part.start + np.flatnonzero(new)])
        run = np.diff(at) - 1
        starts.append(at[:-1][run >= _SHORTEST])
        lengths.append(run[run >= _SHORTEST])
        row, before = int(at[-1]), float(v[-1])
    last = x.size - 1 - row
    if last >= _SHORTEST:
        starts.append(np.array([row]))
        lengths.append(np.array([last]))
    if not starts:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), 0
    return np.concatenate(starts).astype(np.int64), np.concatenate(lengths).astype(np.int64), total


def stuck_rows(y: ArrayLike, noise_sd: float, *, rho: float = 0.0, resolution: float | None = None
               ) -> NDArray[np.bool_]:
    """Readings that repeat the one before because the sensor holds it, True (n,); the first of them is a reading.

    noise_sd: what the sensor scatters by at rest, in the unit of y, and rho: its correlation from row to row. Where it
    does not scatter, repeats say nothing. resolution: its step, in the unit of y. Where a wave turns readings stand
    still: runs are as long there as the noise makes them within one step. A value that is held several times is a
    limit, the end of a range within drop-outs, and is left to those who ask for it; a sensor that repeats itself most
    of the time has steps coarser than its noise.
    """
    x = np.asarray(y, dtype=float)
    out = beside(x, np.bool_)
    step = resolution or 0.0
    # of two values side by side rounding alone may make a scatter of half a step
    own = math.sqrt(max(noise_sd**2 - 0.25 * step**2, 0.0))
    runs = _runs(x) if own > 0.0 else None
    if runs is None or runs[2] > _COARSE * x.size:
        return out
    least = math.erf(step / (math.sqrt(8.0 * (1.0 - rho**2)) * own))
    flats = [f for f in _too_long(x, runs, FALSE_ALARM, least) if f.kind == "stuck"]
    values = [f.value for f in flats]
    for f in flats:
        if values.count(f.value) == 1:
            out[f.start + 1 : f.stop] = True
    return out

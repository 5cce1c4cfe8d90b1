"""Stretches in which a sensor repeats itself: stuck, or clipped at the end of its range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Flat:
    """Rows start..stop-1 hold one value. kind: "stuck", or "clipped" at the extreme of the recording."""

    start: int
    stop: int
    value: float
    kind: str


def find_flat(y: ArrayLike, *, false_alarm: float = 1e-6) -> tuple[Flat, ...]:
    """Runs of equal readings that are too long to be chance.

    With p the share of readings equal to the one before (long runs left out), a run of k repeats has a
    chance of about n p^k; runs below `false_alarm` are reported. Data that scarcely ever change (a
    resolution much coarser than the noise) give p near one, and nothing is reported.

    Parameters
    ----------
    y : output, shape (n,); nan cells end a run.
    """
    x = np.asarray(y, dtype=float)
    if x.size < 16:
        return ()
    same = np.zeros(x.size + 1, dtype=bool)
    same[1:-1] = x[1:] == x[:-1]
    change = np.diff(same.astype(np.int8))
    first, last = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    if first.size == 0:
        return ()
    length = last - first  # repeats; rows first..last
    limit = math.inf
    # long runs raise the share that they are judged by: leave out what was found and judge again
    for _ in range(3):
        short = length < limit
        repeats = int(length[short].sum())
        share = (repeats + 1) / max(1, x.size - int(length[~short].sum()))
        if share >= 0.999:
            return ()
        limit = max(5.0, math.log(false_alarm / x.size) / math.log(share))
    found = []
    low, high = float(np.nanmin(x)), float(np.nanmax(x))
    for a, b in zip(first[length >= limit], last[length >= limit], strict=True):
        value = float(x[a])
        kind = "clipped" if value in (low, high) and low < high else "stuck"
        found.append(Flat(int(a), int(b) + 1, value, kind))
    return tuple(found)


def flat_warning(flats: tuple[Flat, ...], name: str) -> str | None:
    """One line that a person can act on, or None."""
    if not flats:
        return None
    rows = sum(f.stop - f.start for f in flats)
    clipped = sum(f.kind == "clipped" for f in flats)
    worst = max(flats, key=lambda f: f.stop - f.start)
    what = "clipped at the end of the sensor's range" if clipped == len(flats) else (
        "stuck" if clipped == 0 else "stuck or clipped")
    return (f"{name}: {rows} readings in {len(flats)} stretches look {what} (longest: rows "
            f"{worst.start + 1} to {worst.stop}, all {worst.value:.6g}); "
            "check the sensor, or make these cells nan")

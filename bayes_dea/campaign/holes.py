"""Stretches of time in which a logger recorded nothing: where they are, and what is said of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.gaps import MANY, NAMED, times
from bayes_dea.campaign.schema import Recording

#: steps of the usual length, and of those beside it, from which on one is a hole
_LONG = 10.0
#: steps by which the usual one is judged, and rows looked at at a time
_JUDGED = _PIECE = 1_000_000


def holes_in(time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Rows (from 0) of times (n,) in s after which nothing was recorded for more than ten steps.

    A log-spaced creep recording has ever longer steps; a hole is long against its neighbours too.
    """
    median = float(np.median(some_steps(time)))
    found = [np.empty(0, dtype=np.intp)]
    for begin in range(0, time.size - 1, _PIECE):
        before = max(begin - 1, 0)
        steps = np.diff(time[before : begin + _PIECE + 2])
        beside = np.maximum(np.concatenate(([0.0], steps[:-1])), np.concatenate((steps[1:], [0.0])))
        rows = before + np.flatnonzero((steps > _LONG * median) & (steps > _LONG * beside))
        found.append(rows[(rows >= begin) & (rows < begin + _PIECE)])
    return np.concatenate(found)


def some_steps(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Steps (s) of times (n,); of a long recording a million from all over it."""
    some = np.linspace(0, time.size - 2, min(time.size - 1, _JUDGED)).astype(int)
    return np.asarray(time[some + 1] - time[some])


def hole_warnings(recordings: Sequence[Recording], where: Sequence[Callable[[int], str]]) -> list[str]:
    """Recording by recording where few have some, in one line where many do. where: says where rows stand."""
    found = []
    for r, at in zip(recordings, where, strict=True):
        rows = holes_in(r.time_s) if r.kind != "capacitance" and "time_s" in r.columns else np.empty(0, dtype=np.intp)
        if rows.size:
            found.append((r, rows, at))
    if len(found) < MANY:
        return [
            f"{r.name}: time_s has {times(rows.size, 'hole')} longer than ten steps, the first ({_first(r, rows, at)}; "
            "nothing is known in between."
            for r, rows, at in found
        ]
    most = sorted(found, key=lambda f: -f[1].size)[:NAMED]
    named = "; ".join(f"{r.name}: {rows.size}, the first ({_first(r, rows, at)}" for r, rows, at in most)
    count = sum(rows.size for _, rows, _ in found)
    return [
        f"time_s has {times(count, 'hole')} longer than ten steps in {len(found)} recordings, the most in {named}; "
        "nothing is known in between."
    ]


def _first(r: Recording, rows: NDArray[np.intp], where: Callable[[int], str]) -> str:
    """How long the first of holes is, and the row behind it: "0.03 s) before row 12"."""
    row = int(rows[0])
    return f"{r.time_s[row + 1] - r.time_s[row]:.4g} s) before {where(row + 1)}"

"""Escape from a local minimum: scan each coordinate over its whole box, polish from the dips it shows.

A swarm collapses onto the basin it saw first. One line scan per coordinate is cheap where the objective is
vectorised, and a narrow basin that differs mainly in one coordinate (a peak's position, a rate) shows on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayes_dea.fit.swarm import Array, Objective, Polish


@dataclass(frozen=True)
class EscapeSettings:
    """grid: points a coordinate; candidates: dips polished a round, per coordinate; rounds: at most;
    gain: betterment of the objective that counts as another basin."""

    grid: int = 256
    candidates: int = 2
    rounds: int = 6
    gain: float = 1e-3


def escape(
    objective: Objective, polish: Polish, x: Array, value: float, lower: Array, upper: Array,
    settings: EscapeSettings | None = None,
) -> tuple[Array, float]:  # fmt: skip
    """Leave x for a lower minimum as long as coordinate scans find one.

    objective: (n, d) -> (n,), not finite counts as +inf; polish: (d,) -> ((d,), value) and may be rough;
    x: (d,) with its value; lower, upper: (d,). Returns the best point and its value. Deterministic.
    """
    s = settings or EscapeSettings()
    d = len(x)
    fractions = (np.arange(s.grid) + 0.5) / s.grid
    for _ in range(s.rounds):
        lines = np.repeat(x[None], d * s.grid, axis=0).reshape(d, s.grid, d)
        for i in range(d):
            lines[i, :, i] = lower[i] + fractions * (upper[i] - lower[i])
        v = np.asarray(objective(lines.reshape(-1, d)), float).reshape(d, s.grid)
        v = np.where(np.isfinite(v), v, np.inf)
        wall = np.full((d, 1), np.inf)
        dip = np.isfinite(v) & (v <= np.hstack([wall, v[:, :-1]])) & (v <= np.hstack([v[:, 1:], wall]))
        # The dip around x itself leads back to x.
        here = np.clip(((x - lower) / (upper - lower) * s.grid).astype(int), 0, s.grid - 1)
        for shift in (-1, 0, 1):
            dip[np.arange(d), np.clip(here + shift, 0, s.grid - 1)] = False
        rows, columns = np.nonzero(dip)
        order = np.argsort(v[rows, columns], kind="stable")[: s.candidates * d]
        best_x, best = x, value
        for k in order:
            found, f = polish(lines[rows[k], columns[k]])
            if np.isfinite(f) and f < best:
                best_x, best = found, f
        if not best < value - s.gain:
            break
        x, value = best_x, best
    return x, value

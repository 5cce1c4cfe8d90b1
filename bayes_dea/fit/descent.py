"""Newton steps of several runs side by side, to the bottom of the basin each stands in.

For functions of few coordinates that are cheap where many points are asked for at once: all stencils of a step are one
call, and so are all trials. No proof of a minimum and no Hessian, as `polish_newton` gives: it tells runs in one basin
from runs in several, and takes over from a swarm that would contract for a long time yet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: lengths of a step that are tried, of the Newton step; and those after a step of which none was of use
_LENGTHS = np.array([2.0, 1.0, 0.5, 0.2, 0.05])
_SHORTER = 0.05


@dataclass(frozen=True)
class DescentSettings:
    """tolerance: expected gain of a further step at which a run ends, in units of the objective; step: half-width of
    the stencil in units of the local Gaussian's standard deviations; first: the same at the start, as a share of
    `scale`; reach: longest step, in units of `scale`."""

    tolerance: float = 1e-5
    max_iterations: int = 15
    step: float = 0.1
    first: float = 0.02
    reach: float = 1.0


def descend(
    objective: Callable[[Array], Array], starts: ArrayLike, scale: ArrayLike, settings: DescentSettings | None = None
) -> tuple[Array, Array, int]:
    """Damped Newton descent from starts (k, d): ends (k, d), their values (k,), and points evaluated.

    objective: (n, d) -> (n,), a value that is not finite counts as +inf. scale: (d,), a length of each coordinate over
    which the objective may be another one. A run never ends higher than it began.
    """
    s = settings or DescentSettings()
    x = np.array(starts, float, ndmin=2)
    scale = np.asarray(scale, float)
    k, d = x.shape
    evaluations = 0

    def f(points: Array) -> Array:
        nonlocal evaluations
        evaluations += points.shape[0] * points.shape[1]
        with np.errstate(all="ignore"):
            values = np.asarray(objective(points.reshape(-1, d)), float).reshape(points.shape[:2])
        return np.where(np.isfinite(values), values, np.inf)

    value = f(x[:, None])[:, 0]
    axes = np.tile(np.diag(s.first * scale), (k, 1, 1)) / s.step
    damping = np.ones(k)
    going = np.isfinite(value)
    pairs = [(i, j) for i in range(d) for j in range(i)]
    stencil = np.zeros((2 * d + len(pairs), d))
    stencil[np.arange(d), np.arange(d)], stencil[d + np.arange(d), np.arange(d)] = s.step, -s.step
    for n, pair in enumerate(pairs):
        stencil[2 * d + n, pair] = s.step
    for _ in range(s.max_iterations):
        run = np.flatnonzero(going)
        if run.size == 0:
            break
        here, t = value[run], axes[run]
        v = f(x[run, None] + np.einsum("sj,rij->rsi", stencil, t))
        # at the rim of what is defined: come closer
        whole = np.isfinite(v).all(axis=1)
        axes[run[~whole]] *= 0.1
        run, here, t, v = run[whole], here[whole], t[whole], v[whole]
        if run.size == 0:
            continue
        up, down = v[:, :d], v[:, d : 2 * d]
        slope = (up - down) / (2 * s.step)
        curvature = np.zeros((run.size, d, d))
        curvature[:, np.arange(d), np.arange(d)] = (up - 2 * here[:, None] + down) / s.step**2
        for n, (i, j) in enumerate(pairs):
            mixed = (v[:, 2 * d + n] - up[:, i] - up[:, j] + here) / s.step**2
            curvature[:, i, j] = curvature[:, j, i] = mixed
        eig, vec = np.linalg.eigh(curvature)
        slope = np.einsum("rij,ri->rj", vec, slope)
        # directions that curve the wrong way, or hardly, are gone down as if they curved upwards
        size = np.maximum(np.abs(eig), 1e-6)
        step = -np.einsum("rij,rj->ri", np.einsum("rij,rjk->rik", t, vec), slope / size)
        gain = 0.5 * np.sum(slope**2 / size, axis=1)
        flat = (gain < s.tolerance) & (eig.min(axis=1) > 0)
        step /= np.maximum(np.max(np.abs(step) / (s.reach * scale), axis=1), 1.0)[:, None]
        trials = x[run, None] + (damping[run, None] * _LENGTHS)[:, :, None] * step[:, None]
        values = f(trials)
        best = np.argmin(values, axis=1)
        new = values[np.arange(run.size), best]
        better = new < here
        x[run[better]] = trials[better, best[better]]
        value[run[better]] = new[better]
        axes[run] = np.einsum("rij,rjk->rik", t, vec) / np.sqrt(np.clip(size, 1e-4, 1e8))[:, None, :]
        # no length was of use: shorter ones, and if these are of none either it is as good as it gets
        stuck = ~better & (damping[run] < 1.0)
        damping[run] = np.where(better, 1.0, _SHORTER)
        going[run] = ~(flat | stuck)
    return x, value, evaluations

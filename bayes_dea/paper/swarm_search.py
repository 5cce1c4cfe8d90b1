"""The paper's search: a particle swarm over factors on a start, in a box, and a local search from its best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]


@dataclass(frozen=True)
class SwarmSearch:
    """Kennedy and Eberhart's swarm with adaptive inertia and random neighbourhoods, stopped when it stalls.

    `inertia` as the paper restricts it. `iterations` and `stall` are less than its 10000 and 1000: the objective costs
    microseconds here and the local search follows; `tolerance` is relative, as in the paper.
    """

    iterations: int = 250
    stall: int = 40
    tolerance: float = 1e-6
    inertia: tuple[float, float] = (0.5, 1.0)
    own: float = 1.49
    social: float = 1.49
    neighbours: float = 0.25


@dataclass(frozen=True)
class Found:
    """Factors (d,), value there, and whether a factor ends at its bound (d,)."""

    factors: Array
    value: float
    at_bound: NDArray[np.bool_]


def search(
    objective: Objective, low: Array, high: Array, start: Array, rng: np.random.Generator, s: SwarmSearch | None = None
) -> Found:
    """Least value of a vectorised objective (m, d) -> (m,) in a box; `start` (k, d) are the first particles."""
    from scipy.optimize import minimize

    s = s or SwarmSearch()
    low, high = np.asarray(low, float), np.asarray(high, float)
    d = low.size
    count = min(100, 10 * d)
    x = low + (high - low) * rng.random((count, d))
    first = np.clip(np.atleast_2d(start), low, high)[:count]
    x[: len(first)] = first
    v = (high - low) * rng.uniform(-1.0, 1.0, (count, d))
    value = _finite(objective(x))
    best_x, best = x.copy(), value.copy()
    smallest = max(2, int(count * s.neighbours))
    near, inertia, waits, stalled = smallest, s.inertia[1], 0, 0
    reference = best.min()
    for _ in range(s.iterations):
        told = rng.integers(count, size=(count, near))
        leader = told[np.arange(count), np.argmin(best[told], axis=1)]
        v = (
            inertia * v
            + s.own * rng.random((count, d)) * (best_x - x)
            + s.social * rng.random((count, d)) * (best_x[leader] - x)
        )
        x = x + v
        outside = (x < low) | (x > high)
        x = np.clip(x, low, high)
        v[outside] = 0.0
        value = _finite(objective(x))
        better = value < best
        before = best.min()
        best_x[better], best[better] = x[better], value[better]
        if best.min() < before:
            waits, near = max(waits - 1, 0), smallest
            inertia = inertia * 2.0 if waits < 2 else inertia / 2.0 if waits > 5 else inertia
            inertia = float(np.clip(inertia, *s.inertia))
        else:
            waits, near = waits + 1, min(near + smallest, count)
        stalled = 0 if best.min() < reference * (1.0 - s.tolerance) else stalled + 1
        reference = min(reference, float(best.min()))
        if stalled >= s.stall:
            break
    top = best_x[int(np.argmin(best))]

    def single(z: Array) -> float:
        return float(_finite(objective(np.clip(z, low, high)[None]))[0])

    local = minimize(
        single,
        top,
        method="Nelder-Mead",
        bounds=list(zip(low, high, strict=True)),
        options={"maxfev": 150 * d, "xatol": 1e-5, "fatol": 1e-7 * float(best.min())},
    )
    final = local.x if local.fun <= best.min() else top
    reach = 1e-3 * (high - low)
    at = (final <= low + np.minimum(reach, 1e-3 * np.abs(low))) | (final >= high - reach)
    return Found(np.asarray(final), float(min(local.fun, best.min())), at)


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, 1e99)

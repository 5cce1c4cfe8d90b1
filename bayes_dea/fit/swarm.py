"""Particle swarms: global minimisation in a box, several independent swarms side by side.

The update is the rotation-invariant one of Standard PSO 2011 (Clerc 2012; Zambrano-Bigiarini et al. 2013,
doi:10.1109/CEC.2013.6557848): a point is drawn in a ball around the centre of gravity of the particle, its
own best and its neighbours' best. Each swarm has its own stream of random numbers, so the result of one swarm
does not depend on how many others run beside it; only how long it goes on may (`settled_swarms`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import InputError

Array = NDArray[np.float64]
Objective = Callable[[Array], Array]
Polish = Callable[[Array], tuple[Array, float]]
Settle = Callable[[Array], tuple[Array, Array]]

#: distance in the unit cube from which on two points of a swarm may lie in basins of their own
_FAR = 0.2


@dataclass(frozen=True)
class SwarmSettings:
    """How a swarm moves and when it stops.

    `tolerance` is in units of the objective: an iteration that betters the best value by less counts as
    stalled, and `stall_iterations` of these in a row end the swarm.
    """

    particles: int = 40
    max_iterations: int = 300
    max_evaluations: int | None = None
    stall_iterations: int = 30
    tolerance: float = 1e-3
    topology: Literal["random", "ring"] = "random"
    neighbours: int = 3
    inertia: float = 1.0 / (2.0 * np.log(2.0))
    acceleration: float = 0.5 + np.log(2.0)
    walls: Literal["reflect", "absorb"] = "reflect"

    def __post_init__(self) -> None:
        if self.particles < 2:
            raise InputError(f"particles: a swarm of {self.particles} cannot move; give at least 2")
        if self.max_iterations < 1 or self.stall_iterations < 1:
            raise InputError("max_iterations and stall_iterations of a swarm must be at least 1")
        if self.max_evaluations is not None and self.max_evaluations < self.particles:
            raise InputError(
                f"max_evaluations: {self.max_evaluations} is less than one evaluation for each of "
                f"{self.particles} particles; raise it or take fewer particles"
            )


@dataclass(frozen=True)
class SwarmResult:
    """What one swarm found.

    x: (d,); value: objective at x; population: (particles, d) personal bests with population_values;
    reason: "stalled", "iterations" or "evaluations".
    """

    x: Array
    value: float
    iterations: int
    evaluations: int
    reason: str
    population: Array = field(repr=False)
    population_values: Array = field(repr=False)


@dataclass(frozen=True)
class MultiSwarmResult:
    """What several swarms found, each after its polish.

    x: (d,) the best point; value: its objective; agree: how many swarms (the best one included) end within
    `tolerance` of it; points: (swarms, d); values: (swarms,); evaluations: by the swarms, without polish.
    """

    x: Array
    value: float
    agree: int
    tolerance: float
    points: Array = field(repr=False)
    values: Array
    evaluations: int
    swarms: tuple[SwarmResult, ...] = field(repr=False)


@dataclass(frozen=True)
class SettledSwarms:
    """Where several swarms lead.

    ends: (swarms, e) in the coordinates of the descent, values: (swarms,) their objective; agree: how many are within
    the tolerance of the best; evaluations: by the swarms, without the descents; swarms: as each stood at its end, its
    reason "agreed" where it was not asked to go on.
    """

    ends: Array
    values: Array
    agree: int
    evaluations: int
    swarms: tuple[SwarmResult, ...] = field(repr=False)


def unit_box(d: int) -> tuple[Array, Array]:
    """The unit cube (prior quantiles) in d dimensions: lower and upper, each (d,)."""
    return np.zeros(d), np.ones(d)


def particle_swarm(
    objective: Objective,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SwarmSettings,
    rng: np.random.Generator,
    start: Array | None = None,
) -> SwarmResult:
    """Minimise a vectorised objective in a box with one swarm.

    objective: (n, d) -> (n,), a value that is not finite counts as +inf. lower, upper: (d,), finite.
    start: (k, d) points that replace the first k of the Latin hypercube, clipped to the box.
    Raises InputError for a box that is empty or not finite, and when no point at all had a finite value.
    """
    swarm = _Swarm(*_checked_box(lower, upper), settings, rng, start)
    while not swarm.reason:
        swarm.tell(_evaluate(objective, swarm.ask()))
    result = swarm.result()
    if not np.isfinite(result.value):
        raise InputError(_nothing_finite(result.evaluations))
    return result


def multi_swarm(
    objective: Objective,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SwarmSettings,
    rng: np.random.Generator,
    *,
    swarms: int = 8,
    polish: Polish | None = None,
    tolerance: float = 0.1,
    start: Array | None = None,
) -> MultiSwarmResult:
    """Run independent swarms in step (one call of the objective for all), polish each, count who agrees.

    polish: (d,) -> ((d,), value); a polish that ends higher than its swarm is dropped.
    tolerance: in units of the objective (nats for a negative log posterior).
    Raises InputError as `particle_swarm` does.
    """
    if swarms < 1:
        raise InputError(f"swarms: {swarms} asked for; give at least 1")
    box = _checked_box(lower, upper)
    flock = [_Swarm(*box, settings, child, start) for child in rng.spawn(swarms)]
    while active := [s for s in flock if not s.reason]:
        asked = [s.ask() for s in active]
        values = _evaluate(objective, np.concatenate(asked))
        ends = np.cumsum([len(a) for a in asked])[:-1]
        for swarm, part in zip(active, np.split(values, ends), strict=True):
            swarm.tell(part)
    results = tuple(s.result() for s in flock)
    evaluations = sum(r.evaluations for r in results)
    if not any(np.isfinite(r.value) for r in results):
        raise InputError(_nothing_finite(evaluations))
    points = np.array([r.x for r in results])
    final = np.array([r.value for r in results])
    if polish is not None:
        for i, r in enumerate(results):
            if np.isfinite(r.value):
                x, value = polish(r.x)
                if np.isfinite(value) and value <= final[i]:
                    points[i], final[i] = x, value
    best = int(np.argmin(final))
    agree = int(np.sum(final - final[best] <= tolerance))
    return MultiSwarmResult(
        points[best].copy(), float(final[best]), agree, tolerance, points, final, evaluations, results
    )


def settled_swarms(
    objective: Objective,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: SwarmSettings,
    rng: np.random.Generator,
    settle: Settle,
    *,
    swarms: int = 8,
    first_look: int = 8,
    tolerance: float = 0.1,
    each: int = 1,
) -> SettledSwarms:
    """Independent swarms that need not contract: they end as soon as the basins they have found are one.

    settle: (k, d) -> ((k, e), (k,)), descends from points of the swarms: ends, in coordinates of its own, and values
    of the objective. After `first_look` iterations all are settled, each swarm from its best point and from the best
    ones far from that and from each other, up to `each` of them: what a swarm gathers around is the widest basin, and
    need not be the deepest. Those that do not lead within `tolerance` of the best go on, and are looked at again after
    twice as many iterations, until all agree or stall. Raises InputError as `particle_swarm` does.
    """
    if swarms < 1 or each < 1:
        raise InputError(f"swarms: {swarms} asked for, settled from {each} points each; give at least 1")
    box = _checked_box(lower, upper)
    flock = [_Swarm(*box, settings, child, None) for child in rng.spawn(swarms)]
    ends: list[Array] = [np.empty(0)] * swarms
    values = np.full(swarms, np.inf)
    looked = np.zeros(swarms, int)
    apart = np.ones(swarms, bool)
    look = first_look
    while going := [s for s, other in zip(flock, apart, strict=True) if other and not s.reason]:
        while active := [s for s in going if not s.reason and s.iterations < look]:
            asked = [s.ask() for s in active]
            told = _evaluate(objective, np.concatenate(asked))
            for swarm, part in zip(active, np.split(told, np.cumsum([len(a) for a in asked])[:-1]), strict=True):
                swarm.tell(part)
        look *= 2
        # what a swarm has found since it was last looked at
        new = [i for i, s in enumerate(flock) if s.iterations > looked[i] and np.isfinite(s.best_f.min())]
        if not new:
            continue
        spread = [flock[i].spread(each) for i in new]
        found, lowest = settle(np.concatenate(spread))
        for i, n in zip(np.repeat(new, [len(x) for x in spread]), range(len(found)), strict=True):
            looked[i] = flock[i].iterations
            if not ends[i].size or lowest[n] < values[i]:
                ends[i], values[i] = found[n], lowest[n]
        apart = ~(np.isfinite(values) & (values <= values.min() + tolerance))
    if not np.isfinite(values).any():
        raise InputError(_nothing_finite(sum(s.evaluations for s in flock)))
    for s in flock:
        s.reason = s.reason or "agreed"
    nowhere = np.full_like(ends[int(np.argmin(values))], np.nan)
    return SettledSwarms(
        np.array([e if e.size else nowhere for e in ends]),
        values,
        int(np.sum(~apart)),
        sum(s.evaluations for s in flock),
        tuple(s.result() for s in flock),
    )


class _Swarm:
    """One swarm as ask (where to evaluate) and tell (what came out)."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        settings: SwarmSettings,
        rng: np.random.Generator,
        start: Array | None,
    ) -> None:
        self.lower, self.upper, self.s, self.rng = lower, upper, settings, rng
        m, d = settings.particles, len(lower)
        # Latin hypercube: every particle is alone in its slice of every coordinate.
        slices = np.argsort(rng.random((d, m)), axis=1).T
        unit = (slices + rng.random((m, d))) / m
        if start is not None:
            given = np.atleast_2d(np.asarray(start, float))[:m]
            unit[: len(given)] = np.clip((given - lower) / (upper - lower), 0.0, 1.0)
        # The swarm itself lives in the unit cube, so its ball is round whatever the units of the box.
        self.x = unit
        self.v = rng.random((m, d)) - unit
        self.best_x = unit.copy()
        self.best_f = np.full(m, np.inf)
        self.reference = np.inf
        self.informed = self._neighbours()
        self.iterations = self.evaluations = self.stalled = 0
        self.reason = ""

    def ask(self) -> Array:
        return self._physical(self.x)

    def tell(self, values: Array) -> None:
        self.evaluations += len(values)
        before = self.best_f.min()
        better = values < self.best_f
        self.best_x[better] = self.x[better]
        self.best_f[better] = values[better]
        best = self.best_f.min()
        if not np.isfinite(best) or not best < self.reference - self.s.tolerance:
            self.stalled += 1
        else:
            self.reference, self.stalled = best, 0
        self.iterations += 1
        if self.s.topology == "random" and not best < before:
            self.informed = self._neighbours()
        budget = self.s.max_evaluations
        if self.stalled >= self.s.stall_iterations:
            self.reason = "stalled"
        elif self.iterations >= self.s.max_iterations:
            self.reason = "iterations"
        elif budget is not None and self.evaluations + len(values) > budget:
            self.reason = "evaluations"
        else:
            self._move()

    def result(self) -> SwarmResult:
        best = int(np.argmin(self.best_f))
        population = self._physical(self.best_x)
        return SwarmResult(
            population[best].copy(), float(self.best_f[best]), self.iterations, self.evaluations, self.reason,
            population, self.best_f.copy(),
        )  # fmt: skip

    def spread(self, most: int) -> Array:
        """The best point and then the best ones that lie far from those before, (n, d) with n at most `most`."""
        order = np.argsort(self.best_f, kind="stable")
        kept: list[int] = []
        for i in order[np.isfinite(self.best_f[order])]:
            if len(kept) == most:
                break
            if all(np.linalg.norm(self.best_x[i] - self.best_x[j]) > _FAR for j in kept):
                kept.append(int(i))
        return self._physical(self.best_x[kept])

    def _physical(self, unit: Array) -> Array:
        return np.clip(self.lower + unit * (self.upper - self.lower), self.lower, self.upper)

    def _neighbours(self) -> NDArray[np.bool_]:
        """informed[i, j]: particle i hears of particle j; everyone hears of itself."""
        m = self.s.particles
        informed = np.eye(m, dtype=bool)
        if self.s.topology == "ring":
            for shift in (-1, 1):
                informed |= np.roll(np.eye(m, dtype=bool), shift, axis=1)
        else:
            told = self.rng.integers(m, size=(m, self.s.neighbours))
            informed[told, np.arange(m)[:, None]] = True
        return informed

    def _move(self) -> None:
        m, d = self.x.shape
        leader = np.argmin(np.where(self.informed, self.best_f[None, :], np.inf), axis=1)
        # Where no neighbour has a finite value argmin says 0, which is as good as any.
        own = self.s.acceleration * (self.best_x - self.x)
        social = self.s.acceleration * (self.best_x[leader] - self.x)
        alone = (leader == np.arange(m))[:, None]
        centre = np.where(alone, own / 2.0, (own + social) / 3.0)
        direction = self.rng.standard_normal((m, d))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        radius = np.linalg.norm(centre, axis=1, keepdims=True) * self.rng.random((m, 1))
        self.v = self.s.inertia * self.v + centre + radius * direction
        x = self.x + self.v
        out = (x < 0.0) | (x > 1.0)
        if self.s.walls == "reflect":
            self.v = np.where(out, -0.5 * self.v, self.v)
            x = np.where(x < 0.0, -x, np.where(x > 1.0, 2.0 - x, x))
        else:
            self.v = np.where(out, 0.0, self.v)
        self.x = np.clip(x, 0.0, 1.0)


def _evaluate(objective: Objective, x: Array) -> Array:
    values = np.asarray(objective(x), dtype=float)
    if values.shape != (len(x),):
        raise InputError(f"objective: expected {len(x)} values for {len(x)} points, got shape {values.shape}")
    return np.where(np.isfinite(values), values, np.inf)


def _checked_box(lower: ArrayLike, upper: ArrayLike) -> tuple[Array, Array]:
    lo, hi = np.atleast_1d(np.asarray(lower, float)), np.atleast_1d(np.asarray(upper, float))
    if lo.ndim != 1 or lo.shape != hi.shape or lo.size == 0:
        raise InputError(f"box: lower has shape {lo.shape}, upper {hi.shape}; give two vectors of one length")
    wrong = np.flatnonzero(~(np.isfinite(lo) & np.isfinite(hi) & (lo < hi)))
    if wrong.size:
        i = int(wrong[0])
        raise InputError(f"box: coordinate {i} runs from {lo[i]} to {hi[i]}; give finite lower < upper")
    return lo, hi


def _nothing_finite(evaluations: int) -> str:
    return (
        f"objective: not one of {evaluations} points in the box had a finite value; "
        "check the box (prior) against the model's domain"
    )

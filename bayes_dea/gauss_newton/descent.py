"""The descent of a fit: Levenberg-Marquardt along the chart (`chart`), with as few sensitivities as will do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .chart import carried, moved
from .damping import FIRST, after, metric_root, share_that_holds, stronger
from .journal import digest
from .problem import Kept, Problem
from .whitening import Noise

Array = NDArray[np.float64]
#: lower and upper bounds (d,) of coordinates
Box = tuple[Array, Array]
_PRIOR_STEP = 1e-3
#: share of the range of a flat prior by which coordinates keep off its ends
MARGIN = 1e-6
#: steps of an approach, and the nats that its last one promises
_APPROACH, _NEAR = 25, 0.05
#: nats of misfit beyond that of noise from which on a coarse descent ends earlier, by as much as the misfit is larger
_FAR_OFF = 100.0
#: how often a step may be shortened
_ATTEMPTS = 12
#: share of its promise below which a step that brings too little to go on is followed by a shorter one
_AT_A_BUMP = 0.1
#: sensitivities are carried on from step to step as long as a step brings what they promised, within these factors,
#: and for so many steps
_AS_PROMISED, _CARRIED = (0.75, 1.35), 6
#: share of what was promised that a step has to bring for sensitivities of another fit to do
_LIKE = 0.5
#: share of what the whole step promised that a shortened one brings where sensitivities tell next to nothing of the way
#: (corners of friction closer than the step), and of what is left; nats that are to be left, and how many of these
#: steps in a row end a coarse descent
_NEXT_TO_NOTHING, _OF_LITTLE_USE, _BUMPY, _STUCK = 0.1, 0.005, 100.0, 3


@dataclass(frozen=True)
class Linearisation:
    """Predictions and sensitivities of a model at q, worked out before; not `exact`: those of a model like it."""

    q: Array
    clean: list[Array]
    slopes: list[Array]
    exact: bool = True

    @cached_property
    def key(self) -> str:
        """Digest of them."""
        return digest(self.q, self.clean, self.slopes, self.exact)


def prior_derivatives(problem: Problem, q: Array) -> tuple[float, Array, Array]:
    """Minus log prior, its gradient and its Hessian (made positive) by central differences.

    A flat prior between bounds curves like the normal of its variance. Where the recordings say nothing of such a
    parameter its width is then that of the box, not endless, and the evidence of the others keeps its meaning.
    """
    d = q.size
    scale = np.full(d, _PRIOR_STEP)
    scale[: problem.model.dimension] = _PRIOR_STEP * np.maximum(problem.model.priors.scales(), 1e-12)
    m = problem.model.dimension
    scale[m : m + problem.zero_mean.size] = _PRIOR_STEP * problem.zero_sd
    scale[m + problem.zero_mean.size :] = _PRIOR_STEP * problem.gain_sd
    points = [q]
    for i in range(d):
        for s in (1.0, -1.0):
            p = q.copy()
            p[i] += s * scale[i]
            points.append(p)
    pairs = [(i, j) for i in range(m) for j in range(i)]
    for i, j in pairs:
        for s in (1.0, -1.0):
            p = q.copy()
            p[i] += s * scale[i]
            p[j] += s * scale[j]
            points.append(p)
    f = -problem.log_prior(np.array(points))
    base = f[0]
    if not np.isfinite(base):  # outside the prior
        return float(base), np.zeros(d), np.zeros((d, d))
    up, down = f[1 : 2 * d + 1 : 2], f[2 : 2 * d + 2 : 2]
    # beyond a bound straight on, and no curvature of the edge; bounds are kept by the step itself
    up, down = np.where(np.isfinite(up), up, 2 * base - down), np.where(np.isfinite(down), down, 2 * base - up)
    up, down = np.where(np.isfinite(up), up, base), np.where(np.isfinite(down), down, base)
    gradient = (up - down) / (2 * scale)
    H = np.diag((up + down - 2 * base) / scale**2)
    both = f[1 + 2 * d :]
    for n, (i, j) in enumerate(pairs):
        total = both[2 * n] + both[2 * n + 1] - 2 * base
        if not np.isfinite(total):
            continue
        cross = 0.5 * (total / (scale[i] * scale[j]) - H[i, i] * scale[i] / scale[j] - H[j, j] * scale[j] / scale[i])
        H[i, j] = H[j, i] = cross
    values, vectors = np.linalg.eigh(0.5 * (H + H.T))
    low, high = bounds(problem)
    return float(base), gradient, (vectors * np.maximum(values, 0.0)) @ vectors.T + np.diag(12.0 / (high - low) ** 2)


def bounds(problem: Problem) -> Box:
    """Lower and upper bounds (d,) of the coordinates; infinite where the prior has none.

    What a prior allows of a modulus bounds no coordinate where modes take its place: there the density alone does.
    """
    low, high = np.full(problem.dimension, -np.inf), np.full(problem.dimension, np.inf)
    model = problem.model
    for i, (name, p) in enumerate(zip(model.coordinate_names, model.priors.free, strict=True)):
        if p.prior.family in ("uniform", "loguniform") and name in (p.name, f"log {p.name}"):
            a, b = (math.log(p.prior.a), math.log(p.prior.b)) if p.prior.is_log else (p.prior.a, p.prior.b)
            low[i], high[i] = a, b
    return low, high


def inner_bounds(problem: Problem) -> Box:
    """The same a little further in, where the density is that of the inside."""
    low, high = bounds(problem)
    margin = np.where(np.isfinite(high - low), MARGIN * (high - low), 0.0)
    return low + margin, high - margin


@dataclass(frozen=True)
class End:
    """Where a descent ended; value: minus log posterior without log det terms."""

    q: Array
    value: float
    steps: int
    gram: Array
    logdet: float
    clean: list[Array]
    slopes: list[Array]
    prior: tuple[float, Array, Array]
    exact: bool  # slopes were worked out at q, not carried on to it
    own: bool  # slopes are this model's, not those of another fit


@dataclass(frozen=True)
class Effort:
    """How far a descent goes: steps at most, and the nats that its last one promises.

    hopeless_above: given up where the value less ten times what the next step promises, before it is damped any
    further, lies above this. patience: steps before that: of what rings, the first ones promise little wherever they
    begin.
    coarse: what is far from an explanation ends earlier, and slopes at the end may be carried on from a step before.
    """

    max_steps: int
    tolerance: float
    hopeless_above: float = math.inf
    patience: int = 0
    coarse: bool = False


def descend(
    problem: Problem, q: Array, noise: Noise, box: Box, effort: Effort, kept: Kept | None = None,
    known: Linearisation | None = None,
) -> End | None:
    """Levenberg-Marquardt at fixed noise. None where the model has no answer at q.

    kept: sensitivities of another fit, for as long as they do; known: those at or near q.
    """
    journal = problem.journal
    if not journal.kept:
        return _finished(problem, noise, descended(problem, q, noise, box, effort, kept, known), effort.coarse)
    about = [None if k is None else k.key for k in (kept, known)]
    key = digest("descend", problem.key, q, noise.key, *box, effort, about)
    if key in journal:
        ended = journal[key]
        if ended is None:
            return None
        q = np.array(ended[0], dtype=float)
        gram, logdet, clean, slopes = problem.gram(q, noise)
        if not np.isfinite(gram).all():
            return None
        prior = prior_derivatives(problem, q)
        value = prior[0] + 0.5 * float(gram[0, 0])
        return End(q, value, ended[1], gram, logdet, clean, slopes, prior, exact=True, own=ended[2])
    end = descended(problem, q, noise, box, effort, kept, known)
    journal.put(key, None if end is None else [end.q.tolist(), end.steps, end.own])
    return _finished(problem, noise, end, effort.coarse)


def approach(
    problem: Problem, q: Array, noise: Noise, kept: Kept | None = None, hopeless_above: float = math.inf,
    patience: int = 0,
) -> End | None:
    """Near the maximum on whose slope q stands, to compare with others: a coarse `descend` within the bounds."""
    box = inner_bounds(problem)
    effort = Effort(_APPROACH, _NEAR, hopeless_above, patience=patience, coarse=True)
    return descend(problem, np.clip(q, *box), noise, box, effort, kept)


def _finished(problem: Problem, noise: Noise, end: End | None, coarse: bool) -> End | None:
    """An end with slopes that were worked out there, unless it is coarse."""
    if end is None or end.exact or coarse:
        return end
    gram, logdet, clean, slopes = problem.gram(end.q, noise, clean=end.clean)
    if not np.isfinite(gram).all():
        return None
    return replace(end, gram=gram, logdet=logdet, clean=clean, slopes=slopes, exact=True)


def descended(
    problem: Problem, q: Array, noise: Noise, box: Box, effort: Effort, kept: Kept | None = None,
    known: Linearisation | None = None,
) -> End | None:
    """`descend`, worked out, whatever a journal knows; slopes at the end may be carried on.

    Sensitivities are dear: a simulation for each coordinate. From step to step they are carried on by Broyden's update,
    and worked out again where a step does not bring what they promised, and where they promise no more.
    """
    (low, high), coarse = box, effort.coarse
    aged = 0  # steps since the sensitivities were worked out
    if known is None:
        gram, logdet, clean, slopes = problem.gram(q, noise, kept=kept)
    else:
        there = np.array_equal(known.q, q)
        clean = known.clean if there else problem.clean(q)
        weight = problem.tightness
        slopes = known.slopes if there else carried(problem, known.slopes, known.clean, clean, known.q, q, weight)
        gram, logdet = problem.sums(q, noise, clean, slopes)
        aged = 0 if there and known.exact else 1
    prior = prior_derivatives(problem, q)
    if not np.isfinite(gram).all() or not np.isfinite(prior[0]):
        return None
    damping, taken, stuck = FIRST, 0, 0
    noise_alone = 0.5 * sum(p.blocks.n for p in problem.pieces)
    tolerance = effort.tolerance
    while taken < effort.max_steps:
        value = prior[0] + 0.5 * float(gram[0, 0])
        if coarse:
            tolerance = effort.tolerance * max(1.0, (value - noise_alone) / _FAR_OFF)
        g = prior[1] - gram[0, 1:]
        H = gram[1:, 1:] + prior[2]
        root = metric_root(H, prior[2], problem.decoupled)
        metric = root.T @ root
        new: tuple[Array, float, list[Array]] | None = None
        ends, whole, shortened = False, 0.0, False
        for _attempt in range(_ATTEMPTS):
            step = bounded_step(H, g, damping * metric, q, low, high)
            promised = -float(g @ step + 0.5 * step @ H @ step)
            whole = max(whole, promised)
            hopeless = taken >= effort.patience and bool(value - 10.0 * whole > effort.hopeless_above)
            ends = hopeless or (promised < tolerance and aged == 0)
            if hopeless or promised < tolerance:
                break
            place = moved(problem, q, step, low, high)
            there_value, predicted = reached(problem, place, noise)
            if there_value < value:
                new = place, there_value, predicted
                break
            if aged or kept is not None:
                break
            shortened = True
            damping = stronger(H, g, root, damping, step, share_that_holds(promised, there_value - value))
        if new is None:
            if ends or (aged == 0 and kept is None):
                break
            # what promised nothing, or wrongly, was carried on or another fit's
            anew = kept if aged else None
            sums, logs, _, at = problem.gram(q, noise, kept=anew, clean=clean)
            if not np.isfinite(sums).all():
                break
            gram, logdet, slopes, kept, aged = sums, logs, at, anew, 0
            continue
        gained = value - new[1]
        left = value - noise_alone
        little = gained < min(_NEXT_TO_NOTHING * whole, _OF_LITTLE_USE * left)
        stuck = stuck + 1 if little and aged == 0 and kept is None else 0
        # what brings next to nothing of what it promised is at a bump, not at an end
        arrived = gained < 3 * tolerance and (coarse or gained > _AT_A_BUMP * promised)
        last = arrived or (coarse and stuck >= _STUCK and left > _BUMPY)
        if kept is not None and gained < _LIKE * promised:
            kept = None
            aged = _CARRIED
        if aged < (1 if last else _CARRIED) and (last or _AS_PROMISED[0] < gained / promised < _AS_PROMISED[1]):
            at = carried(problem, slopes, clean, new[2], q, new[0], np.diag(H))
            sums, logs = problem.sums(new[0], noise, new[2], at)
            since = aged + 1
        else:
            sums, logs, _, at = problem.gram(new[0], noise, kept=kept, clean=new[2])
            since = 0
        if not np.isfinite(sums).all():
            break  # a model that runs away there: what it answers has no slopes that a number can hold
        gram, logdet, clean, slopes, aged = sums, logs, new[2], at, since
        q, damping, taken = new[0], after(damping, gained / promised, shortened), taken + 1
        prior = prior_derivatives(problem, q)
        if last:
            break
    value = prior[0] + 0.5 * float(gram[0, 0])
    own = kept is None
    return End(q, value, taken, gram, logdet, clean, slopes, prior, exact=own and aged == 0, own=own)


def value_at(problem: Problem, q: Array, noise: Noise) -> float:
    """Minus log posterior at fixed noise without log det terms; infinite where the model has no answer."""
    return reached(problem, q, noise)[0]


def reached(problem: Problem, q: Array, noise: Noise) -> tuple[float, list[Array]]:
    """`value_at`, and the predictions; none where the model has no answer."""
    p = -float(problem.log_prior(q)[0])
    if not np.isfinite(p):
        return math.inf, []
    # the Jacobian is worked out only where a step is taken
    gram, _, clean, _ = problem.gram(q, noise, with_jacobian=False)
    return (p + 0.5 * float(gram[0, 0]), clean) if np.isfinite(gram).all() else (math.inf, [])


def bounded_step(H: Array, g: Array, damping: Array, q: Array, low: Array, high: Array) -> Array:
    """Gauss-Newton step with damping (d, d); coordinates that would leave their bounds stop at them."""
    d = q.size
    A = H + damping
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    step = np.zeros(d)
    free = np.ones(d, dtype=bool)
    for _ in range(d + 1):
        step[free] = 0.0
        rhs = -(g[free] + A[np.ix_(free, ~free)] @ step[~free])
        s = scale[free]
        step[free] = s * np.linalg.lstsq((A[np.ix_(free, free)] * s).T * s, s * rhs, rcond=1e-14)[0]
        new = q + step
        out = free & ((new < low) | (new > high))
        if not out.any():
            break
        step[out] = np.clip(new, low, high)[out] - q[out]
        free &= ~out
    return step

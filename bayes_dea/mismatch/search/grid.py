"""An effect on a grid over its own parameters, the base moved along linearly: one simulation a point.

Points at prior quantiles weigh it; further ones find what lies between them: limits that are just reached, peaks that
are narrow, resonances, effects that are weak.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...gauss_newton.refit import Fit
from ...models.model import Model
from .frame import Frame, insert, own_index
from .leak_starts import highest_field, leak_points
from .resonance import look_for_resonances
from .superposed import Superposed

Array = NDArray[np.float64]
#: points a parameter of the grid over prior quantiles, by the number of parameters
_POINTS = {0: (), 1: (13,), 2: (7, 4), 3: (5, 3, 2), 4: (4, 3, 2, 2)}
#: span (in logarithms) of a second parameter that two points are enough for
_NARROW = 3.5
#: distance (in logarithms) of points of a second parameter, at most: modes a factor of ten apart have little in common
_COARSEST = 2.0
#: quantiles of a log-normal strength below those of the grid
_WEAK = (0.02, 0.004)
#: the same of a strength that is uniform from zero, in shares of its range
_SLIGHT = (0.04, 0.008, 0.0016)
#: share of a uniform prior from zero at which what it refines is as good as absent
_ABSENT = 0.01
#: nats by which a limit that acts on nothing may differ from the base, sections of the search for one just reached
_IDLE = 1e-3
_SECTIONS = 12
#: share of what the grid spans by which a model that has the limit may differ from one that has none: it goes through a
#: recording row by row, and where much is left to explain a slight difference is several nats
_OTHER_ROAD = 0.01
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: how many times more than the best point of a grid gains (and the least gain in nats that counts) the next one has to
#: lose for a peak to be looked for between the two, and in how many sections
_STEEP, _HARDLY, _PEAK_SECTIONS = 10.0, 10.0, 8
#: sections where the best point is the first or the last, so that no parabola lies through its neighbours
_END_SECTIONS = 4
#: how often the vertex of a parabola is looked at, and the share of its width within which it is the point that it has
_PARABOLAS, _SAME = 2, 1e-3
#: further points of a bounded parameter that stands alone, in shares of its range from either end: a limit that is
#: just reached acts on nothing at the coarser points
_ENDS = (0.1, 0.05, 0.025, 0.012, 0.006, 0.003, 0.0015)


@dataclass(frozen=True)
class Scored:
    """A point of the grid: minus log posterior, the same without the prior of the effect's own parameters."""

    posterior: float
    likelihood: float
    own: Array
    move: Array
    frame: Frame


def grid_points(model: Model, index: NDArray[np.int64], values: dict[str, float], sparse: bool = False) -> list[Array]:
    """Points of the effects' own coordinates at prior quantiles; `values` of what they are relative to."""
    count = index.size
    if count == 0:
        return [np.zeros(0)]
    shape = _POINTS.get(count, (2,) * count)
    if sparse:
        shape = tuple(max(2, s // 2) for s in shape)
    if len(shape) == 2:
        # a damping or a yield strain within a decade and a half: a refit finds it from the nearer of two
        own = model.priors.free[index[1]].prior
        if own.family == "loguniform":
            span = math.log(own.b / own.a)
            shape = (shape[0], 2 if span < _NARROW else max(shape[1], math.ceil(span / _COARSEST)))
    axes = []
    for p, s in zip([model.priors.free[i] for i in index], shape, strict=True):
        shift = math.log(values[p.prior.relative_to]) if p.prior.relative_to else 0.0
        axes.append([float(p.prior.ppf(np.array([(j + 0.5) / s]), shift)[0]) for j in range(s)])
    return [np.array(point) for point in itertools.product(*axes)]


def finding_points(model: Model, index: NDArray[np.int64], values: dict[str, float], sparse: bool) -> list[Array]:
    """Further points where the grid of quantiles would miss an effect; they find, they do not weigh.

    Close to the ends of a uniform prior that stands alone, where a limit is just reached; for a strength among others,
    in the lower tail of its prior, because an effect that is three times too strong looks worse than none. There also
    where the last one of three, uniform from zero, is next to nothing: softening that comes at once is on the other
    side of a ridge.
    """
    priors = [model.priors.free[i].prior for i in index]
    if len(priors) == 1 and priors[0].family == "uniform":
        a, b = priors[0].a, priors[0].b
        return [np.array([x]) for share in _ENDS for x in (a + share * (b - a), b - share * (b - a))]
    if len(priors) not in (2, 3):
        return []
    if priors[0].family == "lognormal":
        shift = math.log(values[priors[0].relative_to]) if priors[0].relative_to else 0.0
        weak = [float(priors[0].ppf(np.array([quantile]), shift)[0]) for quantile in _WEAK]
    elif priors[0].family == "uniform" and priors[0].a == 0.0:
        weak = [share * priors[0].b for share in _SLIGHT]
    else:
        return []
    others = sorted({tuple(map(float, point[1:])) for point in grid_points(model, index, values, sparse)})
    if len(priors) == 3 and priors[2].family == "uniform" and priors[2].a == 0.0:
        others += [(x, _ABSENT * priors[2].b) for x in sorted({x for x, _ in others})]
    return [np.array([x, *rest]) for x in weak for rest in others]


@dataclass(frozen=True)
class Screened:
    """A hypothesis on its grid: every point scored with the base moved along linearly."""

    effects: tuple[str, ...]
    model: Model
    points: tuple[Scored, ...]  # best first
    log_evidence: float  # average over the grid
    base_objective: float  # of the base on the same scale as the points
    frames: tuple[Frame, ...]

    @property
    def gain(self) -> float:
        """Nats by which the best point beats the base."""
        return self.base_objective - self.points[0].posterior

    @property
    def promise(self) -> float:
        """Nats of likelihood by which the likeliest point beats the base: no matter of the parameters' units."""
        return self.base_objective - min(p.likelihood for p in self.points)

    @property
    def contrast(self) -> float:
        """Nats of likelihood between the base and the point that differs from it most."""
        return max(abs(p.likelihood - self.base_objective) for p in self.points)


def screen(
    frames: Sequence[Frame],
    model: Model,
    effects: tuple[str, ...],
    sparse: bool = False,
    series_ohm: float | None = None,
) -> Screened | None:
    """Score a grid over the effect's own parameters. None where it has no answer on these recordings.

    frames: the base fit, and others from which the base may be moved along (see `slow_start`). series_ohm: the
    resistance before a leak, where that is known about.
    """
    base = frames[0].fit
    problem = base.problem.with_model(model)
    index = own_index(base, model)
    own_names = {model.priors.free[i].name for i in index}
    d = base.problem.model.dimension
    added = [name for name in model.spec.effects if name not in base.problem.model.spec.effects]
    scored: list[Scored] = []
    main: list[float] = []
    weighed = 0  # points that the average is over: what has no answer there has no likelihood
    for frame in frames:
        own_fit = frame.fit
        before = float(own_fit.problem.model.log_prior(own_fit.q[None, :d])[0])
        weighing = grid_points(model, index, own_fit.values(), sparse)
        here: list[Scored] = []

        def prior_of(own: Array, fit: Fit = own_fit, before: float = before) -> float:
            return float(model.log_prior(insert(fit, model, own)[None, : model.dimension])[0]) - before

        def score(
            own: Array, frame: Frame = frame, here: list[Scored] = here, prior_of: Callable[[Array], float] = prior_of
        ) -> Scored | None:
            q, own_prior = insert(frame.fit, model, own), prior_of(own)
            if not np.isfinite(own_prior):
                return None
            found = frame.tried(problem, q, added)
            if found is None:
                return None
            value, move = found
            here.append(Scored(value - own_prior, value, own, move, frame))
            return here[-1]

        finding = finding_points(model, index, own_fit.values(), sparse)
        field = highest_field(problem.pieces)
        # the leak's own resistance, that of the base, and one that is known about
        resistances = {None if "R_s_ohm" in own_names else own_fit.values().get("R_s_ohm"), series_ohm}
        for ohm in (None, *sorted(x for x in resistances if x is not None)):
            finding += leak_points(model, index, field, sparse, ohm)
        for k, own in enumerate([*weighing, *finding]):
            point = score(own)
            if frame is frames[0] and k < len(weighing):
                weighed += bool(np.isfinite(prior_of(own)))
                main += [-point.likelihood] if point is not None else []
        if index.size == 1:
            idle = frame.value(frame.fit.clean)[0]
            if model.priors.free[index[0]].prior.family == "uniform":
                just_reached(here, idle, score)
            narrow_peak(here, idle, score)
            parabola(here, score)
        if rings(model, index):
            _score_resonances(frame, model, index, added, score)
        scored += here
    if not scored:
        return None
    scored.sort(key=lambda s: s.posterior)
    base_value = frames[0].value(base.clean)[0]
    # Laplace of the base beside each point; the noise's share is the base's
    constant = base.log_evidence + base_value
    grid = float(logsumexp(main) - math.log(weighed)) + constant if main else -math.inf
    return Screened(effects, model, tuple(scored), grid, base_value, tuple(frames))


def rings(model: Model, index: NDArray[np.int64]) -> bool:
    """Whether the own parameters are a frequency with known limits and a damping ratio."""
    first = model.priors.free[index[0]] if index.size == 2 else None
    return first is not None and first.unit == "Hz" and first.prior.family == "loguniform"


def _score_resonances(
    frame: Frame, model: Model, index: NDArray[np.int64], added: list[str], score: Callable[[Array], Scored | None]
) -> None:
    """Score points where something may ring; what is scored is kept by `score`.

    Beside other effects, or on a curved law, a mass is dear to simulate. It is looked for where it would ring on the
    linear network alone, which changes their answer by about as much, and scored with them at the best point of every
    damping ratio.
    """
    prior = model.priors.free[index[0]].prior
    if not frame.fit.problem.model.spec.effects and model.spec.law == "hooke":

        def value(point: Array) -> float:
            found = score(point)
            return math.inf if found is None else found.posterior

        look_for_resonances(prior.a, prior.b, value)
        return
    beside = Superposed(frame, model, added)
    best: dict[float, tuple[float, Array]] = {}

    def about(point: Array) -> float:
        found = beside.value(point)
        damping = float(point[1])
        if damping not in best or found < best[damping][0]:
            best[damping] = found, point
        return found

    look_for_resonances(prior.a, prior.b, about)
    for found, point in best.values():
        if math.isfinite(found):
            score(point)


def just_reached(
    found: Sequence[Scored], idle: float, score: Callable[[Array], Scored | None]
) -> None:
    """Score points between the last of a limit that acts on too much and the next, that acts on nothing any more.

    A limit that is just reached acts within less than a step of any grid. idle: likelihood of the base; what is scored
    is kept by `score`. Golden section; where both points act on nothing it goes on towards those that act.
    """
    points = sorted(found, key=lambda p: float(p.own[0]))
    values = [p.likelihood for p in points]
    near = _OTHER_ROAD * (max(values, default=0.0) - min(values, default=0.0))
    alike = [a for a, b in pairwise(values) if abs(a - b) < _IDLE and abs(a - idle) < near]
    resting = min(alike, key=lambda a: abs(a - idle), default=idle)
    idles = [abs(v - resting) < _IDLE for v in values]
    for i in range(1, len(points)):
        if idles[i - 1] == idles[i]:
            continue
        acting, beyond = (points[i - 1], points[i]) if idles[i] else (points[i], points[i - 1])
        # a tie goes on towards what acts
        _golden_section(score, lambda p: p.likelihood, float(acting.own[0]), float(beyond.own[0]), _SECTIONS, _IDLE)


def _golden_section(
    score: Callable[[Array], Scored | None], of: Callable[[Scored], float], a: float, b: float, count: int, tie: float
) -> None:
    """Score points by golden section between a and b, down the values `of`; where they differ by `tie` towards a."""
    known: dict[float, float] = {}
    for _ in range(count):
        x1, x2 = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
        for x in (x1, x2):
            if x not in known:
                p = score(np.array([x]))
                known[x] = of(p) if p is not None else math.inf
        if known[x1] <= known[x2] + tie:
            b = x2
        else:
            a = x1


def parabola(found: Sequence[Scored], score: Callable[[Array], Scored | None]) -> None:
    """Score the vertex of a parabola through the likeliest point and its neighbours; what is scored is kept by `score`.

    What readings follow in a line (a drift, a curvature of the sensor) may be known a hundred times better than the
    points of a grid are apart: a weak one then lies between zero and the next point, and either looks worse than none.
    For such an effect the parabola is exact.
    """
    for _ in range(_PARABOLAS):
        points = sorted(found, key=lambda p: float(p.own[0]))
        best = min(range(len(points)), key=lambda i: points[i].likelihood, default=0)
        if not 0 < best < len(points) - 1:
            return
        (a, fa), (b, fb), (c, fc) = ((float(p.own[0]), p.likelihood) for p in points[best - 1 : best + 2])
        left, right = (b - a) * (fb - fc), (b - c) * (fb - fa)
        if left == right or min(b - a, c - b) <= 0.0:
            return
        x = b - 0.5 * ((b - a) * left - (b - c) * right) / (left - right)
        if not a < x < c or abs(x - b) < _SAME * (c - a):
            return
        score(np.array([x]))


def narrow_peak(
    found: Sequence[Scored], idle: float, score: Callable[[Array], Scored | None]
) -> None:
    """Score points between the best of a grid and a next one that acts on far too much.

    What ends before the next reading (a lag, a ramp of the supply) shows nothing of itself until it is slow enough, and
    then soon everything: such a peak lies between two points of a grid of probabilities. So does that of half a step,
    from the first point on, where the second is worse than none, and that of a limit that cuts off a little more than
    the point at which it is just reached. idle: minus log posterior of the base; what is scored is kept by `score`.
    Golden section.
    """
    points = sorted(found, key=lambda p: float(p.own[0]))
    if len(points) < 2:
        return
    best = min(range(len(points)), key=lambda i: points[i].posterior)
    top = points[best]
    if top.posterior - idle > _HARDLY:  # acts on too much everywhere
        return
    for i in (best - 1, best + 1):
        if not 0 <= i < len(points):
            continue
        gain, sections = idle - top.posterior, _PEAK_SECTIONS
        if points[i].posterior - top.posterior < _STEEP * max(gain, _HARDLY):
            if best not in (0, len(points) - 1) or points[i].posterior < idle or gain < _HARDLY:
                continue
            sections = _END_SECTIONS
        _golden_section(score, lambda p: p.posterior, float(top.own[0]), float(points[i].own[0]), sections, 0.0)


def moved_to(known: Screened, frames: Sequence[Frame]) -> Screened | None:
    """A grid carried over to the same frames on recordings that lost a few readings; None where the frames differ."""
    if [frame.kind for frame in known.frames] != [frame.kind for frame in frames]:
        return None
    new = {id(old): frame for old, frame in zip(known.frames, frames, strict=True)}
    points = tuple(replace(p, frame=new[id(p.frame)]) for p in known.points)
    shift = frames[0].fit.log_evidence - known.frames[0].fit.log_evidence
    return replace(known, points=points, log_evidence=known.log_evidence + shift, frames=tuple(frames))

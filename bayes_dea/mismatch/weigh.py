"""Every hypothesis weighed: search over its own parameters with the rest eliminated, refit, evidence.

The strength of an effect is looked for on a grid of prior quantiles with the base model moved along linearly (one
simulation a point), the best points are refitted, and the evidence is Laplace's there; where the posterior of the
effect's parameters is as wide as the grid (a weak effect, a bound) the average over the grid takes its place, because
Laplace is wrong at a boundary.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..models.bare import bare_of
from ..models.model import Model
from .journal import digest
from .leak_starts import highest_field, leak_points
from .noise_prior import NoisePrior
from .problem import Kept, Problem
from .reduced import Piece
from .refit import Fit, bounds, descend, inverse, prior_derivatives, refit
from .resonance import look_for_resonances
from .whitening import Whitened, whiten

Array = NDArray[np.float64]

#: nats behind the best so far at which a hypothesis is not refitted any further
HOPELESS = 300.0
#: how far (in logs) the base is moved along linearly where the whole way led astray
_FAR = 0.7
#: how far a refit looks around itself, in widths of the prior
_LOOKS = (-0.3, -0.1, -0.03, -0.012, -0.005, 0.005, 0.012, 0.03, 0.1, 0.3)
#: how well the frequency that a mass rings at is known from its stiffness
_MIRROR = (0.94, 0.97, 1.0, 1.03, 1.06)
#: points a parameter of the grid over prior quantiles, by the number of parameters
_POINTS = {0: (), 1: (13,), 2: (7, 4), 3: (5, 3, 2), 4: (4, 3, 2, 2)}
#: span (in logarithms) of a second parameter that two points are enough for
_NARROW = 3.5
#: distance (in logarithms) of points of a second parameter, at most: modes a factor of ten apart have little in common
_COARSEST = 2.0
#: quantiles of a log-normal strength below those of the grid
_WEAK = (0.02, 0.004)
#: the same of a strength that is uniform from zero, in shares of its range
_SLIGHT = (0.04, 0.008)
#: nats by which a limit that acts on nothing may differ from the base, sections of the search for one just reached
_IDLE = 1e-3
_SECTIONS = 12
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
#: how many times more than the best point of a grid gains (and the least gain in nats that counts) the next one has to
#: lose for a peak to be looked for between the two, and in how many sections
_STEEP, _HARDLY, _PEAK_SECTIONS = 10.0, 10.0, 8
#: further points of a bounded parameter that stands alone, in shares of its range from either end: a limit that is
#: just reached acts on nothing at the coarser points
_ENDS = (0.1, 0.05, 0.025, 0.012, 0.006, 0.003, 0.0015)
#: step of the displacement (m) where no resolution is stated, and what a force without one is a displacement by (N/m)
STEP_M = 0.15e-6
_STIFFNESS = 13e3


@dataclass(frozen=True)
class Scored:
    """A point of the grid: minus log posterior, the same without the prior of the effect's own parameters."""

    posterior: float
    likelihood: float
    own: Array
    move: Array
    frame: Frame


@dataclass(frozen=True)
class Weighed:
    """A hypothesis with its evidence. effects: () for the base alone."""

    effects: tuple[str, ...]
    fit: Fit
    log_evidence: float
    log_evidence_se: float
    size_m: float  # largest RMS of what the effect changes on a recording, everything else refitted
    value: float = math.inf  # minus log posterior at the noise that fits begin with
    shared_prior: float = 0.0  # log share of its effect's prior, where that has several laws

    @property
    def name(self) -> str:
        """Effects joined with +, or none."""
        return "+".join(self.effects) or "none"


class Frame:
    """A fit's sensitivities, whitened once, so that another prediction costs one column."""

    def __init__(self, fit: Fit, far: bool = False) -> None:
        """far: what is tried from here changes the sensitivities, so that none is carried over."""
        self.fit, self.far = fit, far
        self.whitened: list[Whitened] = []
        total = None
        for i, piece in enumerate(fit.problem.pieces):
            w = whiten(piece, fit.problem.columns(i, fit.q, fit.clean, fit.slopes), fit.noise)
            self.whitened.append(w)
            g = w.gram()
            total = g if total is None else total + g
        assert total is not None
        self.total = total
        base, gradient, curvature = prior_derivatives(fit.problem, fit.q)
        self.prior, self.gradient, self.curvature = base, gradient, curvature
        self.H = total[1:, 1:] + curvature
        self.Hinv = inverse(0.5 * (self.H + self.H.T))

    @cached_property
    def key(self) -> str:
        """Digest of the fit."""
        return digest(self.fit.problem.key, self.fit.q, self.fit.noise.key)

    def tried(self, problem: Problem, q: Array, effects: Iterable[str]) -> tuple[float, Array] | None:
        """`value` of another model's predictions at q; None where it has no answer.

        effects: those in whose parameters alone q differs from the fit; where they do not act, predictions are known.
        """
        journal = problem.journal
        key = digest("tried", self.key, problem.key, q) if journal.kept else ""
        if key not in journal:
            found = problem.clean(q, problem.reached_by(effects))
            clean = [x if x.size else known for x, known in zip(found, self.fit.clean, strict=True)]
            value, move = math.nan, np.empty(0)
            if all(np.isfinite(x).all() for x in clean):
                value, move = self.value(clean)
            if not journal.kept:
                return (value, move) if np.isfinite(value) else None
            journal.put(key, [float(value), move.tolist()])
        value, known = journal[key]
        return (value, np.array(known)) if np.isfinite(value) else None

    def value(self, clean: list[Array]) -> tuple[float, Array]:
        """Minus log posterior (without log det terms) of other predictions, base moved along; and the move (d,)."""
        rr, cross = self.residual(clean, self.fit.q)
        cross = cross - self.gradient
        move = self.Hinv @ cross
        return self.prior + 0.5 * rr - 0.5 * float(cross @ move), move

    def residual(self, clean: list[Array], q: Array) -> tuple[float, Array]:
        """Weighted sum of squared residuals of other predictions, and their product with the sensitivities (d,)."""
        rr, cross = 0.0, np.zeros(self.fit.q.size)
        _, gains = self.fit.problem.beside(q)
        for piece, w, x in zip(self.fit.problem.pieces, self.whitened, clean, strict=True):
            r = piece.y - (1 + gains[piece.group]) * x
            one = whiten_one(piece, r, self.fit)
            rr += float(one @ one)
            b = w.nuisance @ one
            # M^-1 B r, with the factor kept in the columns' coupling replaced by a solve on few rows
            M = w.nuisance @ w.nuisance.T + np.diag(1.0 / piece.nuisance_sd**2)
            mb = np.linalg.solve(M, b)
            rr -= float(b @ mb)
            cross += w.columns[1:] @ one - (w.columns[1:] @ w.nuisance.T) @ mb
        return rr, cross


def whiten_one(piece: object, r: Array, fit: Fit) -> Array:
    """Whitened column (nb,) of a piece."""
    from ..noise.blocks import block_whiten

    sigma, rho = fit.noise.of(piece)  # type: ignore[arg-type]
    out, _ = block_whiten(r, piece.blocks.count, sigma, rho, piece.blocks.gap, piece.white_variance)  # type: ignore[attr-defined]
    return out


def insert(base: Fit, model: Model, own: Array, move: Array | None = None) -> Array:
    """Coordinates of a hypothesis: those of the base (moved), the effect's own where the model has them."""
    q = base.q if move is None else base.q + move
    before = base.problem.model
    out = np.empty(model.dimension)
    out[own_index(base, model)] = own
    names = model.priors.names
    for i, name in enumerate(before.priors.names):
        out[names.index(name)] = q[i]
    return np.concatenate([out, q[before.dimension :]])


def own_index(base: Fit, model: Model) -> NDArray[np.int64]:
    """Positions of the parameters that the effects add."""
    known = set(base.problem.model.priors.names)
    return np.array([i for i, n in enumerate(model.priors.names) if n not in known], dtype=np.int64)


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
    in the lower tail of its prior, because an effect that is three times too strong looks worse than none.
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
    def contrast(self) -> float:
        """Nats of likelihood between the base and the point that differs from it most."""
        return max(abs(p.likelihood - self.base_objective) for p in self.points)


def screen(frames: Sequence[Frame], model: Model, effects: tuple[str, ...], sparse: bool = False) -> Screened | None:
    """Score a grid over the effect's own parameters. None where it has no answer on these recordings.

    frames: the base fit, and others from which the base may be moved along (see `slow_start`).
    """
    base = frames[0].fit
    problem = base.problem.with_model(model)
    index = own_index(base, model)
    d = base.problem.model.dimension
    added = [name for name in model.spec.effects if name not in base.problem.model.spec.effects]
    scored: list[Scored] = []
    main: list[float] = []
    for frame in frames:
        own_fit = frame.fit
        before = float(own_fit.problem.model.log_prior(own_fit.q[None, :d])[0])
        weighing = grid_points(model, index, own_fit.values(), sparse)
        here: list[Scored] = []

        def score(
            own: Array, frame: Frame = frame, before: float = before, here: list[Scored] = here
        ) -> Scored | None:
            q = insert(frame.fit, model, own)
            own_prior = float(model.log_prior(q[None, : model.dimension])[0]) - before
            if not np.isfinite(own_prior):
                return None
            found = frame.tried(problem, q, added)
            if found is None:
                return None
            value, move = found
            here.append(Scored(value - own_prior, value, own, move, frame))
            return here[-1]

        finding = finding_points(model, index, own_fit.values(), sparse)
        finding += leak_points(model, index, highest_field(problem.pieces), sparse)
        for k, own in enumerate([*weighing, *finding]):
            point = score(own)
            if point is not None and frame is frames[0] and k < len(weighing):
                main.append(-point.likelihood)
        if index.size == 1 and model.priors.free[index[0]].prior.family == "uniform":
            just_reached(here, frame.value(frame.fit.clean)[0], score)
        elif index.size == 1:
            narrow_peak(here, frame.value(frame.fit.clean)[0], score)
        if _rings(model, index):
            _score_resonances(frame, model, index, added, score)
        scored += here
    if not scored:
        return None
    scored.sort(key=lambda s: s.posterior)
    base_value = frames[0].value(base.clean)[0]
    # Laplace of the base beside each point; the noise's share is the base's
    constant = base.log_evidence + base_value
    grid = float(logsumexp(main) - math.log(len(main))) + constant if main else -math.inf
    return Screened(effects, model, tuple(scored), grid, base_value, tuple(frames))


def _rings(model: Model, index: NDArray[np.int64]) -> bool:
    """Whether the own parameters are a frequency with known limits and a damping ratio."""
    first = model.priors.free[index[0]] if index.size == 2 else None
    return first is not None and first.unit == "Hz" and first.prior.family == "loguniform"


def _score_resonances(
    frame: Frame, model: Model, index: NDArray[np.int64], added: list[str], score: Callable[[Array], Scored | None]
) -> None:
    """Score points where something may ring; what is scored is kept by `score`.

    Beside other effects a mass is dear to simulate. It is looked for where it would ring on the network alone, which
    changes their answer by about as much, and scored with them at the best point of every damping ratio.
    """
    prior = model.priors.free[index[0]].prior
    if not frame.fit.problem.model.spec.effects:

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


class Superposed:
    """What an effect changes on the network alone, added to the answer of a fit that has other effects."""

    def __init__(self, frame: Frame, model: Model, added: Sequence[str]) -> None:
        """model: that of the fit with the effects `added`."""
        self.frame, self.model = frame, model
        problem = frame.fit.problem
        self.plain, self.changed = problem.with_model(bare_of(model)), problem.with_model(bare_of(model, tuple(added)))
        self.before = self.plain.clean(self._coordinates(self.plain.model, insert(frame.fit, model, self._nothing())))

    def value(self, own: Array) -> float:
        """Minus log posterior at the effect's own coordinates (k,), the base moved along; infinite if it has none."""
        q = insert(self.frame.fit, self.model, own)
        log_prior = float(self.model.log_prior(q[None, : self.model.dimension])[0])
        if not math.isfinite(log_prior):
            return math.inf
        after = self.changed.clean(self._coordinates(self.changed.model, q))
        clean = [x + y - z for x, y, z in zip(self.frame.fit.clean, after, self.before, strict=True)]
        if not all(np.isfinite(x).all() for x in clean):
            return math.inf
        return self.frame.value(clean)[0] - log_prior

    def _nothing(self) -> Array:
        return np.zeros(own_index(self.frame.fit, self.model).size)

    def _coordinates(self, simpler: Model, q: Array) -> Array:
        """Those of a model that has some of the parameters of `model`."""
        names = self.model.priors.names
        kept = [names.index(n) for n in simpler.priors.names]
        return np.concatenate([q[kept], q[self.model.dimension :]])


def just_reached(
    found: Sequence[Scored], idle: float, score: Callable[[Array], Scored | None], steps: int = _SECTIONS
) -> None:
    """Score points between the last of a limit that acts on too much and the next, that acts on nothing any more.

    A limit that is just reached acts within less than a step of any grid. idle: likelihood of the base; what is scored
    is kept by `score`. Golden section; where both points act on nothing it goes on towards those that act.
    """
    points = sorted(found, key=lambda p: float(p.own[0]))
    idles = [abs(p.likelihood - idle) < _IDLE for p in points]
    for i in range(1, len(points)):
        if idles[i - 1] == idles[i]:
            continue
        acting, resting = (points[i - 1], points[i]) if idles[i] else (points[i], points[i - 1])
        # a tie goes on towards what acts
        _golden_section(score, lambda p: p.likelihood, float(acting.own[0]), float(resting.own[0]), steps, _IDLE)


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


def narrow_peak(
    found: Sequence[Scored], idle: float, score: Callable[[Array], Scored | None], sections: int = _PEAK_SECTIONS
) -> None:
    """Score points between the best of a grid and a next one that acts on far too much.

    What ends before the next reading (a lag, a ramp of the supply) shows nothing of itself until it is slow enough, and
    then soon everything: such a peak lies between two points of a grid of probabilities. idle: minus log posterior of
    the base; what is scored is kept by `score`. Golden section.
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
        if points[i].posterior - top.posterior < _STEEP * max(idle - top.posterior, _HARDLY):
            continue
        _golden_section(score, lambda p: p.posterior, float(top.own[0]), float(points[i].own[0]), sections, 0.0)


def moved_to(known: Screened, frames: Sequence[Frame]) -> Screened | None:
    """A grid carried over to the same frames on recordings that lost a few readings; None where the frames differ."""
    if len(known.frames) != len(frames):
        return None
    new = {id(old): frame for old, frame in zip(known.frames, frames, strict=True)}
    points = tuple(replace(p, frame=new[id(p.frame)]) for p in known.points)
    shift = frames[0].fit.log_evidence - known.frames[0].fit.log_evidence
    return replace(known, points=points, log_evidence=known.log_evidence + shift, frames=tuple(frames))


def refine(
    base: Fit, screened: Screened, prior: NoisePrior, starts: int = 2, reached: float = math.inf
) -> Weighed | None:
    """Refit from the best points of the grid; Laplace evidence, or the grid's where the posterior is wide.

    reached: the value (see `Weighed`) of the best so far; None where this one stays `HOPELESS` nats behind it.
    """
    model = screened.model
    problem = base.problem.with_model(model)
    low, high = bounds(problem)
    low, high = low + 1e-9, high - 1e-9
    above = _hopeless(reached, sum(p.blocks.n for p in problem.pieces))
    ends: list[tuple[float, Array, Kept | None]] = []
    for point in _starting_points(screened, starts):
        kept = None if point.frame.far else _kept(point.frame.fit, model)
        for shift in _shifts(point):
            start = np.clip(insert(point.frame.fit, model, point.own, shift), low, high)
            end = descend(problem, start, prior.start(), low, high, 25, 0.05, kept, above, coarse=True)
            if end is not None:
                ends.append((end.value, end.q, kept))
                if end.value < point.posterior + HOPELESS:
                    break
    for value, q, kept in sorted(ends, key=lambda e: e[0]):
        if value > above:
            break
        fit = refit(problem, q, prior.start(), prior, kept=kept, coarse=True)
        if fit is not None:
            return replace(weighed(base, screened, fit), value=value)
    return None


def _shifts(point: Scored) -> list[Array | None]:
    """Moves of the base to begin with, the linear one first; others are for where that led astray.

    The logs of a fit bend: a long step may set two modes on the same time constant, which no descent parts again.
    """
    if point.frame.far:
        return [None]
    length = float(np.max(np.abs(point.move), initial=0.0))
    return [point.move, *([point.move * (_FAR / length)] if length > _FAR else []), None]


def _hopeless(reached: float, n: int) -> float:
    """The value above which a fit to n blocks stays HOPELESS nats behind another, whatever its noise grows to.

    With its sd scaled to the misfit v, normal noise makes n/2 (1 + log(2 v/n)) of it.
    """
    if not math.isfinite(reached):
        return math.inf
    half = 0.5 * max(n, 1)
    grown = reached if reached < half else half * (1.0 + math.log(reached / half))
    grown += HOPELESS
    return grown if grown < half else half * math.exp(grown / half - 1.0)


def weighed(base: Fit, screened: Screened, fit: Fit) -> Weighed:
    """A refit with its evidence and its size."""
    evidence, se = _evidence(base, screened, fit)
    return Weighed(screened.effects, fit, evidence, se, effect_size(base, fit))


def _kept(fit: Fit, model: Model) -> Kept:
    """The base's sensitivities, where another model has its coordinates; those of its effects are to be worked out."""
    own = own_index(fit, model)
    names = model.priors.names
    before = fit.problem.model
    zeros = np.arange(fit.problem.zero_mean.size)
    others = np.concatenate([[names.index(n) for n in before.priors.names], model.dimension + zeros]).astype(np.int64)
    return Kept(tuple(int(i) for i in own), others, fit.slopes)


def escape(base: Fit, screened: Screened, found: Weighed, prior: NoisePrior) -> Weighed:
    """A hypothesis out of local maxima (`escaped`), weighed anew where that led on."""
    fit = escaped(found.fit, base, prior)
    return found if fit is found.fit else improved(found, base, screened, fit)


def escaped(fit: Fit, base: Fit, prior: NoisePrior) -> Fit:
    """Out of local maxima along the coordinates of the effects that a fit has beyond the base.

    A delay has one at every sampling step, a resonance one on either side of half the sampling rate.
    """
    index = own_index(base, fit.problem.model)
    added = [name for name in fit.problem.model.spec.effects if name not in base.problem.model.spec.effects]
    widths = fit.problem.model.priors.scales()
    low, high = bounds(fit.problem)
    for _ in range(3):
        frame = Frame(fit)
        here = frame.value(fit.clean)[0]
        best: tuple[float, Array] | None = None
        looks: list[tuple[Array, list[int]]] = []
        for i in index:
            for share in _LOOKS:
                q = fit.q.copy()
                q[i] = q[i] + share * widths[i]
                looks.append((q, [int(i)]))
        looks += [(q, [int(i) for i in index]) for q in _mirrored(fit, index)]
        for q, own in looks:
            q[own] = np.clip(q[own], low[own] + 1e-9, high[own] - 1e-9)
            own_prior = float(fit.problem.log_prior(q)[0] - fit.problem.log_prior(fit.q)[0])
            tried = frame.tried(fit.problem, q, added) if np.isfinite(own_prior) else None
            if tried is None:
                continue
            value, move = tried[0], tried[1].copy()
            move[own] = 0.0
            if value - own_prior < here - 2.0 and (best is None or value - own_prior < best[0]):
                best = (value - own_prior, q + move)
        if best is None:
            break
        again = refit(fit.problem, best[1], fit.noise, prior, coarse=True)
        if again is None or again.objective > fit.objective - 0.5:
            break
        fit = again
    return fit


def _mirrored(fit: Fit, index: NDArray[np.int64]) -> list[Array]:
    """Coordinates with a resonance on the other side of half the sampling rate, where its readings look the same.

    It rings at its frequency times the root of the stiffness with all branches over that without; the decay a second,
    frequency times damping ratio, stays.
    """
    if not _rings(fit.problem.model, index):
        return []
    values = fit.values()
    stiff = values.get("Y_Pa", 0.0)
    glassy = sum(v for k, v in values.items() if k.startswith("k_") and k.endswith("_Pa"))
    faster = math.sqrt(1.0 + glassy / stiff) if stiff > 0.0 else 1.0
    frequency, damping = np.exp(fit.q[index])
    rates = {round(1.0 / p.prepared.step_s, 3) for p in fit.problem.pieces if p.channel == "displacement"}
    out = []
    for rate in sorted(rates):
        for share in _MIRROR:
            other = abs(rate - faster * share * frequency) / (faster * share)
            if other > 0.0:
                q = fit.q.copy()
                q[index] = np.log([other, damping * frequency / other])
                out.append(q)
    return out


def improved(found: Weighed, base: Fit, screened: Screened, fit: Fit) -> Weighed:
    """A hypothesis weighed anew at a better fit; its share of the effect's prior stays, and what it reached before."""
    w = weighed(base, screened, fit)
    shared = found.shared_prior
    return replace(w, log_evidence=w.log_evidence + shared, shared_prior=shared, value=found.value)


def _starting_points(screened: Screened, starts: int) -> list[Scored]:
    """The best point of every frame, then the best of the rest."""
    out: list[Scored] = []
    for point in screened.points:
        if all(point.frame is not p.frame for p in out):
            out.append(point)
    for point in screened.points:
        if len(out) >= starts:
            break
        if all(point is not p for p in out):
            out.append(point)
    return out


def _evidence(base: Fit, screened: Screened, best: Fit) -> tuple[float, float]:
    """Laplace where the posterior of the effect's own coordinates is narrow and inside, else the grid's average."""
    model = screened.model
    index = own_index(base, model)
    widest = float(np.max(widths_of(best, index), initial=0.0))
    if widest < 0.12:
        return best.log_evidence, 0.1
    # an average over the prior cannot exceed its best point; the grid moves the base linearly and may think it does
    d, before = model.dimension, base.problem.model
    moved = np.array([best.q[model.priors.names.index(n)] for n in before.priors.names])
    own_prior = float(model.log_prior(best.q[None, :d])[0] - before.log_prior(moved[None])[0])
    most = -(best.objective + own_prior) + base.log_evidence + base.objective
    grid = min(screened.log_evidence, most)
    if widest < 0.5:  # a peak between the points is what Laplace sees and the grid does not
        return max(min(best.log_evidence, most), grid), 0.5
    return grid, 0.5


def widths_of(fit: Fit, index: NDArray[np.int64]) -> Array:
    """Posterior sds (k,) of some parameters of the model, in sds of their priors; infinite at a bound."""
    model = fit.problem.model
    sd = np.sqrt(np.maximum(np.diag(fit.covariance)[index], 0.0))
    prior = np.array([model.priors.free[i].prior.coordinate_sd() for i in index])
    bounded = np.array([model.coordinate_names[i] in fit.at_bound for i in index], dtype=bool)
    return np.where(bounded, np.inf, sd / prior)


def excess(fit: Fit, prior: NoisePrior) -> float:
    """Nats of misfit beyond that of noise: half the chi squared at the noise that fits begin with, less its mean."""
    chi2 = float(fit.problem.sums(fit.q, prior.start(), fit.clean, [])[0][0, 0])
    return 0.5 * (chi2 - sum(p.blocks.n for p in fit.problem.pieces))


def effect_size(base: Fit, fit: Fit) -> float:
    """Largest RMS in m over all recordings of the difference between two fits, offsets removed; forces by steps."""
    return _largest(base, fit, base.clean, fit.clean)


def size_elsewhere(base: Fit, fit: Fit, pieces: Sequence[Piece]) -> float:
    """The same over other voltage recordings, of which the commands alone are needed and no reading."""
    plain, corrected = (replace(f, problem=replace(f.problem, pieces=tuple(pieces))) for f in (base, fit))
    before, after = plain.problem.clean(plain.q), corrected.problem.clean(corrected.q)
    if not all(np.isfinite(x).all() for x in (*before, *after)):
        return 0.0
    return _largest(plain, corrected, before, after)


def _largest(base: Fit, fit: Fit, plain: Sequence[Array], changed: Sequence[Array]) -> float:
    worst = 0.0
    for piece, x0, x1 in zip(fit.problem.pieces, plain, changed, strict=True):
        _, g0 = base.problem.beside(base.q)
        _, g1 = fit.problem.beside(fit.q)
        x = (1 + g1[piece.group]) * x1 - (1 + g0[piece.group]) * x0
        w = piece.blocks.count / piece.blocks.count.sum()
        x = x - w @ x
        rms = math.sqrt(float(w @ x**2))
        each = 1.0 if piece.channel == "displacement" else _metres_a_newton(piece, fit.problem.pieces)
        worst = max(worst, each * rms)
    return worst


def _metres_a_newton(force: Piece, pieces: Sequence[Piece]) -> float:
    """What a force counts for beside displacements: a step of its sensor's resolution is one of theirs."""
    own = force.prepared.sensor.resolution
    theirs = [p.prepared.sensor.resolution for p in pieces if p.channel == "displacement"]
    return next((step for step in theirs if step), STEP_M) / own if own else 1.0 / _STIFFNESS

"""Hypotheses refitted from the best points of their grids (`grid`), out of local maxima, and their evidence.

The evidence is Laplace's; where the posterior of the effect's own parameters is as wide as the grid (a weak effect, a
bound) the average over the grid takes its place, because Laplace is wrong at a boundary; but for a peak that the grid
has missed by far, of which Laplace's tail at that boundary is all that is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx

from ...gauss_newton.descent import approach, inner_bounds, prior_derivatives
from ...gauss_newton.laws import laws_in
from ...gauss_newton.noise_prior import SIGMA_LOG_SD, NoisePrior
from ...gauss_newton.problem import Kept, Problem
from ...gauss_newton.refit import Fit, refit
from ...gauss_newton.whitening import whiten
from ...models.model import Model
from ...priors import Prior
from ..where.size import effect_size
from .frame import Frame, insert, own_index, trusted
from .grid import Scored, Screened, rings

Array = NDArray[np.float64]
#: nats behind the best so far at which a hypothesis is not refitted any further
HOPELESS = 300.0
#: how far a refit looks around itself, in widths of the prior
_LOOKS = (-0.3, -0.1, -0.03, -0.012, -0.005, 0.005, 0.012, 0.03, 0.1, 0.3)
#: widths of a posterior, in sds of the prior, below which the points of a grid (13 of one parameter, a fifth of an sd
#: apart) miss it and Laplace is right, and from which on the grid covers it
_NARROW, _WIDE = 0.12, 0.5
#: steps of a descent of what is dear before it may be given up: the first ones of what rings promise little
_PATIENCE = 2
#: sds by which a channel that few readings tell the noise of may scatter by more than they say
_NOISE_SDS = 2.0
#: how well the frequency that a mass rings at is known from its stiffness
_MIRROR = (0.94, 0.97, 1.0, 1.03, 1.06)


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

    @property
    def laws(self) -> dict[str, Prior]:
        """Priors of the laws that its effects were given, where those are not the plain ones."""
        return laws_in(self.fit.problem.model, self.effects)

    @property
    def refitted(self) -> bool:
        """Whether the fit is its own; what a grid calls hopeless keeps that of the base."""
        return set(self.effects) <= set(self.fit.problem.model.spec.effects)


def refine(
    base: Fit, screened: Screened, prior: NoisePrior, starts: int = 2, reached: float = math.inf,
    behind: float = HOPELESS, at_most: float = math.inf, once: bool = False,
) -> Weighed | None:
    """Refit from the best points of the grid; Laplace evidence, or the grid's where the posterior is wide.

    reached: the value (see `Weighed`) of the best so far; None where this one stays so many nats `behind` it, or above
    `at_most`. once: of what is dear no other start is tried where the first one ends above that.
    """
    model = screened.model
    problem = base.problem.with_model(model)
    above = min(hopeless(reached, sum(p.blocks.n for p in problem.pieces), behind), at_most)
    ends: list[tuple[float, Array, Kept | None]] = []
    for point in _starting_points(screened, starts):
        kept = None if point.frame.far else _kept(point.frame.fit, model)
        for shift in _shifts(point):
            q = insert(point.frame.fit, model, point.own, shift)
            end = approach(problem, q, prior.start(), kept, above, _PATIENCE if once else 0)
            if end is not None:
                # what had to work out all sensitivities needs no approach by those of the base
                ends.append((end.value, end.q, None if end.own else kept))
                if end.value < point.posterior + HOPELESS or (once and end.value > above):
                    break
        if once and ends and ends[-1][0] > above:
            break
    for value, q, kept in sorted(ends, key=lambda e: e[0]):
        if value > above:
            break
        fit = refit(problem, q, prior.start(), prior, kept=kept, coarse=True)
        if fit is not None:
            return replace(weighed(base, screened, fit), value=value)
    return None


def within_reach(problem: Problem, q: Array, prior: NoisePrior, above: float) -> Fit | None:
    """A refit from q; None where an approach to it stays above this value (see `Weighed`), which tells a wrong model
    long before it is at its end."""
    end = approach(problem, q, prior.start(), hopeless_above=above)
    if end is None or end.value > above:
        return None
    # not by the sensitivities that the approach has carried on to there: a journal keeps the place alone
    return refit(problem, end.q, prior.start(), prior)


def _shifts(point: Scored) -> list[Array | None]:
    """Moves of the base to begin with, the linear one first; others are for where that led astray.

    The logs of a fit bend: a long step may set two modes on the same time constant, which no descent parts again.
    """
    if point.frame.far:
        return [None]
    shorter = trusted(point.move)
    return [point.move, *([] if shorter is point.move else [shorter]), None]


def hopeless(reached: float, n: int, behind: float = HOPELESS) -> float:
    """The value above which a fit to n blocks stays so many nats behind another, whatever its noise grows to.

    With its sd scaled to the misfit v, normal noise makes n/2 (1 + log(2 v/n)) of it.
    """
    if not math.isfinite(reached):
        return math.inf
    half = 0.5 * max(n, 1)
    grown = reached if reached < half else half * (1.0 + math.log(reached / half))
    grown += behind
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
    return Kept(tuple(int(i) for i in own), others, fit.q[: others.size], fit.slopes)


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
    low, high = inner_bounds(fit.problem)
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
            q[own] = np.clip(q[own], low[own], high[own])
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
        again = refit(fit.problem, best[1], prior.start(), prior, coarse=True)
        if again is None or again.objective > fit.objective - 0.5:
            break
        fit = again
    return fit


def _mirrored(fit: Fit, index: NDArray[np.int64]) -> list[Array]:
    """Coordinates with a resonance on the other side of half the sampling rate, where its readings look the same.

    It rings at its frequency times the root of the stiffness with all branches over that without; the decay a second,
    frequency times damping ratio, stays.
    """
    if not rings(fit.problem.model, index):
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
    if widest < _NARROW:
        return best.log_evidence, 0.1
    # an average over the prior cannot exceed its best point; the grid moves the base linearly and may think it does
    d, before = model.dimension, base.problem.model
    moved = np.array([best.q[model.priors.names.index(n)] for n in before.priors.names])
    own_prior = float(model.log_prior(best.q[None, :d])[0] - before.log_prior(moved[None])[0])
    most = -(best.objective + own_prior) + base.log_evidence + base.objective
    grid = min(screened.log_evidence, most)
    if widest < _WIDE:  # a peak between the points is what Laplace sees and the grid does not
        return max(min(best.log_evidence, most), grid), 0.5
    # a peak far narrower than the steps of the grid, at an end of one parameter, is known by itself alone
    peak = min(best.log_evidence + _cut_off(best, index), most)
    return (peak if peak > grid + HOPELESS else grid), 0.5


def _cut_off(fit: Fit, index: NDArray[np.int64]) -> float:
    """What Laplace's log evidence has too much at the ends of some coordinates: of a normal density the tail is left.

    With slope g and curvature h at the end, that is 1/2 erfcx(g / sqrt(2 h)) of what the whole would be.
    """
    names = fit.problem.names
    at = [int(i) for i in index if names[i] in fit.at_bound]
    if not at:
        return 0.0
    gram, _ = fit.problem.sums(fit.q, fit.noise, fit.clean, fit.slopes)
    slope = prior_derivatives(fit.problem, fit.q)[1] - gram[0, 1:]
    along = np.abs(slope[at]) / np.sqrt(2.0 * np.maximum(np.diag(fit.hessian)[at], 1e-300))
    return float(np.sum(np.log(0.5 * erfcx(along))))


def widths_of(fit: Fit, index: NDArray[np.int64]) -> Array:
    """Posterior sds (k,) of some parameters of the model, in sds of their priors; infinite at a bound."""
    model = fit.problem.model
    sd = np.sqrt(np.maximum(np.diag(fit.covariance)[index], 0.0))
    prior = np.array([model.priors.free[i].prior.coordinate_sd() for i in index])
    bounded = np.array([model.coordinate_names[i] in fit.at_bound for i in index], dtype=bool)
    return np.where(bounded, np.inf, sd / prior)


def excess(fit: Fit, prior: NoisePrior) -> float:
    """Nats of misfit beyond that of noise: half the chi squared at the noise that fits begin with, less its mean.

    Where a few readings alone say what a channel scatters by, as much more as they allow counts as noise. A
    discrepancy beside the fit takes nothing from it.
    """
    problem, start, total = fit.problem, prior.start(), 0.0
    for channel, (_, sd) in prior.log_sigma.items():
        own = [i for i, p in enumerate(problem.pieces) if p.channel == channel]
        columns = ((problem.pieces[i], problem.columns(i, fit.q, fit.clean, [])) for i in own)
        chi2 = sum(float(whiten(p, x, start).gram()[0, 0]) for p, x in columns)
        n = sum(problem.pieces[i].blocks.n for i in own)
        most = math.exp(2.0 * _NOISE_SDS * max(sd - SIGMA_LOG_SD, 0.0))
        total += 0.5 * (chi2 / min(max(chi2 / max(n, 1), 1.0), most) - n)
    return total

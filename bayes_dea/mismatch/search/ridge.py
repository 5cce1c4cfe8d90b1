"""An effect's own parameters, drawn along their ridge: its evidence and the posterior of what it is made of.

Laplace takes the posterior for normal. Where an effect has several parameters that the recordings hardly tell apart
(a leak, its activation and the resistance before it), or one at the end of what its prior allows, that is wrong: by
nats of evidence, and by many of its own standard deviations where the other end is as likely. Here the effect's own
parameters are drawn, from a Student t around the maximum and then from what was learned of it, everything else is moved
along with them, and the weights give the integral and the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp, ndtri
from scipy.stats import chi2, qmc

from ...errors import InputError
from ...fit.mixture import Mixture, fit_mixture, joined
from ...gauss_newton.descent import Effort, Linearisation, bounds, descend
from ...gauss_newton.refit import Fit, inverse
from ..telling import Tell, silence
from .frame import Frame
from .weigh import widths_of

Array = NDArray[np.float64]
#: degrees of freedom of the first proposals, the widening of all, draws of each round for an integral
_DF, _WIDE, _ROUNDS = 4.0, 1.3, (32, 64, 64)
#: effective draws below which the integral is not trusted, and the standard error (nats) that is enough, as it is of
#: Laplace's
_LEAST, _SURE = 5.0, 0.1
#: the same rounds for a posterior (powers of two, for points that fill evenly), the effective draws that are enough,
#: and those below which Laplace stands
_POSTERIOR_ROUNDS, _ENOUGH, _SOME = (64, 128, 128, 128, 128), 120.0, 25.0
#: effective draws a parameter that the next proposal is fitted to, draws made of them, least variance of a component
_FITTED, _RESAMPLED, _FLOOR = 10, 1000, 0.01
#: share of effective draws from which on a posterior is the normal that it seemed, and draws of that
_NORMAL, _DRAWN = 0.95, 1024
#: how often the rest is moved again for a draw, and what (nats) another move may seem to gain without being made
_CORRECTIONS, _STRAIGHT = 4, 1.0
#: where that does not do, the rest is fitted anew: for draws that may come so near (nats) to the best, so many times,
#: with so many steps
_WITHIN, _PLACES, _DESCENT = 12.0, 8, 6
#: sds of its prior below which a parameter is known so well that no arm leads far along it
NARROW = 0.03
#: first step along an arm in sds, steps at most, nats below the maximum at which it ends
_FIRST_STEP, _STEPS, _DEEP = 2.5, 8, 8.0
#: what a step is cut by where it comes out deeper from a place less deep than so many nats, and pieces that it may be
#: cut into where the arm bends, before it is halved
_SHORTER, _FLAT, _BETWEEN = 0.25, 2.0, 4


@dataclass(frozen=True)
class _Student:
    """A multivariate t: centre (k,), root (k, k) of its scale."""

    centre: Array
    root: Array

    def at(self, normal: Array, chisquare: Array) -> Array:
        """Draws (n, k) of standard normal (n, k) and chi squared ones (n,)."""
        return np.asarray(self.centre + (normal / np.sqrt(chisquare / _DF)[:, None]) @ self.root.T)

    def log_density(self, theta: Array) -> Array:
        """(n, k) -> (n,), normalised."""
        k = self.centre.size
        z = np.linalg.solve(self.root, (theta - self.centre).T).T
        return np.asarray(
            gammaln(0.5 * (_DF + k)) - gammaln(0.5 * _DF) - 0.5 * k * math.log(_DF * math.pi)
            - float(np.sum(np.log(np.diag(self.root)))) - 0.5 * (_DF + k) * np.log1p(np.sum(z * z, axis=1) / _DF)
        )  # fmt: skip


@dataclass(frozen=True)
class _Pool:
    """Draws (n, k) of the own parameters from several proposals, log density (n,) but for a constant, and log weights.

    Each draw is weighted by all proposals together (their balance, in shares of the draws): what an early, poor
    proposal found stays of use, and no draw that it found by chance outweighs the rest.
    """

    theta: Array
    log_p: Array
    proposals: tuple[tuple[int, _Student | Mixture], ...] = ()

    def with_draws(self, theta: Array, log_p: Array, proposal: _Student | Mixture) -> _Pool:
        """The same and further draws of another proposal."""
        drawn = *self.proposals, (len(theta), proposal)
        return _Pool(np.concatenate([self.theta, theta]), np.concatenate([self.log_p, log_p]), drawn)

    @cached_property
    def log_q(self) -> Array:
        """Log density (n,) of all proposals together."""
        total = sum(n for n, _ in self.proposals)
        log_q = logsumexp([math.log(n / total) + q.log_density(self.theta) for n, q in self.proposals], axis=0)
        return np.asarray(log_q)

    @property
    def log_w(self) -> Array:
        """Log weights (n,)."""
        return self.log_p - self.log_q

    def share(self, power: float = 1.0) -> Array:
        """Weights (n,), which add up to one; power: below one they are flattened."""
        w = np.exp(power * (self.log_w - self.log_w.max()))
        return np.asarray(w / w.sum())

    def effective(self, power: float = 1.0) -> float:
        """Effective number of draws."""
        return float(1.0 / np.sum(self.share(power) ** 2))

    def flattened(self) -> Array:
        """Weights (n,) flattened as far as a further proposal needs to be fitted to them."""
        enough = _FITTED * self.theta.shape[1]
        power = 1.0
        while power > 0.02 and self.effective(power) < enough:
            power *= 0.7
        return self.share(power)


def integrated(
    fit: Fit, own: NDArray[np.int64], rng: np.random.Generator, tell: Tell = silence
) -> tuple[float, float] | None:
    """Log evidence and its standard error; own: indices of the effect's parameters. None where draws do not do."""
    root = _root(fit.covariance[np.ix_(own, own)])
    if root is None:
        return None
    normal = 0.5 * own.size * math.log(2 * math.pi) + float(np.sum(np.log(np.diag(root))))
    found: tuple[float, float] | None = None
    for pool in _rounds(fit, own, root, _ROUNDS, rng, tell):
        n, effective = pool.log_w.size, pool.effective()
        if effective >= _LEAST:
            se = math.sqrt(max(1.0 / effective - 1.0 / n, 0.0))
            log_ratio = float(logsumexp(pool.log_w) - math.log(n))
            found = fit.log_evidence + log_ratio - normal, max(se, 0.05)
            if se < _SURE:
                break
    return found


def posterior(
    fit: Fit, own: NDArray[np.int64], rng: np.random.Generator, tell: Tell = silence
) -> tuple[Array, Array] | None:
    """Draws (n, k) of the own parameters in coordinates and their weights (n,). None where draws do not do."""
    root = _root(fit.covariance[np.ix_(own, own)])
    if root is None:
        return None
    pool = None
    for pool in _rounds(fit, own, root, _POSTERIOR_ROUNDS, rng, tell, arms=True):
        if len(pool.proposals) == 1 and _as_normal(pool, fit.q[own], root) > _NORMAL:
            z = _even_points(rng, _DRAWN, own.size)[0]
            return fit.q[own] + z @ root.T, np.full(_DRAWN, 1.0 / _DRAWN)
        if pool.effective() >= _ENOUGH:
            break
    return None if pool is None or pool.effective() < _SOME else (pool.theta, pool.share())


def _as_normal(pool: _Pool, centre: Array, root: Array) -> float:
    """Share of its draws that a normal (centre (k,), root (k, k)) would have as effective ones of the posterior."""
    z = np.linalg.solve(root, (pool.theta - centre).T)
    log_normal = -0.5 * np.sum(z * z, axis=0)
    drawn = log_normal - pool.log_q  # what a draw counts for the normal
    beside = pool.log_p - log_normal
    return float(np.exp(2.0 * logsumexp(drawn + beside) - logsumexp(drawn) - logsumexp(drawn + 2.0 * beside)))


class _Place:
    """Somewhere on the ridge: everything but the effect's own parameters, and the sensitivities that it has there."""

    def __init__(self, fit: Fit, own: NDArray[np.int64]) -> None:
        """own: indices (k,) of the effect's parameters."""
        self.fit, self.own = fit, own
        self.frame = Frame(fit)
        self.rest = np.setdiff1d(np.arange(fit.q.size), own)
        self.H = self.frame.H[np.ix_(self.rest, self.rest)]
        self.along = -np.linalg.lstsq(self.H, self.frame.H[np.ix_(self.rest, own)], rcond=1e-13)[0]
        #: what integrating the rest out adds to a minus log density, but for a constant
        self.width = 0.5 * float(np.linalg.slogdet(self.H)[1])

    @property
    def theta(self) -> Array:
        """The own parameters (k,) here."""
        return self.fit.q[self.own]

    def led_to(self, theta: Array) -> tuple[Array, float, float]:
        """Coordinates (d,) with other own parameters (k,), minus log posterior there, and what is left to gain.

        Moved along a straight line, the rest is far from its best where the ridge bends, and how far is only known once
        it has been moved again. The sensitivities stay those of this place: as what the readings leave is noise, the
        point at which they have nothing left to gain hardly depends on them.
        """
        q = self.fit.q.copy()
        q[self.rest] += self.along @ (theta - self.theta)
        q[self.own] = theta
        value, gain, move = self._at(q)
        for _ in range(_CORRECTIONS):
            if gain < _STRAIGHT:
                break
            there = q.copy()
            there[self.rest] += move
            new = self._at(there)
            if not new[0] < value:
                break
            q, (value, gain, move) = there, new
        return q, value, gain

    def _at(self, q: Array) -> tuple[float, float, Array]:
        """Minus log posterior (without log det terms) at q; what moving the rest seems to gain, and the move."""
        nothing = math.inf, 0.0, np.zeros(self.rest.size)
        log_prior = float(self.fit.problem.log_prior(q)[0])
        if not math.isfinite(log_prior):
            return nothing
        clean = self.frame.nearby.clean(self.fit.problem, q)
        if not all(np.isfinite(x).all() for x in clean):
            return nothing
        rr, cross = self.frame.residual(clean, q)
        cross = (cross - self.frame.gradient - self.frame.curvature @ (q - self.fit.q))[self.rest]
        move = np.asarray(np.linalg.lstsq(self.H, cross, rcond=1e-13)[0], dtype=float)
        return -log_prior + 0.5 * rr, 0.5 * float(cross @ move), move

    def fitted(self, q: Array) -> _Place | None:
        """The place with the own parameters of q (d,), the rest fitted from there; None where there is no answer."""
        low, high = bounds(self.fit.problem)
        q = np.clip(q, low, high)
        low[self.own] = high[self.own] = q[self.own]
        near = self.fit.linearisation
        end = descend(self.fit.problem, q, self.fit.noise, (low, high), Effort(_DESCENT, 0.1), known=near)
        if end is None:
            return None
        return _Place(replace(self.fit, q=end.q, clean=end.clean, slopes=end.slopes), self.own)


class _Ridge:
    """Minus log density of an effect's own parameters, the rest integrated out; it learns where the ridge bends."""

    def __init__(self, fit: Fit, own: NDArray[np.int64], root: Array) -> None:
        """own: indices (k,) of the effect's parameters; root (k, k): of a covariance that distances are measured in."""
        self.root = root
        self.places = [_Place(fit, own)]
        self.least = self.places[0].led_to(fit.q[own])[1]
        self.refits = 0

    def minus_log_density(self, theta: Array) -> float:
        """At own parameters (k,), but for a constant."""
        away = np.array([np.sum(np.linalg.solve(self.root, theta - p.theta) ** 2) for p in self.places])
        width = self._width(away)
        nearest = self.places[int(np.argmin(away))]
        q, value, gain = nearest.led_to(theta)
        if gain > _STRAIGHT and value - gain < self.least + _WITHIN and self.refits < _PLACES:
            place = nearest.fitted(q)
            if place is not None:
                self.refits += 1
                self.places.append(place)
                q, value, gain = place.led_to(theta)
        self.least = min(self.least, value)
        return value - min(gain, _STRAIGHT) + width

    def _width(self, away: Array) -> float:
        """What integrating the rest out adds, against the maximum: a mean of the known places, the near ones first.

        away: their squared distances (n,). Where one of two own parameters hardly matters any more, the rest is known
        better or worse than at the maximum.
        """
        near = 1.0 / np.maximum(away, 1e-6)
        found = np.array([p.width for p in self.places])
        return float(near @ found / near.sum() - found[0])


def _rounds(
    fit: Fit, own: NDArray[np.int64], start: Array, counts: tuple[int, ...], rng: np.random.Generator, tell: Tell,
    arms: bool = False,
) -> Iterator[_Pool]:
    """All draws after each round, which draws where those before have found the weight.

    start (k, k): root of the first proposal's covariance; arms: whether the second round looks along them.
    """
    low, high = bounds(fit.problem)
    ridge = _Ridge(fit, own, start)
    here = ridge.least
    proposal: _Student | Mixture = _Student(fit.q[own], _WIDE * start)
    pool = _Pool(np.empty((0, own.size)), np.empty(0))
    for n in counts:
        done = len(pool.theta)
        if isinstance(proposal, Mixture):
            theta = proposal.draw(n, rng)
        else:
            theta = proposal.at(*_even_points(rng, n, own.size))
        log_p = np.full(n, -np.inf)
        for i in np.flatnonzero(np.all((theta > low[own]) & (theta < high[own]), axis=1)):
            tell(done + int(i), sum(counts), "")
            log_p[i] = here - ridge.minus_log_density(theta[i])
        if not np.isfinite(log_p).any():
            return
        pool = pool.with_draws(theta, log_p, proposal)
        yield pool
        wide = widths_of(fit, own) > NARROW
        if arms and len(pool.proposals) == 1 and own.size > 1 and wide.any():
            proposal = _arms(ridge, own, np.flatnonzero(wide))
        else:
            proposal = _next(pool, proposal, start, rng)


def _arms(ridge: _Ridge, own: NDArray[np.int64], along: NDArray[np.int64]) -> Mixture:
    """Normals around the maximum and along the arms of the ridge, which may lead far from it.

    Of a sum of two parameters each may be nearly all: in logarithms that is a corner with two arms. The own parameters
    `along` which it may lead far are moved either way in steps that double, everything else fitted, until that costs
    too much. A maximum at the end of what a prior allows is no guide to how far a first step may go, nor a flat arm to
    how far it goes on: steps are made shorter until they cost little enough.
    """
    fit = ridge.places[0].fit
    low, high = bounds(fit.problem)
    margin = 1e-6 * np.where(np.isfinite(high - low), high - low, 1.0)
    top = fit.q[own], ridge.root @ ridge.root.T
    found = [top]
    for j in along:
        i = own[j]
        for sign in (-1.0, 1.0):
            arm = [top]
            q, step, went, depth = fit.q, _FIRST_STEP * math.sqrt(fit.covariance[i, i]), 0.0, 0.0
            near = fit.linearisation
            for _ in range(_STEPS):
                x = min(max(q[i] + sign * step, low[i] + margin[i]), high[i] - margin[i])
                if sign * (x - q[i]) <= margin[i]:
                    break
                a, b = low + margin, high - margin
                a[i] = b[i] = x
                end = descend(fit.problem, np.clip(q, a, b), fit.noise, (a, b), Effort(_DESCENT, 0.1), known=near)
                if end is None or end.value > ridge.least + _DEEP:
                    if step < went or depth > _FLAT:
                        break
                    step *= _SHORTER
                    continue
                place = end.q[own], inverse(end.gram[1:, 1:] + end.prior[2])[np.ix_(own, own)]
                if _bends(arm[-1], place, j) > _BETWEEN:
                    step *= 0.5
                    continue
                arm.append(place)
                ridge.places.append(_Place(replace(fit, q=end.q, clean=end.clean, slopes=end.slopes), own))
                q, step, went, depth = end.q, 2.0 * step, step, end.value - ridge.least
                near = Linearisation(end.q, end.clean, end.slopes)
            found += [*arm[1:], *_bent(arm, j)]
    kept = [(centre, root) for centre, c in found if (root := _root(c)) is not None]
    centres, roots = (np.array(x) for x in zip(*kept, strict=True))
    return Mixture(np.full(len(kept), 1.0 / len(kept)), centres, _WIDE * roots)


def _bends(start: tuple[Array, Array], end: tuple[Array, Array], j: int) -> int:
    """Into how many pieces an arm from start to end is cut, so that each is as good as straight.

    The tangent misses a curve by the square of its length; it is to miss it by less than a standard deviation.
    """
    (a, A), (b, _) = start, end
    along = A[:, j] / A[j, j]
    missed = np.delete(np.abs(b - a - (b[j] - a[j]) * along), j)
    sd = np.sqrt(np.maximum(np.delete(np.diag(A - np.outer(along, A[j])), j), 1e-300))
    return math.ceil(math.sqrt(float(np.max(missed / sd))))


def _bent(arm: list[tuple[Array, Array]], j: int) -> Iterator[tuple[Array, Array]]:
    """Centres (k,) and covariances (k, k) between neighbours along an arm, where it bends away from their tangents.

    arm: the same at its maxima with own parameter j held. A normal follows a ridge for as long as that is straight;
    where it bends, short ones stand closely on the curve through both ends that has their tangents (cubic Hermite).
    """
    for (a, A), (b, B) in pairwise(arm):
        length = float(b[j] - a[j])
        along_a, along_b = A[:, j] / A[j, j], B[:, j] / B[j, j]
        across_a, across_b = A - np.outer(along_a, A[j]), B - np.outer(along_b, B[j])
        count = _bends((a, A), (b, B), j)
        for s in np.linspace(0.0, 1.0, count + 1) if count > 1 else ():
            centre = (1 - s) ** 2 * ((1 + 2 * s) * a + s * length * along_a)
            centre += s**2 * ((3 - 2 * s) * b - (1 - s) * length * along_b)
            along = 6 * s * (1 - s) * (b - a) / length + (1 - s) * (1 - 3 * s) * along_a + s * (3 * s - 2) * along_b
            spread = (1 - s) * across_a + s * across_b
            yield centre, spread + (length / count) ** 2 * np.outer(along, along)


def _next(pool: _Pool, before: _Student | Mixture, start: Array, rng: np.random.Generator) -> _Student | Mixture:
    """Where to draw after these: a t, then mixtures; start (k, k): root of the covariance at the maximum."""
    w = pool.flattened()
    mean = w @ pool.theta
    spread = (w[:, None] * (pool.theta - mean)).T @ (pool.theta - mean)
    simple = _root(spread + 0.05 * start @ start.T)
    if len(pool.proposals) > 1:
        again = rng.choice(len(w), size=_RESAMPLED, p=w)
        try:
            return joined([fit_mixture(pool.theta[again], rng, (1, 2, 4, 8), _FLOOR)], np.ones(1), _WIDE)
        except InputError:
            pass
    return before if simple is None else _Student(mean, _WIDE * simple)


def _root(covariance: Array) -> Array | None:
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    try:
        return np.asarray(
            np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))) * scale[:, None]
        )
    except np.linalg.LinAlgError:
        return None


def _even_points(rng: np.random.Generator, n: int, k: int) -> tuple[Array, Array]:
    """Standard normal variables (n, k) and chi squared ones (n,) that fill evenly (a scrambled Sobol sequence).

    Quantiles then scatter less than those of n draws.
    """
    u = np.clip(qmc.Sobol(k + 1, rng=rng).random(n), 1e-9, 1 - 1e-9)
    return ndtri(u[:, :k]), np.asarray(chi2.ppf(u[:, k], _DF))

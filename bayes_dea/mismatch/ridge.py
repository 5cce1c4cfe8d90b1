"""An effect's own parameters, drawn along their ridge: its evidence and the posterior of what it is made of.

Laplace takes the posterior for normal. Where an effect has several parameters that the recordings hardly tell apart
(a leak, its activation and the resistance before it), or one at the end of what its prior allows, that is wrong: by
nats of evidence, and by many of its own standard deviations where the other end is as likely. Here the effect's own
parameters are drawn from a Student t around the maximum, everything else is moved along linearly, and the weights give
the integral and the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp, ndtri
from scipy.stats import chi2, qmc

from .refit import Fit, bounds
from .telling import Tell, silence
from .weigh import Frame

Array = NDArray[np.float64]
#: standard normal points (n, k) and chi squared ones (n,), of n and k
Points = Callable[[int, int], tuple[Array, Array]]
#: degrees of freedom of the proposal, its widening, simulations of each round
_DF, _WIDE, _ROUNDS = 4.0, 1.3, (40, 50, 70)
#: effective draws below which the integral is not trusted, and below which the next round keeps what it has
_LEAST, _LOST = 5.0, 2.0
#: the same rounds for a posterior (powers of two, for points that fill evenly), the effective draws that are enough,
#: and those below which Laplace stands
_POSTERIOR_ROUNDS, _ENOUGH, _SOME = (64, 128, 128, 256), 80.0, 25.0


@dataclass(frozen=True)
class _Round:
    """Draws (n, k) of the own parameters, their log weights (n,), the effective number of them."""

    theta: Array
    log_w: Array
    effective: float

    @property
    def share(self) -> Array:
        """Weights (n,), which add up to one."""
        w = np.exp(self.log_w - self.log_w.max())
        return np.asarray(w / w.sum())


def integrated(
    fit: Fit, own: NDArray[np.int64], rng: np.random.Generator, tell: Tell = silence
) -> tuple[float, float] | None:
    """Log evidence and its standard error; own: indices of the effect's parameters. None where draws do not do."""
    root = _root(fit.covariance[np.ix_(own, own)])
    if root is None:
        return None
    normal = 0.5 * own.size * math.log(2 * math.pi) + float(np.sum(np.log(np.diag(root))))
    found: tuple[float, float] | None = None
    for r in _rounds(fit, own, root, _ROUNDS, partial(_normal_points, rng), tell):
        n = r.log_w.size
        if r.effective >= _LEAST:
            se = math.sqrt(max(1.0 / r.effective - 1.0 / n, 0.0))
            log_ratio = float(logsumexp(r.log_w) - math.log(n))
            found = fit.log_evidence + log_ratio - normal, max(se, 0.05)
    return found


def posterior(
    fit: Fit, own: NDArray[np.int64], rng: np.random.Generator, tell: Tell = silence
) -> tuple[Array, Array] | None:
    """Draws (n, k) of the own parameters in coordinates and their weights (n,). None where draws do not do.

    Far from the maximum the straight move of the rest is not its best place, and the density there is understated:
    where modes of the base have to move by more than about one in their logs, intervals come out too narrow.
    """
    root = _root(fit.covariance[np.ix_(own, own)])
    if root is None:
        return None
    best: _Round | None = None
    for r in _rounds(fit, own, root, _POSTERIOR_ROUNDS, partial(_even_points, rng), tell):
        if best is None or r.effective > best.effective:
            best = r
        if best.effective >= _ENOUGH:
            break
    return None if best is None or best.effective < _SOME else (best.theta, best.share)


def _rounds(
    fit: Fit, own: NDArray[np.int64], start: Array, counts: tuple[int, ...], points: Points, tell: Tell
) -> Iterator[_Round]:
    """Rounds of draws, each where the one before has found the weight; start (k, k): root of the first's covariance."""
    frame = Frame(fit)
    low, high = bounds(fit.problem)
    rest = np.setdiff1d(np.arange(fit.q.size), own)
    H_rest = frame.H[np.ix_(rest, rest)]
    along = -np.linalg.lstsq(H_rest, frame.H[np.ix_(rest, own)], rcond=1e-13)[0]
    here = _value(frame, fit, fit.q, rest, H_rest)
    centre, root = fit.q[own], _WIDE * start
    done = 0
    for n in counts:
        theta, log_q = _student(centre, root, *points(n, own.size))
        inside = np.all((theta > low[own]) & (theta < high[own]), axis=1)
        log_w = np.full(n, -np.inf)
        for i in np.flatnonzero(inside):
            tell(done + int(i), sum(counts), "")
            q = fit.q.copy()
            q[own] = theta[i]
            q[rest] += along @ (theta[i] - fit.q[own])
            log_w[i] = here - _value(frame, fit, q, rest, H_rest) - log_q[i]
        done += n
        if not np.isfinite(log_w).any():
            return
        w = np.exp(log_w - log_w.max())
        r = _Round(theta, log_w, float(w.sum() ** 2 / np.sum(w**2)))
        yield r
        mean = r.share @ theta
        spread = (r.share[:, None] * (theta - mean)).T @ (theta - mean)
        better = _root(spread + 0.05 * start @ start.T)
        if better is None or r.effective < _LOST:
            continue
        centre, root = mean, _WIDE * better


def _value(frame: Frame, fit: Fit, q: Array, rest: NDArray[np.int64], H_rest: Array) -> float:
    """Minus log posterior (without log det terms) at q with everything but the effect's own moved to its best."""
    log_prior = float(fit.problem.log_prior(q)[0])
    if not math.isfinite(log_prior):
        return math.inf
    clean = fit.problem.clean(q)
    if not all(np.isfinite(x).all() for x in clean):
        return math.inf
    rr, cross = frame.residual(clean, q)
    cross = cross - frame.gradient - frame.curvature @ (q - fit.q)
    return -log_prior + 0.5 * rr - 0.5 * float(cross[rest] @ np.linalg.lstsq(H_rest, cross[rest], rcond=1e-13)[0])


def _root(covariance: Array) -> Array | None:
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    try:
        return np.asarray(
            np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-9 * np.eye(len(scale))) * scale[:, None]
        )
    except np.linalg.LinAlgError:
        return None


def _normal_points(rng: np.random.Generator, n: int, k: int) -> tuple[Array, Array]:
    """Draws of k standard normal variables (n, k), and of chi squared (n,)."""
    return rng.standard_normal((n, k)), rng.chisquare(_DF, n)


def _even_points(rng: np.random.Generator, n: int, k: int) -> tuple[Array, Array]:
    """The same, filling evenly (a scrambled Sobol sequence): quantiles then scatter less than those of n draws."""
    u = np.clip(qmc.Sobol(k + 1, rng=rng).random(n), 1e-9, 1 - 1e-9)
    return ndtri(u[:, :k]), np.asarray(chi2.ppf(u[:, k], _DF))


def _student(centre: Array, root: Array, normal: Array, chisquare: Array) -> tuple[Array, Array]:
    """Draws (n, k) of a multivariate t and their log density (n,)."""
    k = centre.size
    z = normal / np.sqrt(chisquare / _DF)[:, None]
    log_q = (
        gammaln(0.5 * (_DF + k)) - gammaln(0.5 * _DF) - 0.5 * k * math.log(_DF * math.pi)
        - float(np.sum(np.log(np.diag(root)))) - 0.5 * (_DF + k) * np.log1p(np.sum(z * z, axis=1) / _DF)
    )  # fmt: skip
    return centre + z @ root.T, np.asarray(log_q)

"""Evidence of a hypothesis whose own parameters trade against each other: a few simulations along the ridge.

Laplace takes the posterior for normal. Where an effect has several parameters that the recordings hardly tell apart
(a leak, its activation and the resistance before it) that is wrong by nats. Here the effect's own parameters are drawn
from a Student t around the maximum, everything else is moved along linearly, and the weights give the integral.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

from .refit import Fit, bounds
from .telling import Tell, silence
from .weigh import Frame

Array = NDArray[np.float64]
#: degrees of freedom of the proposal, its widening, simulations of each round
_DF, _WIDE, _ROUNDS = 4.0, 1.3, (40, 50, 70)
#: effective draws below which the integral is not trusted, and below which the next round keeps what it has
_LEAST, _LOST = 5.0, 2.0


def integrated(
    fit: Fit, own: NDArray[np.int64], rng: np.random.Generator, tell: Tell = silence
) -> tuple[float, float] | None:
    """Log evidence and its standard error; own: indices of the effect's parameters. None where draws do not do."""
    k = own.size
    frame = Frame(fit)
    covariance = fit.covariance
    low, high = bounds(fit.problem)
    # where the recordings say nothing the box of the prior does: a step along the ridge must not leave it
    box = 12.0 / (high[own] - low[own]) ** 2
    scale = np.sqrt(np.maximum(np.diag(covariance)[own], 1e-300))
    inner = np.linalg.pinv(covariance[np.ix_(own, own)] / np.outer(scale, scale), hermitian=True)
    laplace_root = _root(np.linalg.inv(inner + np.diag(box * scale**2)) * np.outer(scale, scale))
    own_root = _root(covariance[np.ix_(own, own)])
    if laplace_root is None or own_root is None:
        return None
    rest = np.setdiff1d(np.arange(fit.q.size), own)
    H_rest = frame.H[np.ix_(rest, rest)]
    along = -np.linalg.lstsq(H_rest, frame.H[np.ix_(rest, own)], rcond=1e-13)[0]
    here = _value(frame, fit, fit.q, rest, H_rest)
    centre, root = fit.q[own], _WIDE * laplace_root
    found: tuple[float, float] | None = None
    done = 0
    for n in _ROUNDS:
        theta, log_q = _student(centre, root, n, rng)
        inside = np.all((theta > low[own]) & (theta < high[own]), axis=1)
        log_w = np.full(n, -np.inf)
        for i in np.flatnonzero(inside):
            tell(done + int(i), sum(_ROUNDS), "")
            q = fit.q.copy()
            q[own] = theta[i]
            q[rest] += along @ (theta[i] - fit.q[own])
            log_w[i] = here - _value(frame, fit, q, rest, H_rest) - log_q[i]
        done += n
        if not np.isfinite(log_w).any():
            return None
        w = np.exp(log_w - log_w.max())
        effective = float(w.sum() ** 2 / np.sum(w**2))
        log_ratio = float(logsumexp(log_w) - math.log(n))
        normal = 0.5 * k * math.log(2 * math.pi) + float(np.sum(np.log(np.diag(own_root))))
        se = math.sqrt(max(1.0 / effective - 1.0 / n, 0.0))
        if effective >= _LEAST:
            found = fit.log_evidence + log_ratio - normal, max(se, 0.05)
        # the next round where this one has found the weight
        share = w / w.sum()
        mean = share @ theta
        spread = (share[:, None] * (theta - mean)).T @ (theta - mean)
        better = _root(spread + 0.05 * laplace_root @ laplace_root.T)
        if better is None or effective < _LOST:
            continue
        centre, root = mean, _WIDE * better
    return found


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


def _student(centre: Array, root: Array, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draws (n, k) of a multivariate t and their log density (n,)."""
    k = centre.size
    z = rng.standard_normal((n, k)) / np.sqrt(rng.chisquare(_DF, n) / _DF)[:, None]
    log_q = (
        gammaln(0.5 * (_DF + k)) - gammaln(0.5 * _DF) - 0.5 * k * math.log(_DF * math.pi)
        - float(np.sum(np.log(np.diag(root)))) - 0.5 * (_DF + k) * np.log1p(np.sum(z * z, axis=1) / _DF)
    )  # fmt: skip
    return centre + z @ root.T, np.asarray(log_q)

"""A small Gaussian mixture: the proposal for bridge sampling and importance draws."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from bayes_dea.errors import InputError

from ..compiled import njit

Array = NDArray[np.float64]

#: share of a coordinate's sd below which what the others leave of it is rounding
_FLAT = 1e-7
#: the same of its mean
_ROUNDING = 1e-14


@dataclass(frozen=True)
class Mixture:
    """weights (k,), means (k, d), roots (k, d, d): lower Cholesky factors of the covariances."""

    weights: Array
    means: Array
    roots: Array

    def log_density(self, x: Array) -> Array:
        """(n, d) -> (n,), normalised."""
        return logsumexp(_log_parts(x, self), axis=1)

    def draw(self, n: int, rng: np.random.Generator) -> Array:
        """n independent draws, (n, d)."""
        which = rng.choice(len(self.weights), size=n, p=self.weights)
        z = rng.standard_normal((n, self.means.shape[1]))
        return self.means[which] + np.einsum("nij,nj->ni", self.roots[which], z)

    def walk(self, x: Array, rng: np.random.Generator, scale: float) -> tuple[Array, Array]:
        """A step from each x (n, d) as wide as the mixture is there, and log q(x | new) - log q(new | x), (n,).

        The component whose width a step takes is drawn by its share of the density at x: narrow where the density is.
        """
        here = _shares(x, self)
        cumulative = np.cumsum(here, axis=1)
        which = np.minimum((rng.random((len(x), 1)) * cumulative[:, -1:] > cumulative).sum(axis=1), here.shape[1] - 1)
        step = scale * np.einsum("nij,nj->ni", self.roots[which], rng.standard_normal(x.shape))
        new = x + step
        widths = _log_parts(step, Mixture(np.ones(len(self.weights)), np.zeros_like(self.means), scale * self.roots))
        with np.errstate(divide="ignore"):
            there, back = np.log(here) + widths, np.log(_shares(new, self)) + widths
        return new, np.asarray(logsumexp(back, axis=1) - logsumexp(there, axis=1))


def fit_mixture(
    x: Array, rng: np.random.Generator, components: tuple[int, ...] = (1, 2, 4, 8), floor: float = 1e-3
) -> Mixture:
    """Fit mixtures of growing size by EM and keep the one that predicts a held-out quarter best.

    floor: least variance of a component, of that of all draws. Few draws, or weighted ones, need a wide one, or the
    tails are missed; many of a density with curved valleys or branches far apart a narrow one, or its draws miss these.
    x: (n, d) draws, roughly independent. A larger mixture has to gain 0.01 nat a draw, else the smaller one
    stays. Raises InputError with fewer than 10 d draws or draws that lie in a subspace.
    """
    n, d = x.shape
    if n < max(10 * d, 20):
        raise InputError(f"mixture: {n} draws in {d} dimensions; give at least {max(10 * d, 20)}")
    centre = x.mean(axis=0)
    spread = np.atleast_2d(np.cov(x, rowvar=False))
    try:
        root = np.linalg.cholesky(spread)
    except np.linalg.LinAlgError:
        root = np.zeros((d, d))
    # of a few draws many times over rounding leaves some variance across what they lie in
    if not np.all(np.diag(root) > _FLAT * np.sqrt(np.diag(spread)) + _ROUNDING * np.abs(centre)):
        raise InputError("mixture: draws lie in a subspace; leave out what is constant")
    # Whitened draws: one floor for covariances is then right in every direction.
    z = np.linalg.solve(root, (x - centre).T).T
    order = rng.permutation(n)
    held, used = z[order[: n // 4]], z[order[n // 4 :]]
    best, score = _em(used, 1, rng, floor=floor), -np.inf
    for k in components:
        if k > 1 and len(used) < 20 * k * d:
            break
        candidate = _em(used, k, rng, floor=floor)
        its_score = float(np.mean(candidate.log_density(held)))
        if its_score > score + (0.01 if np.isfinite(score) else 0.0):
            best, score = candidate, its_score
    return Mixture(best.weights, centre + best.means @ root.T, np.einsum("ij,kjl->kil", root, best.roots))


def joined(parts: Sequence[Mixture], weights: Array, wide: float = 1.0) -> Mixture:
    """A mixture of mixtures, each component `wide` times as wide: tails that a proposal lacks hold walkers fast."""
    return Mixture(
        np.concatenate([w * m.weights for w, m in zip(weights, parts, strict=True)]),
        np.concatenate([m.means for m in parts]),
        np.concatenate([wide * m.roots for m in parts]),
    )


def _shares(x: Array, m: Mixture) -> Array:
    """Each component's share (n, k) of the density at x."""
    parts = _log_parts(x, m)
    return np.asarray(np.exp(parts - logsumexp(parts, axis=1)[:, None]))


def _log_parts(x: Array, m: Mixture) -> Array:
    """log weight plus log density of each component, (n, k)."""
    out = np.empty((len(x), len(m.weights)))
    whole = [np.ascontiguousarray(a, dtype=float) for a in (x, m.weights, m.means, m.roots)]
    _parts(whole[0], whole[1], whole[2], whole[3], out)
    return out


@njit(cache=True, error_model="numpy")
def _parts(x, weights, means, roots, out):
    """Each component's log density of points x (n, d), a loop for the few points of a step as for thousands."""
    n, d = x.shape
    y = np.empty(d)
    inverse = np.zeros((d, d))
    for j in range(means.shape[0]):
        root = roots[j]
        height = math.log(weights[j]) - 0.5 * d * math.log(2.0 * math.pi) if weights[j] > 0.0 else -np.inf
        for a in range(d):  # the inverse of a lower triangle, row by row
            height -= math.log(root[a, a])
            for b in range(a):
                z = 0.0
                for c in range(b, a):
                    z += root[a, c] * inverse[c, b]
                inverse[a, b] = -z / root[a, a]
            inverse[a, a] = 1.0 / root[a, a]
        for i in range(n):
            for a in range(d):
                y[a] = x[i, a] - means[j, a]
            total = 0.0
            for a in range(d):
                z = 0.0
                for b in range(a + 1):
                    z += inverse[a, b] * y[b]
                total += z * z
            out[i, j] = height - 0.5 * total


def _em(z: Array, k: int, rng: np.random.Generator, iterations: int = 60, floor: float = 1e-3) -> Mixture:
    n, d = z.shape
    centres = [int(rng.integers(n))]
    for _ in range(k - 1):
        # Far points first (k-means++), so that components start apart.
        near = np.min([np.sum((z - z[c]) ** 2, axis=1) for c in centres], axis=0)
        if not near.any():  # fewer different draws than components
            break
        centres.append(int(rng.choice(n, p=near / near.sum())))
    k = len(centres)
    m = Mixture(np.full(k, 1.0 / k), z[centres], np.repeat(np.eye(d)[None] / np.sqrt(k), k, axis=0))
    if k == 1:
        iterations = 1
    before = -np.inf
    for _ in range(iterations):
        parts = _log_parts(z, m)
        total = logsumexp(parts, axis=1)
        share = np.exp(parts - total[:, None])
        mass = share.sum(axis=0) + 1e-9
        means = (share.T @ z) / mass[:, None]
        roots = np.empty((k, d, d))
        for j in range(k):
            y = z - means[j]
            roots[j] = np.linalg.cholesky((share[:, j, None] * y).T @ y / mass[j] + floor * np.eye(d))
        m = Mixture(mass / mass.sum(), means, roots)
        now = float(total.mean())
        if now - before < 1e-4:
            break
        before = now
    return m

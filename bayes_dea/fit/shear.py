"""Curved valleys made straight: each coordinate less a polynomial of the ones before it.

The map is triangular with unit Jacobian, so it can be undone for any draw and changes no density, however badly its
polynomials fit; where they fit, moves that suit a normal density suit the posterior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit

Array = NDArray[np.float64]
#: a slow mode's log rate, the next one's log compliance and log time, as positions of coordinates
Pair = tuple[int, int, int]
#: standardised coordinates beyond this count as this, or cubes would rule the tails
_LARGEST = 6.0
#: pieces into which draws are cut to tell what a polynomial explains from what it follows by chance, ridges tried, as
#: shares of the monomials' variances, and share of a coordinate's variance that may be left where one stays
_PIECES, _RIDGES, _WORTH = 4, (1e-3, 1e-2, 1e-1), 0.98


@dataclass(frozen=True)
class Shear:
    """order (d,): coordinates, the ones that bend the others first; coefficients: of each one's polynomial.

    powers (d,): a polynomial's variable is exp(power (z - middle)), z itself where the power is zero: what is linear in
    a rate bends with its logarithm. mean, sd (d,): of these variables. pairs: modes that share a rate, see `shared`.
    """

    order: NDArray[np.int64]
    powers: Array
    middle: Array
    mean: Array
    sd: Array
    coefficients: Array = field(repr=False)  # (d, longest), zeros behind
    pairs: tuple[Pair, ...] = ()

    def forward(self, z: Array) -> Array:
        """Straightened coordinates (..., d) of z (..., d)."""
        return self._shifted(shared(z, self.pairs), -1.0)

    def inverse(self, y: Array) -> Array:
        """Coordinates (..., d) of straightened ones."""
        return parted(self._shifted(y, 1.0), self.pairs)

    def _shifted(self, x: Array, sign: float) -> Array:
        out = np.ascontiguousarray(x.reshape(-1, x.shape[-1])).copy()
        _shift(out, sign, self.order, self.powers, self.middle, self.mean, self.sd, self.coefficients)
        return out.reshape(x.shape)


def shared(z: Array, pairs: Sequence[Pair]) -> Array:
    """Of pairs of modes the logarithm of how their rates compare, and that of the sum of their rates; z (..., d).

    Recordings that see one slow mode where the model has two fix the sum of their rates c/T and hardly how it is
    shared out: the logarithm of what the one leaves to the other falls without end as it nears the whole. With the
    sum and the ratio instead nothing bends, and the Jacobian is one.
    """
    x = z.copy()
    for slow, compliance, time in pairs:
        a, b = z[..., slow], z[..., compliance] - z[..., time]
        x[..., slow], x[..., compliance] = a - b, np.logaddexp(a, b)
    return x


def parted(x: Array, pairs: Sequence[Pair]) -> Array:
    """The inverse of `shared`."""
    z = x.copy()
    for slow, compliance, time in pairs:
        ratio, total = x[..., slow], x[..., compliance]
        z[..., slow] = total - np.logaddexp(0.0, -ratio)
        z[..., compliance] = total - np.logaddexp(0.0, ratio) + x[..., time]
    return z


@njit(cache=True)
def _shift(x, sign, order, powers, middle, mean, sd, coefficients):
    """Subtract (sign -1) or add (+1) each coordinate's polynomial; x (n, d) in place."""
    n, d = x.shape
    t = np.empty(d)
    for b in range(n):
        for k in range(d):
            i = order[k]
            c = coefficients[k]
            bend = 0.0
            at = 0
            for e in range(k):
                bend += c[at] * t[e]
                at += 1
            for e in range(k):
                for f in range(e, k):
                    bend += c[at] * t[e] * t[f]
                    at += 1
            first = min(k, 2)
            for e in range(first):
                for f in range(e, first):
                    for g in range(f, first):
                        bend += c[at] * t[e] * t[f] * t[g]
                        at += 1
            for e in range(first):
                for f in range(e, first):
                    for g in range(f, first):
                        for h in range(g, first):
                            bend += c[at] * t[e] * t[f] * t[g] * t[h]
                            at += 1
            z = x[b, i] + bend if sign > 0 else x[b, i]
            u = z - middle[i]
            if powers[i] != 0.0:
                u = math.exp(min(max(powers[i] * u, -50.0), 50.0))
            t[k] = min(max((u - mean[i]) / sd[i], -_LARGEST), _LARGEST)
            x[b, i] = z if sign > 0 else z - bend


def _powered(z: Array, power: Array, middle: Array) -> Array:
    x = z - middle
    return np.where(power == 0.0, x, np.exp(np.clip(power * x, -50.0, 50.0)))


def _monomials(t: Array) -> Array:
    """Up to the second order in all columns (n, k), to the fourth in the first two."""
    parts = [t]
    for index in _indices(t.shape[1]):
        product = t[:, index[:, 0]]
        for j in range(1, index.shape[1]):
            product = product * t[:, index[:, j]]
        parts.append(product)
    return np.concatenate(parts, axis=1)


@cache
def _indices(k: int) -> tuple[NDArray[np.int64], ...]:
    return tuple(
        np.array(list(combinations_with_replacement(range(k if order == 2 else min(k, 2)), order)))
        for order in (2, 3, 4)
    )


def fit_shear(draws: Array, powers: Array, pairs: tuple[Pair, ...] = ()) -> Shear:
    """Shear of draws (n, d). powers (d,): see Shear; the widest logarithm comes first, what is none last.

    A polynomial stays where it also explains draws that it was not fitted to: one that follows chance throws whole
    tails aside. Draws that follow each other (steps of a run, ensembles) are told apart by pieces.
    """
    draws = shared(draws, pairs)
    middle = np.median(draws, axis=0)
    order = np.argsort(-np.where(powers == 0.0, 0.0, draws.std(axis=0)), kind="stable")
    # how two rates compare bends with its logarithm, which has no bounds
    powers = powers.copy()
    powers[[slow for slow, _, _ in pairs]] = 0.0
    x = _powered(draws, powers, middle)
    mean, sd = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-300)
    t = np.clip((x - mean) / sd, -_LARGEST, _LARGEST)
    d = len(order)
    coefficients = np.zeros((d, _monomials(np.zeros((1, d))).shape[1]))
    odd = np.arange(len(draws)) * _PIECES // len(draws) % 2 == 1
    for k in range(1, d):
        A = _monomials(t[:, order[:k]])
        coefficients[k, : A.shape[1]] = _bend(A, draws[:, order[k]], odd, k + k * (k + 1) // 2)
    return Shear(order, powers, middle, mean, sd, coefficients, pairs)


def _bend(A: Array, b: Array, odd: NDArray[np.bool_], second: int) -> Array:
    """Coefficients (m,) of b (n,) in monomials A (n, m), of which `second` are of the second order at most.

    Of the order and the ridge with which either half of the draws foretells the other best.
    """
    halves = _Moments.of(A[odd], b[odd]), _Moments.of(A[~odd], b[~odd])
    size, ridge, least = 0, 0.0, _WORTH
    for s in sorted({second, A.shape[1]}):
        for r in _RIDGES:
            left = max(held.left_by(other.solved(s, r)) for held, other in (halves, halves[::-1]))
            if left < least:
                size, ridge, least = s, r, left
    out = np.zeros(A.shape[1])
    if size:
        out[:size] = _Moments.of(A, b).solved(size, ridge)
    return out


@dataclass(frozen=True)
class _Moments:
    """Covariances of monomials AA (m, m), with a coordinate Ab (m,), and its variance bb."""

    AA: Array
    Ab: Array
    bb: float

    @staticmethod
    def of(A: Array, b: Array) -> _Moments:
        A, b = A - A.mean(axis=0), b - b.mean()
        return _Moments(A.T @ A / len(b), A.T @ b / len(b), max(float(b @ b / len(b)), 1e-300))

    def solved(self, size: int, ridge: float) -> Array:
        """Coefficients (size,) of the first monomials."""
        AA = self.AA[:size, :size]
        return np.asarray(np.linalg.solve(AA + ridge * np.diag(np.diag(AA) + 1e-12), self.Ab[:size]))

    def left_by(self, c: Array) -> float:
        """Share of the variance that coefficients (size,) leave."""
        size = len(c)
        return float((self.bb - 2.0 * c @ self.Ab[:size] + c @ self.AA[:size, :size] @ c) / self.bb)

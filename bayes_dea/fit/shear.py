"""Curved valleys made straight: each coordinate less a polynomial of the ones before it.

The map is triangular with unit Jacobian, so it can be undone for any draw and changes no density, however badly its
polynomials fit; where they fit, moves that suit a normal density suit the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: standardised coordinates beyond this count as this, or cubes would rule the tails
_LARGEST = 6.0


@dataclass(frozen=True)
class Shear:
    """order (d,): coordinates, the ones that bend the others first; coefficients: of each one's polynomial.

    powers (d,): a polynomial's variable is exp(power (z - middle)), z itself where the power is zero: what is linear in
    a rate bends with its logarithm. mean, sd (d,): of these variables.
    """

    order: NDArray[np.int64]
    powers: Array
    middle: Array
    mean: Array
    sd: Array
    coefficients: tuple[Array, ...] = field(repr=False)

    def forward(self, z: Array) -> Array:
        """Straightened coordinates (..., d) of z (..., d)."""
        flat = z.reshape(-1, z.shape[-1])
        y = flat.copy()
        t = self._variables(flat)
        for k in range(1, len(self.order)):
            y[:, self.order[k]] -= _monomials(t[:, self.order[:k]]) @ self.coefficients[k]
        return y.reshape(z.shape)

    def inverse(self, y: Array) -> Array:
        """Coordinates (..., d) of straightened ones."""
        flat = y.reshape(-1, y.shape[-1]).copy()
        t = np.empty_like(flat)
        for k, i in enumerate(self.order):
            if k:
                flat[:, i] += _monomials(t[:, self.order[:k]]) @ self.coefficients[k]
            t[:, i] = self._variables(flat, i)
        return flat.reshape(y.shape)

    def _variables(self, z: Array, i: int | slice = slice(None)) -> Array:
        x = (_powered(z[:, i], self.powers[i], self.middle[i]) - self.mean[i]) / self.sd[i]
        return np.asarray(np.clip(x, -_LARGEST, _LARGEST))


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


def fit_shear(draws: Array, powers: Array) -> Shear:
    """Shear of draws (n, d). powers (d,): see Shear; the widest logarithm comes first, what is none last."""
    middle = np.median(draws, axis=0)
    order = np.argsort(-np.where(powers == 0.0, 0.0, draws.std(axis=0)), kind="stable")
    x = _powered(draws, powers, middle)
    mean, sd = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-300)
    t = np.clip((x - mean) / sd, -_LARGEST, _LARGEST)
    coefficients = [np.empty(0)]
    for k in range(1, len(order)):
        A = _monomials(t[:, order[:k]])
        A = A - A.mean(axis=0)
        H = A.T @ A + 1e-3 * len(draws) * np.diag(A.var(axis=0) + 1e-12)
        b = draws[:, order[k]] - draws[:, order[k]].mean()
        coefficients.append(np.linalg.solve(H, A.T @ b))
    return Shear(order, powers, middle, mean, sd, tuple(coefficients))

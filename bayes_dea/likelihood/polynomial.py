"""Polynomials in whitened coordinates: what an emulator is made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations_with_replacement
from math import comb

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Polynomial:
    """All monomials up to `order` of u = (phi - center) @ whitening; phi: coordinates, some of them as powers.

    powers (k,): where not zero, phi is exp(power (x - middle)): a response is smooth in compliances and in the inverse
    of a slow time constant, however far their logarithms move. radius: length of u up to which the polynomial holds.
    """

    order: int
    center: Array  # (k,)
    whitening: Array  # (k, k)
    powers: Array
    middle: Array
    radius: float

    @property
    def size(self) -> int:
        """Number of monomials."""
        return monomials(len(self.center), self.order)

    def whitened(self, x: Array) -> Array:
        """u (B, k) of coordinates x (B, k)."""
        return np.asarray((powered(x, self.powers, self.middle) - self.center) @ self.whitening)

    def features(self, u: Array) -> Array:
        """Monomials (B, size) of u (B, k)."""
        k = u.shape[1]
        parts = [np.ones((len(u), 1)), u]
        for order in range(2, self.order + 1):
            index = _index(k, order)
            product = u[:, index[:, 0]]
            for j in range(1, order):
                product = product * u[:, index[:, j]]
            parts.append(product)
        return np.concatenate(parts, axis=1)


@cache
def _index(k: int, order: int) -> NDArray[np.int64]:
    return np.array(list(combinations_with_replacement(range(k), order)))


def monomials(k: int, order: int) -> int:
    """Number of monomials of k coordinates up to an order."""
    return comb(k + order, order)


def powered(x: Array, powers: Array, middle: Array) -> Array:
    """exp(power (x - middle)) of coordinates x (B, k) with a power, x - middle of the others."""
    t = x - middle
    return np.where(powers == 0.0, t, np.exp(np.clip(powers * t, -50.0, 50.0)))


def power_of(name: str) -> float:
    """What of a logarithm the response is nearly linear in: the inverse of a slow time, else the thing itself."""
    if not name.startswith("log "):
        return 0.0
    return -1.0 if name.startswith(("log T_", "log tau_", "log Tp_")) else 1.0


def powers_of(names: Sequence[str]) -> Array:
    """`power_of` each of the names (d,)."""
    return np.array([power_of(name) for name in names])


def mode_pairs(names: Sequence[str]) -> tuple[tuple[int, int, int], ...]:
    """The slowest mode's rate and the next one's compliance and time among coordinates, see `fit.shear.shared`."""
    wanted = ("log c_1/T_1", "log c_2", "log T_2")
    places = {name: i for i, name in enumerate(names)}
    return ((places[wanted[0]], places[wanted[1]], places[wanted[2]]),) if all(w in places for w in wanted) else ()


def polynomial_around(x: Array, order: int, powers: Array, widest: float = 1.5) -> Polynomial:
    """Polynomial whitened by the draws x (n, k); it holds to `widest` times their largest distance from the centre."""
    middle = np.median(x, axis=0)
    phi = powered(x, powers, middle)
    center = phi.mean(axis=0)
    covariance = np.atleast_2d(np.cov(phi.T))
    scale = np.sqrt(np.diag(covariance))
    eig, vec = np.linalg.eigh(covariance / np.outer(scale, scale))
    whitening = (vec / scale[:, None]) / np.sqrt(np.maximum(eig, 1e-12))
    radius = widest * float(np.sqrt(np.max(np.sum(((phi - center) @ whitening) ** 2, axis=1))))
    return Polynomial(order, center, whitening, powers, middle, radius)

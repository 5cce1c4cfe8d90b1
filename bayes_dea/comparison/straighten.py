"""Curved valleys made straight before they are integrated.

A normal mixture covers a banana badly: what it misses is in the tips, where no weight warns of it. In coordinates in
which the draws lie straight (`fit.shear`, unit Jacobian) the same mixture covers it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fit.shear import Shear, fit_shear

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Straight:
    """Coordinates in which draws lie straight: first those that bend the others, the widest of them foremost."""

    order: NDArray[np.int64]
    shear: Shear

    @classmethod
    def of(cls, x: Array) -> Straight:
        """From draws (n, d)."""
        order = np.lexsort((-x.std(axis=0), bent(x)))
        return cls(order, fit_shear(x[:, order], np.zeros(x.shape[1])))

    def forward(self, x: Array) -> Array:
        """Straight coordinates (n, d) of x (n, d)."""
        return self.shear.forward(x[:, self.order])

    def inverse(self, y: Array) -> Array:
        """x (n, d) of straight coordinates (n, d)."""
        out = np.empty_like(y)
        out[:, self.order] = self.shear.inverse(np.ascontiguousarray(y))
        return out


def bent(x: Array) -> Array:
    """Share (d,) of each coordinate's variance that the square of another explains beyond itself; 0 below a tenth."""
    t = (x - x.mean(axis=0)) / (x.std(axis=0) + 1e-300)
    out = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        square = t[:, i] ** 2 - 1.0
        square = square - t[:, i] * np.mean(square * t[:, i])
        share = (square @ t / len(t)) ** 2 / max(float(np.mean(square**2)), 1e-300)
        share[i] = 0.0
        out = np.maximum(out, share)
    return np.where(out < 0.1, 0.0, out)

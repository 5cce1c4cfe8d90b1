"""The search on voltage recordings: time constants, compliances projected out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..likelihood.linear_group import LinearGroup
from ..models.model import Model
from .projection import Projection, Times


class VoltageSearch(Projection):
    """Time constants of a linear model on voltage recordings; compliances projected out against the Gram sums."""

    def __init__(
        self,
        model: Model,
        groups: list[LinearGroup],
        sigma: float,
        rho: NDArray,
        rng: np.random.Generator,
        draws: int = 4000,
    ):
        z = model.prior_draws(draws, rng)
        self.model, self.basis_group = model, groups[0]
        self.M = np.sum([g.projected(sigma, rho) for g in groups], axis=0)
        self.nonlinear = model.nonlinear_index()
        self.linear = np.setdiff1d(np.arange(model.dimension), self.nonlinear)
        self.times = Times(z[:, self.nonlinear])
        super().__init__(np.ones(self.nonlinear.size), z[:, self.nonlinear], z[:, self.linear])

    def at(self, cube: NDArray) -> NDArray:
        """See `Projection`."""
        return self.times.at(cube)

    def logarithms(self, x: NDArray) -> NDArray:
        """See `Projection`."""
        return self.times.ordered(x)

    def equations(self, x: NDArray) -> tuple[NDArray, NDArray, float]:
        """See `Projection`."""
        B = len(x)
        z = np.zeros((B, self.model.dimension))
        log_T = z[:, self.nonlinear] = self.times.ordered(x)
        T = np.exp(log_T)
        m = T.shape[1]
        unit = self.basis_group.vectors_of(np.zeros(B * m), np.ones((B * m, 1)), T.reshape(-1, 1)).reshape(B, m, -1)
        q = unit.shape[2]
        feedthrough = np.zeros((B, 1, q))
        feedthrough[:, 0, -1] = 1.0
        W = np.einsum("bkp,bkq->bpq", self.model.design(z), np.concatenate([feedthrough, unit], axis=1))
        H = np.einsum("bpq,qr,bsr->bps", W, self.M[:q, :q], W, optimize=True)
        return H, W @ self.M[:q, -1], float(self.M[-1, -1])

    def log_prior(self, x: NDArray, a: NDArray) -> NDArray:
        """See `Projection`."""
        return self.model.log_prior(self._joined(x, a))

    def _joined(self, x: NDArray, a: NDArray) -> NDArray:
        z = np.empty((len(x), self.model.dimension))
        z[:, self.nonlinear] = self.times.ordered(x)
        z[:, self.linear] = a
        return z

    def coordinates(self, x: NDArray) -> NDArray:
        """Coordinates (B, d) of the model at x (B, m)."""
        return self._joined(x, self.solve(x)[0])

"""Block means made white, with what is linear in each recording eliminated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import BlockFactor
from .journal import digest
from .reduced import Piece

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """sigma by channel; rho by channel and rate."""

    sigma: Mapping[str, float]
    rho: Mapping[str, tuple[float, ...]]

    @property
    def key(self) -> tuple[object, ...]:
        """What a digest is made of."""
        return tuple(self.sigma.items()), tuple(self.rho.items())

    def of(self, piece: Piece) -> tuple[float, float]:
        """sigma and rho of a piece."""
        return self.sigma[piece.channel], self.rho[piece.channel][piece.rate]


@dataclass(frozen=True)
class Whitened:
    """Columns of one piece whitened, nuisance columns beside them."""

    columns: Array  # (k, nb)
    nuisance: Array  # (m, nb)
    cross: Array  # (m, k): B C^T, their products
    coupling: Array  # (m, k): what elimination takes from the columns: M^-1 B C^T
    logdet: float  # of the covariance of the block means, nuisance integrated out

    def gram(self) -> Array:
        """(k, k) Gram of the columns, nuisance integrated out."""
        with np.errstate(over="ignore", invalid="ignore"):  # a model that runs away: not finite, as descents ask
            return np.asarray(self.columns @ self.columns.T - self.cross.T @ self.coupling)


class Whitener:
    """What makes the columns of a piece white under one noise, worked out once for as many as are asked for.

    What the scatter of a position leaves in the lines that drive the model is part of the noise (`Piece.carried`): with
    these columns A whitened, (1 + A'A)^(-1/2), worked out in the space that they span.
    """

    def __init__(self, piece: Piece, sigma: float, rho: float) -> None:
        blocks = piece.blocks
        self._factor = BlockFactor.of(blocks.count, sigma, rho, blocks.gap, piece.further_variance)
        #: log determinant of the covariance of the block means
        self.logdet = self._factor.logdet
        self._along, self._taken = np.empty((0, blocks.n)), np.empty(0)
        if len(piece.carried):
            A = self._factor.whiten(piece.carried)
            size, turn = np.linalg.eigh(A @ A.T)
            real = size > 1e-12 * max(float(size[-1]), 1e-300)
            size, turn = size[real], turn[:, real]
            self._along = (turn / np.sqrt(size)).T @ A
            self._taken = 1.0 - 1.0 / np.sqrt(1.0 + size)
            self.logdet += float(np.sum(np.log1p(size)))
        #: nuisance columns (m, nb) whitened, and their covariance (m, m) given the recording
        self.nuisance = self.columns(piece.nuisance)
        M = self.nuisance @ self.nuisance.T + np.diag(1.0 / piece.nuisance_sd**2)
        self.inner = np.asarray(np.linalg.inv(M), dtype=float)
        self._eliminated = float(np.linalg.slogdet(M)[1] + 2.0 * np.sum(np.log(piece.nuisance_sd)))

    def columns(self, x: Array) -> Array:
        """Columns x (k, nb) whitened."""
        white = self._factor.whiten(x)
        if not self._taken.size:
            return white
        return np.asarray(white - (white @ self._along.T) * self._taken @ self._along)

    def __call__(self, x: Array) -> Whitened:
        """Columns x (k, nb) whitened, with the posterior of the nuisance worked in."""
        C = self.columns(x)
        cross = self.nuisance @ C.T
        return Whitened(C, self.nuisance, cross, self.inner @ cross, self.logdet + self._eliminated)


def whitener(piece: Piece, noise: Noise) -> Whitener:
    """Of a piece under a noise."""
    sigma, rho = noise.of(piece)
    return piece.whiteners((sigma, rho), None, lambda: Whitener(piece, sigma, rho))


def whiten(piece: Piece, columns: Array, noise: Noise) -> Whitened:
    """Whitened columns (k, nb) of a piece, with the posterior of its nuisance worked in."""
    return whitener(piece, noise)(columns)


def whiten_columns(piece: Piece, columns: Array, noise: Noise) -> tuple[Array, float]:
    """Columns (k, nb) of a piece whitened by its noise, and the log determinant of the covariance."""
    known = whitener(piece, noise)
    return known.columns(columns), known.logdet


class Shared:
    """Columns that all recordings share, with coefficients of their own: whitened once for a noise.

    A fit with a discrepancy beside it asks for them at every step, and they are many.
    """

    def __init__(self, columns: Sequence[Array]) -> None:
        """columns: by piece (K, nb)."""
        self._columns = tuple(columns)
        self.key = digest(*self._columns)
        self._noise: Noise | None = None
        self._whitened: list[Whitened] = []
        self._among = np.empty((0, 0))

    def of(self, pieces: Sequence[int]) -> Shared:
        """The columns of some of the pieces."""
        return Shared([self._columns[i] for i in pieces])

    def grams(
        self, pieces: Sequence[Piece], beside: Sequence[Whitened], noise: Noise
    ) -> tuple[Array, Array]:
        """Grams over all pieces, nuisance integrated out: of the columns (K, K), and with those `beside` (K, k)."""
        if noise != self._noise:
            self._whitened = [whiten(p, x, noise) for p, x in zip(pieces, self._columns, strict=True)]
            among = np.sum([w.gram() for w in self._whitened], axis=0)
            self._among, self._noise = 0.5 * (among + among.T), noise
        cross = [
            own.columns @ w.columns.T - own.cross.T @ w.coupling
            for own, w in zip(self._whitened, beside, strict=True)
        ]
        return self._among, np.asarray(np.sum(cross, axis=0))

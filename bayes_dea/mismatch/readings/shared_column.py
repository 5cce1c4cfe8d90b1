"""A column beside a fit that all recordings share: what it promises, and its coefficient once it is in."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...gauss_newton.whitening import Shared, whiten
from ..left_out import Repaired, beside_rows, refit_without

Array = NDArray[np.float64]


def in_column(fit: Fit, column: Callable[[Piece], Array]) -> Repaired:
    """A fit with a column beside it that all recordings share, as a repair.

    column: of a recording, also of one that was not fitted, over the coefficient (nb,).
    """
    size, _ = coefficient(fit)
    _, gains = fit.problem.beside(fit.q)

    def added(piece: Piece, rows: Array, means: Array) -> tuple[Array, Array]:
        # it stands beside what the sensor's gain is on
        return beside_rows(piece, rows, means, size * column(piece) / (1.0 + float(gains[piece.group])))

    def again(name: str, prior: NoisePrior) -> Repaired | None:
        other = refit_without(fit, name, prior)
        return None if other is None else in_column(other, column)

    return Repaired(fit, added=added, again=again)


def products(fit: Fit, shared: Shared) -> tuple[Array, Array]:
    """Squares (K,) of shared columns, and their products with residuals and sensitivities (K, 1 + d), all whitened."""
    problem = fit.problem
    whitened = [
        whiten(p, problem.columns(i, fit.q, fit.clean, fit.slopes), fit.noise) for i, p in enumerate(problem.pieces)
    ]
    among, beside = shared.grams(problem.pieces, whitened, fit.noise)
    return np.diag(among), np.asarray(beside)


def left(fit: Fit, shared: Shared) -> tuple[Array, Array]:
    """What is left of the squares (K,) of columns once all parameters move along linearly, and their products with the
    residuals (K,); nan where nothing is left."""
    squares, beside = products(fit, shared)
    by = beside[:, 1:]
    own = squares - np.sum(by * np.linalg.solve(fit.hessian, by.T).T, axis=1)
    return np.where(own > 1e-9 * squares, own, np.nan), beside[:, 0]


def coefficient(fit: Fit) -> tuple[float, float]:
    """Mean and sd of the coefficient of the column of a fit, all parameters moving along."""
    own, beside = _own(fit)
    by = beside[1:]
    rest = own - float(by @ np.linalg.solve(_whole(fit, own, by), by))
    return float(beside[0] / own), 1.0 / math.sqrt(max(rest, 1e-12 * own))


def without_column(fit: Fit) -> Fit:
    """A fit with a column, at its place, as if it had none: what other columns promise there is seen by it."""
    own, beside = _own(fit)
    return replace(fit, problem=replace(fit.problem, shared=None), hessian=_whole(fit, own, beside[1:]))


def _own(fit: Fit) -> tuple[float, Array]:
    """The square of the column of a fit with its prior, and its products with residuals and sensitivities (1 + d,)."""
    assert fit.problem.shared is not None
    (square,), (beside,) = products(fit, fit.problem.shared)
    return float(square) + 1.0 / fit.problem.amplitude_m**2, beside


def _whole(fit: Fit, own: float, by: Array) -> Array:
    """The hessian (d, d) of a fit with a column, which has that integrated out, with it known."""
    return np.asarray(fit.hessian + np.outer(by, by) / own)

"""A column beside a fit that all recordings share: what it promises, and its coefficient once it is in."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.refit import Fit
from ...gauss_newton.whitening import Shared, whiten

Array = NDArray[np.float64]


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
    assert fit.problem.shared is not None
    (square,), (beside,) = products(fit, fit.problem.shared)
    own = float(square) + 1.0 / fit.problem.amplitude_m**2
    by = beside[1:]
    # the hessian of the fit has it integrated out
    whole = fit.hessian + np.outer(by, by) / own
    rest = own - float(by @ np.linalg.solve(whole, by))
    return float(beside[0] / own), 1.0 / math.sqrt(max(rest, 1e-12 * own))

"""A recording's own offset, gain and mains by least squares: what a comparison of shapes does not count."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ...gauss_newton.reduced import Piece
from .range_end import expected_at_most

Array = NDArray[np.float64]
#: sd of a recording's gain around one where its readings may not say
_GAIN_SD = 0.1
#: steps to the coefficients of readings that end at a limit, at most, and sds that the last one may move a reading by
_STEPS, _SETTLED = 20, 1e-3


def own_offset_and_gain(piece: Piece, x: Array) -> Array:
    """Residual (n,) after the recording's own gain, offset and mains by least squares; nan without a reading."""
    p = piece.prepared
    expected, _ = offset_and_gain(piece, x)
    return np.where(p.observed, p.y - expected, np.nan)


def offset_and_gain(
    piece: Piece, x: Array, limit_m: float = math.inf, sd: float = 0.0
) -> tuple[Array, tuple[float, float]]:
    """Expected readings (n,) with the recording's own gain, offset and mains by least squares; (gain, offset).

    nan where the model has no finite answer. limit_m: end of the sensor's range, sd: of the noise that ends there with
    the readings; expected are the readings had the sensor no limit.
    """
    p = piece.prepared
    if not np.isfinite(x).all():
        return np.full(x.shape, np.nan), (math.nan, math.nan)
    A = np.concatenate([x[:, None], p.nuisance()], axis=1)
    scale = np.maximum(np.abs(A).max(axis=0), 1e-300)
    A = A / scale
    if math.isinf(limit_m):
        c, *_ = np.linalg.lstsq(A[p.observed], p.y[p.observed], rcond=None)
    else:
        c = _below_a_limit(A, p.observed, p.y, scale[0], limit_m, sd)
    return A @ c, (float(c[0] / scale[0]), float(c[1] / scale[1]))


def _below_a_limit(A: Array, seen: NDArray[np.bool_], y: Array, scale: float, limit_m: float, sd: float) -> Array:
    """Coefficients (k,) of columns (n, k), the model's output over `scale` first, for readings that end at a limit."""
    # rows expected far below the limit begin it. They may say nothing of the gain (a creep whose plateau is cut off):
    # it is one within what sensors allow
    c = np.zeros(A.shape[1])
    c[0] = scale
    prior = np.zeros((1, c.size))
    prior[0, 0] = sd / (_GAIN_SD * scale)
    for _ in range(4):
        good = seen & (A @ c < limit_m - 3.0 * sd)
        if good.sum() < 20:
            break
        c, *_ = np.linalg.lstsq(np.concatenate([A[good], prior]), np.append(y[good], sd / _GAIN_SD), rcond=None)
    # then all of them: what noise takes below the limit tells how far above it a reading would lie
    A, y = A[seen], y[seen]
    for _ in range(_STEPS):
        mean = A @ c
        J = ndtr((limit_m - mean) / sd)[:, None] * A
        left = np.append(y - expected_at_most(mean, sd, limit_m), sd / _GAIN_SD - prior[0, 0] * c[0])
        step, *_ = np.linalg.lstsq(np.concatenate([J, prior]), left, rcond=None)
        c = c + step
        if np.abs(A @ step).max() < _SETTLED * sd:
            break
    return c

"""A recording's own offset, gain and mains by least squares: what a comparison of shapes does not count."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece

Array = NDArray[np.float64]
#: sd of a recording's gain around one where its readings may not say
_GAIN_SD = 0.1


def own_offset_and_gain(piece: Piece, x: Array, limit_m: float = math.inf) -> Array:
    """Residual (n,) after the recording's own gain, offset and mains by least squares; nan without a reading.

    limit_m: end of the sensor's range; rows whose reading it cut are predicted by it and do not enter the fit.
    """
    p = piece.prepared
    expected, _ = offset_and_gain(piece, x, limit_m)
    return np.where(p.observed, p.y - np.minimum(expected, limit_m), np.nan)


def offset_and_gain(piece: Piece, x: Array, limit_m: float = math.inf) -> tuple[Array, tuple[float, float]]:
    """Expected readings (n,) with the recording's own gain, offset and mains by least squares; (gain, offset).

    nan where the model has no finite answer.
    """
    p = piece.prepared
    if not np.isfinite(x).all():
        return np.full(x.shape, np.nan), (math.nan, math.nan)
    A = np.concatenate([x[:, None], p.nuisance()], axis=1)
    scale = np.maximum(np.abs(A).max(axis=0), 1e-300)
    A = A / scale
    if math.isinf(limit_m):
        c, *_ = np.linalg.lstsq(A[p.observed], p.y[p.observed], rcond=None)
        return A @ c, (float(c[0] / scale[0]), float(c[1] / scale[1]))
    # rows expected at the limit or above tell no more than that. What is left may say nothing of the gain (a creep
    # whose plateau is cut off): it is one within what sensors allow
    c = np.zeros(A.shape[1])
    c[0] = scale[0]
    weight = p.quiet_sd / _GAIN_SD
    prior = np.zeros((1, A.shape[1]))
    prior[0, 0] = weight / scale[0]
    for _ in range(4):
        good = p.observed & (A @ c < limit_m - 3.0 * p.quiet_sd)
        if good.sum() < 20:
            break
        c, *_ = np.linalg.lstsq(np.concatenate([A[good], prior]), np.append(p.y[good], weight), rcond=None)
    return A @ c, (float(c[0] / scale[0]), float(c[1] / scale[1]))

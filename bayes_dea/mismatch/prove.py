"""The proof: recordings that no fit has seen, before and after the correction."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import block_means
from .problem import whiten
from .reduced import Piece
from .refit import Fit

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HeldOut:
    """One held-out recording: RMSE over its samples after its own offset, gain and mains, and log densities."""

    recording: str
    channel: str
    n: int
    rmse_before: float
    rmse_after: float
    noise: float
    elpd_before: float
    elpd_after: float
    before: Array  # (nb,) residual block means
    after: Array
    time_s: Array


def held_out(before: Fit, after: Fit, pieces: tuple[Piece, ...]) -> list[HeldOut]:
    """Score pieces under two fits, each with its own offset, gain and mains line."""
    problems = [replace(f.problem, pieces=pieces) for f in (before, after)]
    rows = [p.rows(f.q) for p, f in zip(problems, (before, after), strict=True)]
    means = [p.clean(f.q) for p, f in zip(problems, (before, after), strict=True)]
    out = []
    for i, piece in enumerate(pieces):
        scored = []
        for fit, x, m in zip((before, after), rows, means, strict=True):
            rest = own_offset_and_gain(piece, x[i])
            scored.append((rest, _log_density(fit, piece, m[i])))
        (r0, e0), (r1, e1) = scored
        masked = ~piece.prepared.observed
        out.append(
            HeldOut(
                piece.name,
                piece.channel,
                int(np.isfinite(r1).sum()),
                _rms(r0),
                _rms(r1),
                after.noise.of(piece)[0],
                e0,
                e1,
                block_means(np.where(masked, 0.0, r0), piece.blocks, masked),
                block_means(np.where(masked, 0.0, r1), piece.blocks, masked),
                piece.blocks.time_s,
            )
        )
    return out


def own_offset_and_gain(piece: Piece, x: Array) -> Array:
    """Residual (n,) after the recording's own gain, offset and mains by least squares; nan without a reading."""
    p = piece.prepared
    A = np.concatenate([x[:, None], p.nuisance()], axis=1)
    scale = np.maximum(np.abs(A).max(axis=0), 1e-300)
    A = A / scale
    good = p.observed
    c, *_ = np.linalg.lstsq(A[good], p.y[good], rcond=None)
    return np.where(good, p.y - A @ c, np.nan)


def _rms(residual: Array) -> float:
    return math.sqrt(float(np.nanmean(residual**2)))


def _log_density(fit: Fit, piece: Piece, x: Array) -> float:
    """Log density of the recording's block means, offset, mains and gain integrated out."""
    g_sd = float(fit.problem.gain_sd[piece.group])
    _, gains = fit.problem.beside(fit.q)
    gain = float(gains[piece.group])
    w = whiten(piece, np.stack([piece.y - (1 + gain) * x, x]), fit.noise)
    G = w.gram()
    # gain: normal around the fitted one, with what the sensor's statement still allows
    information = G[1, 1] + 1.0 / g_sd**2
    value = G[0, 0] - G[0, 1] ** 2 / information
    return -0.5 * (value + w.logdet + math.log(information * g_sd**2) + piece.blocks.n * math.log(2 * math.pi))

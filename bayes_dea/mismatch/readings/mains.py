"""Mains as a verdict: whether its amplitude exceeds one resolution step (CONTRACT 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np

from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...noise.line_amplitude import SeenLine, line_sd, probability_above


@dataclass(frozen=True)
class MainsSeen(SeenLine):
    """A line of mains with its frequency, and the standard error of that."""

    frequency_Hz: float
    frequency_se_Hz: float


def mains_frequency(pieces: tuple[Piece, ...]) -> float:
    """Frequency (Hz) of the strongest mains line found on a displacement; 0 where there is none."""
    found = [
        line
        for p in pieces
        if p.channel == "displacement" and p.prepared.mains is not None
        for line in p.prepared.mains.lines
    ]
    return max(found, key=lambda line: line.amplitude).frequency_Hz if found else 0.0


def mains_lines(fit: Fit) -> list[MainsSeen]:
    """The strongest mains line in the residuals of every fitted displacement recording."""
    pieces = fit.problem.pieces
    frequency = mains_frequency(pieces)
    if frequency <= 0:
        return []
    out = []
    for piece, x in zip(pieces, fit.problem.rows(fit.q), strict=True):
        if piece.channel != "displacement":
            continue
        p = piece.prepared
        own = [line.frequency_Hz for line in p.mains.lines] if p.mains is not None else []
        near = [f for f in own if abs(f - frequency) < 0.02 * frequency]
        own_Hz = near[0] if near else frequency
        phase = 2 * np.pi * own_Hz * p.recording.time_s
        good = p.observed
        scaled = x / max(float(np.max(np.abs(x))), 1e-300)
        A = np.stack([scaled, np.ones(x.size), np.cos(phase), np.sin(phase)], axis=1)[good]
        c, *_ = np.linalg.lstsq(A, p.y[good], rcond=None)
        sigma, rho = fit.noise.of(piece)
        sd = line_sd(sigma, rho, frequency, p.reading_step_s, int(good.sum()))
        amplitude = float(np.hypot(c[2], c[3]))
        # Cramer-Rao bound of a line's frequency in white noise (Rife and Boorstyn 1974, doi:10.1109/TIT.1974.1055282)
        lasts = float(p.recording.time_s[-1] - p.recording.time_s[0])
        error_Hz = math.sqrt(12.0) / (2.0 * math.pi * lasts) * sd / max(amplitude, 1e-300)
        out.append(MainsSeen(amplitude, sd, bool(near), own_Hz, error_Hz))
    return out


def mains_probability(lines: Sequence[MainsSeen], resolution_m: float) -> float:
    """Probability that mains on the displacement exceeds one resolution step."""
    return probability_above(list(lines), resolution_m)


def mains_parameters(lines: Sequence[MainsSeen]) -> dict[str, dict[str, Any]]:
    """Amplitude and frequency of the line as parameters of diagnosis.json; its phase is another in every recording."""
    found = [x for x in lines if x.found]
    if not found:
        return {}
    amplitude = _pooled(np.array([x.amplitude for x in found]), np.array([x.sd for x in found]))
    frequency = _pooled(np.array([x.frequency_Hz for x in found]), np.array([x.frequency_se_Hz for x in found]))
    return {"mains_m": {**amplitude, "unit": "m"}, "mains_Hz": {**frequency, "unit": "Hz"}}


def _pooled(values: np.ndarray, sd: np.ndarray) -> dict[str, float]:
    """Weighted mean, with a standard error that knows what the values scatter by beyond their own."""
    weight = sd**-2.0
    mean = float(weight @ values / weight.sum())
    beyond = float(weight @ (values - mean) ** 2) / max(len(values) - 1, 1)
    error = math.sqrt(max(beyond, 1.0) / weight.sum())
    low, high = (NormalDist(mean, error).inv_cdf(p) for p in (0.05, 0.95))
    return {"mean": mean, "sd": error, "q05": low, "q50": mean, "q95": high, "map": mean}

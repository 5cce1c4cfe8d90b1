"""Mains as a verdict: whether its amplitude exceeds one resolution step (CONTRACT 1)."""

from __future__ import annotations

import numpy as np

from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...noise.line_amplitude import SeenLine, line_sd, probability_above


def mains_frequency(pieces: tuple[Piece, ...]) -> float:
    """Frequency (Hz) of the strongest mains line found on a displacement; 0 where there is none."""
    found = [
        line
        for p in pieces
        if p.channel == "displacement" and p.prepared.mains is not None
        for line in p.prepared.mains.lines
    ]
    return max(found, key=lambda line: line.amplitude).frequency_Hz if found else 0.0


def mains_lines(fit: Fit) -> list[SeenLine]:
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
        phase = 2 * np.pi * (near[0] if near else frequency) * p.recording.time_s
        good = p.observed
        scaled = x / max(float(np.max(np.abs(x))), 1e-300)
        A = np.stack([scaled, np.ones(x.size), np.cos(phase), np.sin(phase)], axis=1)[good]
        c, *_ = np.linalg.lstsq(A, p.y[good], rcond=None)
        sigma, rho = fit.noise.of(piece)
        sd = line_sd(sigma, rho, frequency, p.reading_step_s, int(good.sum()))
        out.append(SeenLine(float(np.hypot(c[2], c[3])), sd, bool(near)))
    return out


def mains_probability(fit: Fit, resolution_m: float) -> float:
    """Probability that mains on the displacement exceeds one resolution step."""
    return probability_above(mains_lines(fit), resolution_m)

"""A smooth discrepancy of no stated physics: what "unknown" adds to a model.

Linear columns over time since an edge, level and harmonics of the excitation, with normal coefficients of one
amplitude; the amplitude runs over a log-uniform grid. Under V = 0 from the start of a recording all columns vanish.
Kennedy & O'Hagan 2001, doi:10.1111/1467-9868.00294, with the structure stated instead of a stationary kernel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, extrapolated, refit
from ...gauss_newton.whitening import Shared
from ..telling import Tell, silence
from .features import HARMONICS, Features, features
from .size import stiffness

Array = NDArray[np.float64]

#: amplitudes in m of displacement over which the prior is log-uniform
AMPLITUDES_M = np.array([0.3e-6, 1.2e-6, 5e-6, 20e-6])
#: knots of time since an edge in s
KNOTS = np.array([0.002, 0.006, 0.02, 0.06, 0.2, 0.6, 2.0, 6.0, 20.0, 60.0, 200.0])
#: nats behind the best amplitude at which larger ones are not tried
_BEYOND = 30.0
#: nats that moving the model may promise for a straight step to say what it comes to
_STRAIGHT = 2.0


def basis(fit: Fit, looks: list[Features] | None = None) -> list[Array]:
    """Columns (K, nb) of every piece, of order one, shared coefficients where the feature is shared."""
    pieces = fit.problem.pieces
    looks = looks or [features(p) for p in pieces]
    voltage = [i for i, p in enumerate(pieces) if p.channel == "displacement"]
    # at rest, and without a voltage, there is nothing to be a part of
    top = max((float(np.max(looks[i].level)) for i in voltage), default=0.0) or 1.0
    shared: list[dict[str, Array]] = []
    for i, (piece, f) in enumerate(zip(pieces, looks, strict=True)):
        columns: dict[str, Array] = {}
        nb = piece.blocks.n
        if i in voltage:
            v = f.level / top
            columns["V^2"], columns["V^4"], columns["V^6"] = v**2, v**4, v**6
            size = (np.clip(np.abs(f.jump) / top, 0, 1)) ** 2
            for rising in (1, -1):
                side = (np.sign(f.jump) == rising) & np.isfinite(f.since_edge_s)
                hats = _hats(np.log(np.maximum(np.where(side, f.since_edge_s, 1.0), 1e-4)), np.log(KNOTS))
                for k in range(KNOTS.size):
                    columns[f"{rising}:{k}"] = np.where(side, hats[k] * np.sqrt(size), 0.0)
                    columns[f"{rising}:{k}:size"] = np.where(side, hats[k] * size, 0.0)
            columns["up"], columns["down"] = np.clip(f.speed, 0, 1) * v, np.clip(-f.speed, 0, 1) * v
        inside = np.isfinite(f.phase)
        if inside.any():
            for k in range(HARMONICS + 1):
                turn = 2 * np.pi * k * np.where(inside, f.phase, 0.0)
                columns[f"{i}:c{k}"] = np.where(inside, np.cos(turn), 0.0)
                if k:
                    columns[f"{i}:s{k}"] = np.where(inside, np.sin(turn), 0.0)
        x = np.linspace(-1, 1, nb)
        moved = np.cumsum(np.abs(np.diff(f.level, prepend=f.level[:1]))) > 0
        for k in (1, 2, 3):
            columns[f"{i}:t{k}"] = np.where(moved, x**k, 0.0)
        if i not in voltage:
            e = (f.level - f.level.min()) / max(float(np.ptp(f.level)), 1e-12)
            for k in (2, 3, 4):
                columns[f"force e^{k}"] = e**k
            each = stiffness(fit, piece)  # a force counts as the displacement that it makes
            columns = {k: v * each for k, v in columns.items()}
        shared.append(columns)
    names = list(dict.fromkeys(k for c in shared for k in c))
    return [np.stack([c.get(k, np.zeros(p.blocks.n)) for k in names]) for c, p in zip(shared, pieces, strict=True)]


def _hats(x: Array, knots: Array) -> Array:
    """Piecewise linear hats (K, n) on knots; the outer ones level off."""
    y = np.clip(x, knots[0], knots[-1])
    out = np.zeros((knots.size, x.size))
    left = np.clip(np.searchsorted(knots, y, side="right") - 1, 0, knots.size - 2)
    w = (y - knots[left]) / (knots[left + 1] - knots[left])
    rows = np.arange(x.size)
    out[left, rows] = 1 - w
    out[left + 1, rows] = w
    return out


@dataclass(frozen=True)
class Discrepancy:
    """What a discrepancy adds to a fit's log evidence, and its amplitude where it is best."""

    gain: float  # log evidence with it, minus that without
    amplitude_m: float


def discrepancy(
    fit: Fit, columns: list[Array], prior: NoisePrior, starts: Sequence[Array] = (), tell: Tell = silence,
    straight: bool = False,
) -> Discrepancy:
    """Evidence of a model with a discrepancy beside it, relative to the fit alone; the model is refitted with it.

    starts: further coordinates to begin from (a model that imitated what was left out has to find back). straight:
    nothing is refitted; for what is left by an explanation that is not adequate, whatever its size.
    """
    gains = []
    best = (-math.inf, 0.0)
    # a discrepancy changes no sensitivity of the model
    seeds = [(fit.q, fit.linearisation), *((q, None) for q in starts)]
    shared = Shared(columns)
    for k, a in enumerate(AMPLITUDES_M):
        tell(k, AMPLITUDES_M.size, f"a discrepancy of {1e6 * a:.1f} um")
        problem = replace(fit.problem, shared=shared, amplitude_m=float(a))
        top, promised = extrapolated(problem, fit, prior)
        if starts or not (straight or promised < _STRAIGHT):
            refits = [
                refit(problem, q, fit.noise, prior, max_steps=8, fit_noise=False, coarse=True, known=k)
                for q, k in seeds
            ]
            found = [f for f in refits if f is not None]
            top = max((f.log_evidence for f in found), default=-math.inf)
            same = [f for f in found if f.log_evidence == top]
            if same:
                seeds = [(same[0].q, same[0].linearisation)]
        gains.append(top - fit.log_evidence)
        best = max(best, (gains[-1], float(a)))
        if gains[-1] < best[0] - _BEYOND:
            break
    g = np.array(gains)
    mean = float(np.max(g) + np.log(np.sum(np.exp(g - np.max(g))) / AMPLITUDES_M.size))
    return Discrepancy(mean, best[1])

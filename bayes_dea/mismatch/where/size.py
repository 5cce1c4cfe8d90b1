"""How large an effect is: what it moves a recording by, everything else refitted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ..left_out import Repaired

Array = NDArray[np.float64]
#: step of the displacement (m) where no resolution is stated
STEP_M = 0.15e-6


def effect_size(base: Fit, fit: Fit) -> float:
    """Largest RMS in m over all recordings of the difference between two fits, offsets removed; forces by steps."""
    return _largest(base, fit, base.clean, fit.clean)


def repair_size(base: Fit, repaired: Repaired) -> float:
    """The same of a fit and one with a repair in it."""
    fit = repaired.fit
    both = zip(fit.problem.pieces, fit.clean, strict=True)
    changed = [repaired.predicted(p, np.zeros(p.recording.n), x)[1] for p, x in both]
    return _largest(base, fit, base.clean, changed)


def size_elsewhere(base: Fit, fit: Fit, pieces: Sequence[Piece]) -> float:
    """The same over other voltage recordings, of which the commands alone are needed and no reading."""
    plain, corrected = (replace(f, problem=replace(f.problem, pieces=tuple(pieces))) for f in (base, fit))
    before, after = plain.problem.clean(plain.q), corrected.problem.clean(corrected.q)
    if not all(np.isfinite(x).all() for x in (*before, *after)):
        return 0.0
    return _largest(plain, corrected, before, after)


def _largest(base: Fit, fit: Fit, plain: Sequence[Array], changed: Sequence[Array]) -> float:
    worst = 0.0
    for piece, x0, x1 in zip(fit.problem.pieces, plain, changed, strict=True):
        _, g0 = base.problem.beside(base.q)
        _, g1 = fit.problem.beside(fit.q)
        x = (1 + g1[piece.group]) * x1 - (1 + g0[piece.group]) * x0
        w = piece.blocks.count / piece.blocks.count.sum()
        x = x - w @ x
        rms = math.sqrt(float(w @ x**2))
        each = 1.0 if piece.channel == "displacement" else _metres_a_newton(piece, fit)
        worst = max(worst, each * rms)
    return worst


def _metres_a_newton(force: Piece, fit: Fit) -> float:
    """What a force counts for beside displacements: a step of its sensor's resolution is one of theirs.

    Where none is stated it counts as the displacement that it makes.
    """
    own = force.prepared.sensor.resolution
    theirs = [p.prepared.sensor.resolution for p in fit.problem.pieces if p.channel == "displacement"]
    return next((step for step in theirs if step), STEP_M) / own if own else 1.0 / stiffness(fit, force)


def stiffness(fit: Fit, force: Piece) -> float:
    """Force (N) that a metre between the plates of a mechanical recording takes, by a fit's law at small strain."""
    plant = replace(fit.problem, pieces=(force,)).plants(fit.q)[0]
    return plant.Y_Pa * plant.area_m2 / plant.height_m

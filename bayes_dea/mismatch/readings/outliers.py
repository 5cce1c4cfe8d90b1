"""False readings that only a fit makes visible: found in its residuals, masked, and told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...campaign.rhythm import with_a_reading
from ...gauss_newton.reduced import Piece, again
from ...gauss_newton.refit import Fit
from ...models.electrostatics import filled_input
from ...noise.isolated import Recurrence, isolated_outliers, recurrence
from ..where.features import excitation
from .own_offset import own_offset_and_gain

Array = NDArray[np.float64]

#: times that a warning names
_NAMED = 5


def false_readings(fit: Fit, pieces: Sequence[Piece]) -> dict[str, NDArray[np.bool_]]:
    """Rows (n,) of false readings by recording, for displacement pieces under a fit (see `isolated_outliers`).

    Of a sensor that is read at every k-th row these rows alone are neighbours.
    """
    found = {}
    problem = replace(fit.problem, pieces=tuple(pieces))
    seen: list[tuple[Piece, Array, Recurrence]] = []
    for piece, x in zip(pieces, problem.rows(fit.q), strict=True):
        if piece.channel != "displacement" or not np.isfinite(x).all():
            continue
        r = piece.recording
        u = filled_input(r.columns["voltage_V"])
        frequency = excitation(r.time_s, u)[0]
        read = with_a_reading(piece.prepared.y)
        back = recurrence(u[read], 1.0 / frequency if frequency > 0 else 0.0)
        seen.append((piece, own_offset_and_gain(piece, x)[read], back))
    for piece, residual, back in seen:
        step = piece.prepared.reading_step_s
        elsewhere = [
            (other, its)
            for p, other, its in seen
            if p is not piece and abs(p.prepared.reading_step_s - step) < 0.01 * step
        ]
        sigma, rho = fit.noise.of(piece)
        read = with_a_reading(piece.prepared.y)
        rows = np.zeros(piece.prepared.y.size, dtype=np.bool_)
        rows[read] = isolated_outliers(
            residual, piece.recording.time_s[read], sigma, rho, back, piece.prepared.sensor.resolution or 0.0, elsewhere
        )
        if rows.any():
            found[piece.name] = rows
    return found


def without(pieces: Sequence[Piece], rows: dict[str, NDArray[np.bool_]]) -> tuple[Piece, ...]:
    """The pieces with rows of some of them masked."""
    return tuple(
        again(p, replace(p.prepared, observed=p.prepared.observed & ~rows[p.name])) if p.name in rows else p
        for p in pieces
    )


def false_reading_warning(piece: Piece, rows: NDArray[np.bool_]) -> str:
    """One line that names recording and times."""
    t = piece.recording.time_s[rows]
    times = ", ".join(f"{x:.3f}" for x in t[:_NAMED]) + (", ..." if t.size > _NAMED else "")
    what, come = ("reading stands", "does") if t.size == 1 else ("readings stand", "do")
    alone = "" if np.any(np.diff(np.flatnonzero(rows)) == 1) else "isolated "
    return (
        f"{piece.name}: {t.size} {alone}{what} out of the noise by more than chance and {come} not come back at "
        f"other edges (at {times} s); taken for drop-outs and left out"
    )

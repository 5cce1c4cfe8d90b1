"""A fit, with a repair in it that is no effect of the list or without, and what it becomes less one recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..gauss_newton.descent import Linearisation
from ..gauss_newton.noise_prior import NoisePrior
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit, refit

Array = NDArray[np.float64]
#: from predictions (n,) and block means (nb,) of a piece to those with what a repair adds to them
Added = Callable[[Piece, Array, Array], tuple[Array, Array]]


def refit_without(fit: Fit, name: str, prior: NoisePrior) -> Fit | None:
    """The fit to its other recordings, begun where that of all has ended; None where that has no answer."""
    left = [i for i, p in enumerate(fit.problem.pieces) if p.name != name]
    known = Linearisation(fit.q, [fit.clean[i] for i in left], [fit.slopes[i] for i in left])
    pieces, shared = tuple(fit.problem.pieces[i] for i in left), fit.problem.shared
    problem = replace(fit.problem, pieces=pieces, shared=None if shared is None else shared.of(left))
    return refit(problem, fit.q, fit.noise, prior, max_steps=3, fit_noise=False, known=known)


def _as_it_is(piece: Piece) -> Piece:
    return piece


@dataclass(frozen=True)
class Repaired:
    """A fit with a repair in it.

    piece: from a recording's piece to the one that the fit predicts; added: what the repair adds to its predictions;
    again: the same without a recording of some name, where that is more than a fit to the others. A play, an offset, a
    time constant or a frequency stay what all recordings say: each flatters the one left out by a nat at most.
    """

    fit: Fit
    piece: Callable[[Piece], Piece] = _as_it_is
    added: Added | None = None
    again: Callable[[str, NoisePrior], Repaired | None] | None = None

    def without(self, name: str, prior: NoisePrior) -> Repaired | None:
        """What becomes of it without a recording; None where the others have no answer."""
        if self.again is not None:
            return self.again(name, prior)
        fit = refit_without(self.fit, name, prior)
        return None if fit is None else replace(self, fit=fit)

    def predicted(self, piece: Piece, rows: Array, means: Array) -> tuple[Array, Array]:
        """Predictions (n,) and block means (nb,) of a piece with the repair, from those of the fit."""
        return (rows, means) if self.added is None else self.added(piece, rows, means)


def beside_rows(piece: Piece, rows: Array, means: Array, own: Array) -> tuple[Array, Array]:
    """Predictions (n,) and block means (nb,) with what comes to `own` (nb,) in these."""
    return rows + np.interp(piece.recording.time_s, piece.blocks.time_s, own), means + own

"""A fit as a place to look around from: sensitivities whitened once, so that another prediction costs one column."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.descent import prior_derivatives
from ...gauss_newton.journal import digest
from ...gauss_newton.problem import Problem
from ...gauss_newton.refit import Fit, inverse
from ...gauss_newton.whitening import Whitener, whitener
from ...models.effects import registered_effects
from ...models.model import Model
from .nearby import Nearby

Array = NDArray[np.float64]

#: how far (in logs) a fit is moved along linearly, at most: the logs bend
_FAR = 0.7


class Frame:
    """A fit's sensitivities, whitened once, so that another prediction costs one column."""

    def __init__(self, fit: Fit, far: bool = False, kind: str = "") -> None:
        """far: what is tried from here changes the sensitivities, so that none is carried over; kind: which fit it is,
        for grids to be carried over to one of the same kind."""
        self.fit, self.far, self.kind = fit, far, kind
        self.nearby = Nearby(fit)
        #: by piece: what makes it white, and the sensitivities (d, nb) less what the nuisance takes from them
        self._eliminated: list[tuple[Whitener, Array]] = []
        total = None
        for i, piece in enumerate(fit.problem.pieces):
            known = whitener(piece, fit.noise)
            w = known(fit.problem.columns(i, fit.q, fit.clean, fit.slopes))
            self._eliminated.append((known, w.columns[1:] - w.coupling[:, 1:].T @ known.nuisance))
            g = w.gram()
            total = g if total is None else total + g
        assert total is not None
        base, gradient, curvature = prior_derivatives(fit.problem, fit.q)
        self.prior, self.gradient, self.curvature = base, gradient, curvature
        self.H = total[1:, 1:] + curvature
        self.Hinv = inverse(0.5 * (self.H + self.H.T))

    @cached_property
    def key(self) -> str:
        """Digest of the fit."""
        return digest(self.fit.problem.key, self.fit.q, self.fit.noise.key)

    def tried(self, problem: Problem, q: Array, effects: Iterable[str]) -> tuple[float, Array] | None:
        """`value` of another model's predictions at q; None where it has no answer.

        effects: those in whose parameters alone q differs from the fit; where they do not act, predictions are known.
        """
        journal = problem.journal
        key = digest("tried", self.key, problem.key, q) if journal.kept else ""
        if key not in journal:
            stay = not any(registered_effects()[name].moves_corners for name in effects)
            found = self.nearby.clean(problem, q, problem.reached_by(effects), to_look=True, corners_stay=stay)
            clean = [x if x.size else known for x, known in zip(found, self.fit.clean, strict=True)]
            value, move = math.nan, np.empty(0)
            if all(np.isfinite(x).all() for x in clean):
                value, move = self.value(clean)
            if not journal.kept:
                return (value, move) if np.isfinite(value) else None
            journal.put(key, [float(value), move.tolist()])
        value, known = journal[key]
        return (value, np.array(known)) if np.isfinite(value) else None

    def value(self, clean: list[Array]) -> tuple[float, Array]:
        """Minus log posterior (without log det terms) of other predictions, base moved along; and the move (d,)."""
        rr, cross = self.residual(clean, self.fit.q)
        cross = cross - self.gradient
        move = self.Hinv @ cross
        return self.prior + 0.5 * rr - 0.5 * float(cross @ move), move

    @property
    def unsettled(self) -> float:
        """Nats that the fit itself gains where it is moved along linearly: none where it is a maximum."""
        _, cross = self.residual(self.fit.clean, self.fit.q)
        cross = cross - self.gradient
        return 0.5 * float(cross @ self.Hinv @ cross)

    def residual(self, clean: list[Array], q: Array) -> tuple[float, Array]:
        """Weighted sum of squared residuals of other predictions, and their product with the sensitivities (d,)."""
        rr, cross = 0.0, np.zeros(self.fit.q.size)
        _, gains = self.fit.problem.beside(q)
        for piece, (known, apart), x in zip(self.fit.problem.pieces, self._eliminated, clean, strict=True):
            one = known.columns((piece.y - (1 + gains[piece.group]) * x)[None])[0]
            b = known.nuisance @ one
            rr += float(one @ one) - float(b @ known.inner @ b)
            cross += apart @ one
        return rr, cross


def trusted(move: Array) -> Array:
    """A linear move (d,), shortened to where it may still be trusted."""
    length = float(np.max(np.abs(move), initial=0.0))
    return move if length <= _FAR else move * (_FAR / length)


def insert(base: Fit, model: Model, own: Array, move: Array | None = None) -> Array:
    """Coordinates of a hypothesis: those of the base (moved), the effect's own where the model has them."""
    q = base.q if move is None else base.q + move
    before = base.problem.model
    out = np.empty(model.dimension)
    out[own_index(base, model)] = own
    names = model.priors.names
    for i, name in enumerate(before.priors.names):
        out[names.index(name)] = q[i]
    return np.concatenate([out, q[before.dimension :]])


def own_index(base: Fit, model: Model) -> NDArray[np.int64]:
    """Positions of the parameters that the effects add."""
    known = set(base.problem.model.priors.names)
    return np.array([i for i, n in enumerate(model.priors.names) if n not in known], dtype=np.int64)

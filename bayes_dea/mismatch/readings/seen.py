"""The base fit and the recordings as a diagnosis sees them: false readings masked, conventions and specimens reread."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, refit
from .clipped import Limit, below
from .outliers import false_reading_warning, false_readings, without
from .own_gains import apart, own_gains
from .own_limits import as_shown, limit_note
from .reread import Rereading, hold_note, odd_note, stated_hold, with_hold


class Seen:
    """The base fit and the pieces, false readings masked as fits make them visible."""

    def __init__(self, base: Fit, pieces: tuple[Piece, ...], prior: NoisePrior) -> None:
        self.base, self.pieces, self.prior = base, pieces, prior
        self.warnings: dict[str, str] = {}
        self.notes: list[str] = []
        self.odd: Rereading | None = None
        self.loose = False  # every recording has a gain of its own
        self.tied: Seen | None = None  # what was before that
        self.shown = False  # the end of the sensor's range is a reading
        self._rows: dict[str, NDArray[np.bool_]] = {}

    def copy(self) -> Seen:
        """The same, to try another reading on."""
        out = Seen(self.base, self.pieces, self.prior)
        out.warnings, out.notes, out.odd = dict(self.warnings), list(self.notes), self.odd
        out.loose, out.shown, out._rows = self.loose, self.shown, dict(self._rows)
        return out

    def take(self, r: Rereading) -> None:
        """Go on with another reading of the campaign."""
        if r.hold:
            self.notes.append(hold_note(r.hold, stated_hold(self.pieces)))
            self.pieces = tuple(with_hold(p, r.hold) for p in self.pieces)
        elif r.gains:
            moved = own_gains(self.base, self.pieces, self.prior)
            if moved is not None:
                self.tied = self.tied or self.copy()
                self.base, self.pieces, self.loose = moved, apart(self.pieces), True
            return
        elif r.limit:
            self.notes.append(limit_note())
            self.pieces, self.shown = as_shown(r.base, self.pieces), True
        else:
            self.odd = r
            self.notes.append(odd_note(r))
            self.pieces = tuple(p for p in self.pieces if p.name != r.odd)
        by_name = {p.name: p for p in self.pieces}
        used = tuple(by_name[p.name] for p in self.base.problem.pieces if p.name in by_name)
        plain = self.base.problem.model
        moved = replace(self.base, problem=replace(self.base.problem, pieces=used))
        if r.base.problem.model.name == plain.name:
            moved = replace(r.base, problem=replace(r.base.problem, pieces=used))
        self.base = refit(moved.problem, moved.q, moved.noise, self.prior) or moved

    def keep_below(self, limit: Limit) -> None:
        """Leave out the rows whose expected reading the end of the sensor's range reaches."""
        for _ in range(2):
            masked = {p.name: p for p in below([p for p in self.pieces if p.identify], limit, self.base)}
            self.pieces = tuple(masked.get(p.name, p) for p in self.pieces)
            problem = replace(self.base.problem, pieces=tuple(masked[p.name] for p in self.base.problem.pieces))
            self.base = refit(problem, self.base.q, self.base.noise, self.prior) or self.base

    def spoiled(self, fit: Fit, identify: bool = True) -> bool:
        """Whether a fit shows false readings; they are masked then."""
        rows = false_readings(fit, [p for p in self.pieces if p.identify == identify])
        if not rows:
            return False
        self.pieces = without(self.pieces, rows)
        for name, found in rows.items():
            self._rows[name] = self._rows.get(name, np.zeros_like(found)) | found
        by_name = {p.name: p for p in self.pieces}
        # a recording that was put aside as odd is not looked at any more
        self.warnings = {n: false_reading_warning(by_name[n], r) for n, r in self._rows.items() if n in by_name}
        used = tuple(by_name[p.name] for p in self.base.problem.pieces)
        self.base = replace(self.base, problem=replace(self.base.problem, pieces=used))
        return True

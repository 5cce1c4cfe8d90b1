"""Fits of the base to a part of the recordings that what was left out hardly touches.

Slow: what is slow in the recordings.

A model without the effect often bends a fast branch to imitate it (a resistance becomes a mode of four milliseconds),
and from there no search for the effect finds the way back. Fitted to plateaus and slow waves alone, the base keeps to
what it is meant for; hypotheses are tried from there as well.

Low: what lies in the lower half of the range. A limit of the sensor or of the supply cuts the upper half off, and a
model fitted to that is bent beyond what a search by slopes straightens again.

Driven: what was driven by a voltage. A press goes through five times the strain that a voltage does: a law that
stiffens with strain, which the voltage recordings hardly show, is millions of nats there, and drives all else away.

Sized: all of it, read as the sensor's statement has it. Where a law is curved enough, another size of all readings
stands in for what was left out: a gain of a fifth, at fourteen standard deviations, makes five times the strain of the
same readings, which a free law then bends as it has to.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece, subset
from ...gauss_newton.refit import Fit, refit
from ..where.features import Features

#: kept: blocks later than this after an edge (s), and waves up to this frequency (Hz)
_SETTLED_S, _SLOW_HZ = 0.15, 0.5
#: blocks of a recording below which a part of it says next to nothing
_FEW = 12
#: a start is worth its cost where the base's own fit on the slow blocks is worse by this many nats
_WORTH = 5.0
#: the same where another law of the material may have driven it off in the recordings of forces
_DRIVEN_OFF = 300.0
#: standard deviations of a gain beyond which it stands in for something, and the part of them that is left to it then
_TOO_FAR, _KEPT = 5.0, 0.1

#: effects that are tried from the low part as well
LIMITS = ("supply_saturation", "sensor_clipping")


def low_start(base: Fit, prior: NoisePrior, starts: list[np.ndarray]) -> Fit | None:
    """The base refitted to the lower half of the displacements, its sensitivities on all blocks; None where no better.

    starts: coordinates (d,) to begin from besides the base's own.
    """
    y = [p.y for p in base.problem.pieces if p.channel == "displacement"]
    if not y:
        return None
    middle = 0.5 * (min(float(v.min()) for v in y) + max(float(v.max()) for v in y))
    pieces = []
    for piece in base.problem.pieces:
        keep = piece.y < middle if piece.channel == "displacement" else np.ones(piece.y.size, dtype=bool)
        if keep.sum() >= _FEW:
            pieces.append(subset(piece, keep))
    return _partial(base, pieces, prior, starts)


def slow_start(base: Fit, looks: list[Features], prior: NoisePrior, starts: list[np.ndarray]) -> Fit | None:
    """The base refitted to slow blocks, its sensitivities on all blocks; None where that is no other fit.

    starts: coordinates (d,) to begin from besides the base's own.
    """
    pieces = []
    for piece, f in zip(base.problem.pieces, looks, strict=True):
        settled = ~(f.since_edge_s < _SETTLED_S)
        if f.frequency_Hz > _SLOW_HZ:
            settled &= ~np.isfinite(f.phase)
        if settled.sum() >= _FEW:
            pieces.append(subset(piece, settled))
    return _partial(base, pieces, prior, starts)


def driven_start(base: Fit, prior: NoisePrior, starts: list[np.ndarray]) -> Fit | None:
    """The base refitted to what a voltage drove, its sensitivities on all blocks; None where that is no other fit.

    None also without recordings of both kinds. starts: coordinates (d,) to begin from besides the base's own.
    """
    pieces = [p for p in base.problem.pieces if p.channel == "displacement"]
    if not 0 < len(pieces) < len(base.problem.pieces):
        return None
    return _partial(base, pieces, prior, starts, _DRIVEN_OFF)


def sized_start(base: Fit, prior: NoisePrior, starts: list[np.ndarray]) -> Fit | None:
    """The base refitted with gains that keep to what the sensor states; None where they do so anyway, or without a fit.

    starts: coordinates (d,) to begin from besides the base's own.
    """
    sd = base.problem.gain_sd
    if not np.any(np.abs(base.q[base.q.size - sd.size :]) > _TOO_FAR * sd):
        return None
    problem = replace(base.problem, gain_sd=_KEPT * sd)
    fits = []
    for q in (base.q, *starts):
        stated = q.copy()
        stated[q.size - sd.size :] = 0.0
        fits.append(refit(problem, stated, prior.start(), prior))
    return _on_all(base, min((f for f in fits if f is not None), key=lambda f: f.objective, default=None))


def _on_all(base: Fit, fit: Fit | None) -> Fit | None:
    """The base where another fit of it is; None where it has no answer there."""
    if fit is None:
        return None
    whole, _, clean, slopes = base.problem.gram(fit.q, base.noise)
    if not np.isfinite(whole).all():
        return None  # a law that locks within what it was not fitted to has no answer there
    return replace(base, q=fit.q, clean=clean, slopes=slopes)


def _partial(
    base: Fit, pieces: list[Piece], prior: NoisePrior, starts: list[np.ndarray], worth: float = _WORTH
) -> Fit | None:
    if not pieces:
        return None
    problem = replace(base.problem, pieces=tuple(pieces))
    found = [refit(problem, q, base.noise, prior, fit_noise=False) for q in (base.q, *starts)]
    fits = [fit for fit in found if fit is not None]
    if not fits:
        return None
    best = min(fits, key=lambda f: f.objective)
    gram, logdet, _, _ = problem.gram(base.q, base.noise, with_jacobian=False)
    here = (
        -float(base.problem.log_prior(base.q)[0]) + 0.5 * float(gram[0, 0]) + 0.5 * logdet + prior.minus_log(base.noise)
    )
    return None if here - best.objective < worth else _on_all(base, best)

"""Recordings that begin under voltage and are taken to begin at rest, while the actuator was under way.

What relaxes from before is a sum of the modes of the model, exp(-t / tau) from the first row on, each of a size of its
own in each recording. As columns that a recording adds linearly they are integrated out; where that explains far more
than anything that was left out, the recordings are what is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece, with_nuisance
from ...gauss_newton.refit import Fit, refit
from ...likelihood.prepare import begins_under_voltage
from ...models.missing_drive import drive_values
from ..where.locate import is_adequate

Array = NDArray[np.float64]

#: sd of what a mode still holds, as a share of the span of the readings, and nats it has to bring
_SHARE, _CLEAR = 0.3, 20.0
#: of the draws that say what noise alone leaves
_SEED = 1


@dataclass(frozen=True)
class UnderWay:
    """Recordings that did not begin at rest, and the nats of evidence that this brings."""

    recordings: tuple[str, ...]
    nats: float

    def note(self) -> str:
        """One line on them."""
        return (
            f"{', '.join(self.recordings)} begin under voltage and were taken to begin at rest; that the actuator was "
            f"under way explains more than anything on the list ({self.nats:.3g} nats of evidence): let a recording "
            "begin with the actuator at rest at 0 V, or put the one before it above and say rested = false"
        )


def under_way(base: Fit, prior: NoisePrior, beyond: float) -> UnderWay | None:
    """Recordings of the fit of a model without anything left out that were under way, where that leads `beyond`, the
    log evidence of what explains best; else None."""
    problem = base.problem
    names = tuple(p.name for p in problem.pieces if _may_be(p))
    if not names or not any(k.startswith("tau_") for k in base.values()):
        return None
    fit = base
    for _ in range(2):  # once more with the time constants that the first fit ends at
        taus = tuple(v for k, v in fit.values().items() if k.startswith("tau_"))
        pieces = tuple(with_start(p, taus) if p.name in names else p for p in problem.pieces)
        again = refit(replace(problem, pieces=pieces), fit.q, prior.start(), prior)
        if again is None:
            return None
        fit = again
    nats = fit.log_evidence - beyond
    # what drifts or wanders would be taken up by these columns, too, but not where a recording began at rest
    if nats <= _CLEAR * len(names) or not is_adequate(fit, np.random.default_rng(_SEED)):
        return None
    return UnderWay(names, nats)


def _may_be(piece: Piece) -> bool:
    r = piece.recording
    return r.is_voltage and r.rested and begins_under_voltage(drive_values(r))


def with_start(piece: Piece, taus: tuple[float, ...]) -> Piece:
    """A piece to which what relaxes with these time constants (s) from its first row is added, of any size."""
    t = piece.recording.time_s - piece.recording.time_s[0]
    sd = np.full(len(taus), _SHARE * float(np.ptp(piece.y)))
    return with_nuisance(piece, np.exp(-t / np.asarray(taus)[:, None]), sd)

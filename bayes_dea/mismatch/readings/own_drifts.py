"""A drift of each recording's own: a zero that creeps by another rate each time, as real sensors' zeros do.

`sensor_drift` has one rate in all recordings. Rates that differ are no physics of the actuator; as a column that a
recording adds linearly, (t - t_0) / duration, each is integrated out within what the sensor's stated accuracy allows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece, with_nuisance
from ...gauss_newton.refit import Fit, refit
from ...gauss_newton.whitening import whiten
from ..where.locate import is_adequate

#: nats that it has to bring, and what a zero creeps by (m, one sd) where the sensor's accuracy is not stated
_CLEAR, _UNSTATED_M = 20.0, 2e-5
#: of the draws that say what noise alone leaves
_SEED = 1


@dataclass(frozen=True)
class OwnDrifts:
    """What each recording's zero drifts by until its end (m), and the nats of evidence that this brings."""

    drift_m: dict[str, float]
    nats: float
    beside: str

    def note(self) -> str:
        """One line on them."""
        low, high = (f(self.drift_m, key=lambda n: self.drift_m[n]) for f in (min, max))
        what = "nothing is left" if self.beside == "none" else f"nothing is left beside {self.beside}"
        return (
            f"with a drift of the sensor's zero that each recording has for itself {what} (from "
            f"{1e6 * self.drift_m[low]:.2g} um in {low} to {1e6 * self.drift_m[high]:.2g} um in {high} at its end; "
            f"{self.nats:.3g} nats of evidence): let the sensor warm up, and record a stretch at 0 V before and after"
        )


def own_drifts(explanation: Fit, beside: str, prior: NoisePrior, beyond: float) -> OwnDrifts | None:
    """Drifts of recordings beside the best explanation, where they leave nothing and lead `beyond`, the log evidence of
    what explains best without them; else None."""
    problem = explanation.problem
    names = [p.name for p in problem.pieces if p.channel == "displacement"]
    if len(names) < 2:
        return None
    pieces = tuple(with_drift(p) if p.channel == "displacement" else p for p in problem.pieces)
    fit = refit(replace(problem, pieces=pieces), explanation.q, prior.start(), prior)
    if fit is None:
        return None
    nats = fit.log_evidence - beyond
    if nats <= _CLEAR or not is_adequate(fit, np.random.default_rng(_SEED)):
        return None
    return OwnDrifts({n: _drift_of(fit, i) for i, n in enumerate(p.name for p in pieces) if n in names}, nats, beside)


def with_drift(piece: Piece) -> Piece:
    """A piece whose zero creeps at a rate of its own."""
    t = piece.recording.time_s - piece.recording.time_s[0]
    accuracy = piece.prepared.sensor.accuracy
    sd = _UNSTATED_M if accuracy is None else accuracy / np.sqrt(3.0)
    return with_nuisance(piece, (t / t[-1])[None], np.array([sd]))


def _drift_of(fit: Fit, i: int) -> float:
    """Posterior mean of the last column of piece i, given the fit."""
    piece = fit.problem.pieces[i]
    left = fit.problem.columns(i, fit.q, fit.clean, [])
    return float(whiten(piece, left[:1], fit.noise).coupling[-1, 0])

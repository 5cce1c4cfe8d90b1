"""A gain of its own for every recording: a sensor that was moved, or set anew, from one recording to the next.

A sensor has one gain, and recordings that differ in size alone contradict every explanation then. Its stated accuracy
leaves room for a gain of each recording, though, and what is to be mended is the sensor's mount, no physics of the
actuator. It is weighed as another reading of the campaign is: by its evidence, with a gain and its prior a recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, extrapolated, refit
from ..search.once import Once
from ..search.weigh import excess

Array = NDArray[np.float64]

#: prior probability that a sensor was moved or set anew between recordings
MOVED = 0.01
#: share by which the displacement of another actuator differs, at least
DIFFERENT = 0.02
#: with fewer recordings a gain of each says nothing that an effect could not
_LEAST = 4
#: share of what an explanation leaves beyond noise that gains have to take away for a search to begin anew with them
_MUCH = 0.5
#: share of it that one step has to promise for a refit to be made: of a dozen none took more than 1.14 of what it had
#: promised
_PROMISED = 0.3


@dataclass(frozen=True)
class Gains:
    """What each recording reads over the mean of all, and its standard error, of a sensor that allows +-limit."""

    ratio: dict[str, float]
    se: dict[str, float]
    limit: float

    @property
    def widest(self) -> tuple[str, str]:
        """Recordings with the smallest and the largest."""
        return min(self.ratio, key=lambda n: self.ratio[n]), max(self.ratio, key=lambda n: self.ratio[n])

    @property
    def sigmas(self) -> float:
        """How many standard errors of the difference lie between those two."""
        a, b = self.widest
        return (self.ratio[b] - self.ratio[a]) / max(math.hypot(self.se[a], self.se[b]), 1e-12)

    @property
    def allowed(self) -> bool:
        """Whether the stated accuracy of the sensor allows them."""
        a, b = self.widest
        return 0.5 * (self.ratio[b] - self.ratio[a]) <= self.limit

    @property
    def may_be_moved(self) -> bool:
        """Whether a sensor that was moved has them: its accuracy allows that, and no actuator differs so little."""
        return self.allowed and max(abs(r - 1.0) for r in self.ratio.values()) < DIFFERENT

    def note(self) -> str:
        """One line on them."""
        a, b = self.widest
        allowed = "within" if self.allowed else "beyond"
        return (
            f"the sensor's gain differs from recording to recording: {a} reads {self._of(a)} and {b} {self._of(b)} "
            f"times what all lead to expect, {allowed} its stated accuracy (+-{100 * self.limit:.2g} %); no physics "
            "brings them together, a gain of each does. Check what was moved or set anew in between, and give each "
            "recording a specimen of its own, so that calibrate allows for that"
        )

    def _of(self, name: str) -> str:
        return f"{self.ratio[name]:.3f} +- {max(self.se[name], 5e-4):.3f}"

    def repair(self, partial: str) -> dict[str, Any]:
        """The "repair" of diagnosis.json (see `unknown.repair`) where the stated accuracy does not allow them."""
        terms = [
            {"term": f"gain of {n}", "mean": r - 1.0, "sd": self.se[n], "unit": "1", "inclusion_probability": 1.0}
            for n, r in self.ratio.items()
        ]
        return {
            "stage": "sensor",
            "acts_on": "the size of each recording",
            "form": "(1 + gain of the recording) x displacement",
            "terms": terms,
            "partial": partial,
        }


def apart(pieces: Sequence[Piece]) -> tuple[Piece, ...]:
    """All recordings of a campaign, each with a gain of its own: its index here."""
    return tuple(replace(p, group=i) for i, p in enumerate(pieces))


def _loosened(problem: Problem, pieces: Sequence[Piece]) -> Problem:
    """A problem with a gain for each of `pieces`, all of the campaign's."""
    index = {p.name: i for i, p in enumerate(pieces)}
    sd = np.array([problem.gain_sd[p.group] for p in pieces])
    return replace(problem, pieces=tuple(replace(p, group=index[p.name]) for p in problem.pieces), gain_sd=sd)


def own_gains(fit: Fit, pieces: Sequence[Piece], prior: NoisePrior) -> Fit | None:
    """A fit again with a gain for each of `pieces`, all of the campaign's, seen or not.

    None where it has that already, or where there are too few recordings to tell; of a sensor that is coarser than its
    noise plateaus are off by parts of a step, which is no gain.
    """
    start = _begun(fit, pieces)
    if start is None:
        return None
    problem, q = start
    return refit(problem, q, fit.noise, prior, known=replace(fit.linearisation, q=q))


def may_take_much(fit: Fit, pieces: Sequence[Piece], prior: NoisePrior) -> bool:
    """Whether a gain of each recording may take much of what a fit leaves (`worth_a_search`), or all of it.

    By one step from where it stands, which costs no simulation: gains are linear, and what moves along with them falls
    short of what it promises rather than beyond it.
    """
    start = _begun(fit, pieces)
    if start is None:
        return False
    problem, q = start
    _, promised = extrapolated(problem, replace(fit, q=q, noise=prior.start()), prior)
    return promised > _PROMISED * excess(fit, prior)


def _begun(fit: Fit, pieces: Sequence[Piece]) -> tuple[Problem, Array] | None:
    """A problem with a gain for each recording, and a fit's coordinates in it; None where `own_gains` has none."""
    problem = fit.problem
    if any(p.rounding for p in pieces):
        return None
    if problem.gain_sd.size >= len(pieces) or sum(p.channel == "displacement" for p in problem.pieces) < _LEAST:
        return None
    shared = fit.q[problem.dimension - problem.gain_sd.size :]
    q = np.concatenate([fit.q[: fit.q.size - shared.size], shared[[p.group for p in pieces]]])
    return _loosened(problem, pieces), q


class Loosened:
    """Fits with a gain of each recording, worked out once for each fit and the recordings as they are read."""

    def __init__(self, prior: NoisePrior) -> None:
        self.prior = prior
        self._known: Once[Fit | None] = Once()
        self._may: Once[bool] = Once()

    def __call__(self, fit: Fit, pieces: Sequence[Piece]) -> Fit | None:
        """See `own_gains`."""
        return self._known((fit, pieces), lambda: own_gains(fit, pieces, self.prior))

    def where_worth(self, fit: Fit, pieces: Sequence[Piece]) -> Fit | None:
        """The same where gains may take much of what a fit leaves."""
        return self(fit, pieces) if self._may((fit, pieces), lambda: may_take_much(fit, pieces, self.prior)) else None


def nats_of_gains(before: Fit, after: Fit) -> float:
    """Nats of evidence that a gain of each recording brings a fit, the odds of a sensor that was moved included."""
    return after.log_evidence + math.log(MOVED) - before.log_evidence


def worth_a_search(before: Fit, after: Fit, prior: NoisePrior, adequate: Callable[[Fit], bool]) -> bool:
    """Whether gains take so much of what an explanation leaves that effects are to be sought beside them.

    adequate: whether a fit leaves nothing to be seen; what noise has beyond its stated level is an excess, too.
    """
    if nats_of_gains(before, after) <= 0.0:
        return False
    return excess(after, prior) < (1.0 - _MUCH) * excess(before, prior) or adequate(after)


def gains_of(fit: Fit) -> Gains:
    """The gains of displacements over their mean, of a fit in which every recording has its own."""
    problem = fit.problem
    used = [p for p in problem.pieces if p.channel == "displacement"]
    at = np.array([problem.dimension - problem.gain_sd.size + p.group for p in used])
    # what all have in common trades with the stiffness, and is no difference between recordings
    centre = np.eye(len(used)) - 1.0 / len(used)
    log_ratio = centre @ fit.q[at]
    variance = np.diag(centre @ fit.covariance[np.ix_(at, at)] @ centre)
    return Gains(
        {p.name: float(math.exp(x)) for p, x in zip(used, log_ratio, strict=True)},
        {p.name: math.sqrt(max(float(v), 0.0)) for p, v in zip(used, variance, strict=True)},
        math.sqrt(3.0) * float(max(problem.gain_sd[p.group] for p in used)),
    )

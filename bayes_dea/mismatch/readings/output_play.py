"""A play between the actuator and what reads it: a loose clevis, a target that tilts; physics of no actuator, and on no
list of effects.

What is read follows the displacement only once a gap is taken up, so that it stays behind at every turn, at any rate:
friction that yields at once does the same to what answers at once. But friction holds the actuator itself back, whose
branches relax under what they carry meanwhile, and a play does not. Where it is likelier than what was named, the
verdict is "unknown", with the play said; where by little, or nearly as likely, recordings cannot tell one from the
other.
Equation: the play operator y_k = min(x_k + w/2, max(x_k - w/2, y_(k-1))) (Visintin, Differential Models of Hysteresis,
1994, III.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ..left_out import Repaired
from ..search.hypotheses import UNKNOWN
from ..search.naming import Naming
from ..search.weigh import Weighed
from .one_number import Climb, Sized
from .unlisted import CLEAR, Claimed, Unlisted, clearest

_FRICTION = "rate_independent_hysteresis"
#: ends (m) of the log-uniform prior: below what displacement sensors resolve, and what nobody would overlook
_LEAST_M, _MOST_M = 0.1e-6, 100e-6
#: where is looked first
_FIRST_M = 0.5e-6
#: nats by which it may be behind and be a rival yet
_RIVAL = 5.0
#: where in the play the recordings begin: in its middle, or where the way down from before has left it
BEGINNINGS = (0.0, 1.0)


@dataclass(frozen=True)
class OutputPlay(Unlisted):
    """A play; mean and sd in m."""

    stage, acts_on, term, unit = "sensor", "direction", "play of the output", "m"

    def note(self) -> str:
        """One line on it."""
        how = "better than any effect on the list" if self.clear else f"about as well as {_FRICTION}"
        return (
            f"a play (backlash) of {1e6 * self.mean:.3g} +- {1e6 * max(self.sd, 5e-9):.1g} um between the actuator and "
            f"what the sensor reads {self._explains} {how}: look for a loose joint, clamp or target of the sensor, "
            "preload it and record a slow wave again"
        )

    def form(self) -> str:
        """What it does, in words."""
        return f"a play of {1e6 * self.mean:.3g} um"


def output_play(naming: Naming, named: str, prior: NoisePrior) -> Unlisted | None:
    """A play of the output that is likelier than what is named (physics of a verdict), or nearly; else None.

    Looked for in the place of friction, and where nothing on the list explains the recordings.
    """
    claimed = Claimed.of(naming, named)
    if claimed is None or not (_FRICTION in claimed.effects or named == UNKNOWN):
        return None
    # the best partial explanation may do no more than some of its work
    replaced = [[_FRICTION], *([claimed.effects] if named == UNKNOWN else [])]
    rests = {w.name: w for w in (claimed.without(r, prior) for r in replaced) if w is not None}
    return clearest(found for rest in rests.values() for found in _beside(claimed, rest, prior, named))


def _beside(claimed: Claimed, rest: Weighed, prior: NoisePrior, named: str) -> Iterator[OutputPlay]:
    """A play beside what stays of a claim, where it is likelier than what is named, or nearly."""
    cost = claimed.cost(rest)
    for at in plays_of(rest.fit, prior, (CLEAR if named == UNKNOWN else -_RIVAL) - cost):
        yield OutputPlay(at.mean, at.sd, at.log_evidence + cost, at.log_evidence, rest.name, at.repaired)


def plays_of(fit: Fit, prior: NoisePrior, beyond: float) -> Iterator[Sized]:
    """A play (m) beside a fit from each of the places in it where recordings may begin, where the log evidence with it,
    that place being one of these, lies beyond so many nats."""
    among = math.log(len(BEGINNINGS))
    before: Climb | None = None
    for start in BEGINNINGS:
        climb = Climb(fit, prior, partial(_loosened, start=start), _FIRST_M, _MOST_M)
        if before is None or before.top == 0.0:
            climb.go_up()
        elif not climb.keeps_up_with(before):
            continue
        at = _sized(climb, start, beyond + among)
        if at is not None:
            yield replace(at, log_evidence=at.log_evidence - among)
        before = climb


def _loosened(problem: Problem, play_m: float, start: float) -> Problem:
    return replace(problem, pieces=tuple(with_play(p, play_m, start) for p in problem.pieces))


def _sized(climb: Climb, start: float, beyond: float) -> Sized | None:
    peak = climb.peak(beyond)
    if peak is None or peak.at < _LEAST_M:
        return None
    # integrated out, with its prior
    density = 1.0 / (peak.at * math.log(_MOST_M / _LEAST_M))
    total = peak.height + math.log(math.sqrt(2.0 * math.pi) * peak.sd * density)
    if total <= beyond:
        return None
    return Sized(peak.at, peak.sd, total, Repaired(peak.fit, lambda piece: with_play(piece, peak.near, start)))


def with_play(piece: Piece, play_m: float, start: float = 0.0) -> Piece:
    """A piece whose sensor follows the displacement with a play (m); a mechanical one as it is."""
    return piece if piece.nodes is None or play_m == 0.0 else replace(piece, play=(play_m, start))

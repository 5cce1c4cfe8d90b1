"""A crosstalk of the high voltage into the reading of the sensor: what each change of the command adds to it for some
milliseconds; physics of no actuator, and on no list of effects.

A mode of the material that fast does nearly the same at an edge of a given height, but goes as the square of the
voltage. Where a further mode is claimed a crosstalk is weighed in its place, because a descent from one does not lead
to the other: with the mode gone, the modes of the base may have gone to do its work, and stay there. From the middle of
their priors they find back, if not always to where they were.
Equation: y = x + k w, w' = V' - w / tau of the command, a capacitive coupling into a high input (Ott, Electromagnetic
Compatibility Engineering, 2009, ch. 2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.descent import End, approach
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, refit
from ...gauss_newton.whitening import Shared
from ...models.supply_kernel import lagged
from ..left_out import Repaired
from ..search.hypotheses import UNKNOWN
from ..search.naming import Naming
from ..search.promising import typical
from ..search.weigh import Weighed, hopeless
from .one_number import Peak, parabola
from .shared_column import coefficient, in_column, left
from .unlisted import AFTER_AN_EDGE, CLEAR, OFF, Claimed, Unlisted, clearest

Array = NDArray[np.float64]
#: time constants (s) that are looked at; the prior is log-uniform from the first to the last
_TAUS_S = (1e-3, 2e-3, 4e-3, 8e-3, 16e-3, 32e-3, 64e-3)
#: sd (m) of what an edge of `_EDGE_V` adds
_SIZE_M, _EDGE_V = 10e-6, 1000.0
#: nats by which it may be behind and be a rival yet
_RIVAL = 5.0
#: nats that it has to promise beside what is known, where nothing on the list explains the recordings
_PROMISES = 20.0
#: nats behind the best, whatever the noise grows to, at which an approach to a time constant is no rival of it
_NO_RIVAL = 50.0
#: nats by which a time constant between two may be better, beside a share of all that it explains
_SLACK = 10.0
#: nats behind the best at which a neighbour says nothing of a peak
_FAR = 600.0


@dataclass(frozen=True)
class EdgeCrosstalk(Unlisted):
    """A crosstalk; mean and sd in m for each volt. tau_s: time constant (s)."""

    stage, acts_on, term, unit = "sensor", "edges of the command", "crosstalk of the command", "m/V"

    instead: str = ""  # of what, on the list
    tau_s: float = 0.0

    def note(self) -> str:
        """One line on it."""
        how = "better than any effect on the list" if self.clear else f"about as well as {self.instead}"
        return (
            f"a crosstalk of the high voltage into the sensor, {self._size()}, {self._explains} {how}: part the cables "
            "of supply and sensor, ground their screens, and record a step with the sensor on a target that is fixed"
        )

    def form(self) -> str:
        """What it does, in words."""
        return f"a crosstalk of {self._size()}"

    def _size(self) -> str:
        size, sd = (1e6 * _EDGE_V * x for x in (self.mean, max(self.sd, 5e-12)))
        return f"{size:.3g} +- {sd:.1g} um for each kV of an edge, gone after some {1e3 * self.tau_s:.2g} ms"


def edge_crosstalk(naming: Naming, named: str, prior: NoisePrior) -> Unlisted | None:
    """A crosstalk that is likelier than what is named (physics of a verdict), or nearly; else None.

    Looked for in the place of a further mode of the material, or of another memory; where nothing on the list explains
    the recordings, beside the best explanation as well.
    """
    claimed = Claimed.of(naming, named)
    if claimed is None:
        return None
    replaced: list[tuple[str, ...]] = [(e,) for e in claimed.effects if e in AFTER_AN_EDGE]
    if not replaced and named == UNKNOWN and _promise(claimed.weighed.fit) > _PROMISES:
        replaced = [()]
    least = CLEAR if named == UNKNOWN else -_RIVAL
    out = [
        _instead(claimed, rest, r, least, naming, prior)
        for r in replaced if (rest := claimed.without(r, prior)) is not None
    ]  # fmt: skip
    return clearest(o for o in out if o is not None and o.lead > least)


def _instead(
    claimed: Claimed, rest: Weighed, replaced: tuple[str, ...], least: float, naming: Naming, prior: NoisePrior
) -> EdgeCrosstalk | None:
    """A crosstalk beside what stays of a claim; None where it surely does not lead by `least`."""
    base, above = naming.none.weighed.fit, claimed.out_of_reach(rest, prior)
    found = crosstalk_of(rest.fit, base, prior, above, least - claimed.cost(rest))
    if found is None:
        return None
    return EdgeCrosstalk(
        found.mean_m / _EDGE_V, found.sd_m / _EDGE_V, found.log_evidence + claimed.cost(rest), found.log_evidence,
        rest.name, found.repaired, "+".join(replaced), found.tau_s,
    )  # fmt: skip


@dataclass(frozen=True)
class Found:
    """Log evidence of a crosstalk beside a fit, what an edge of `_EDGE_V` adds (m) with its sd, the time constant, and
    the fit with it."""

    log_evidence: float
    mean_m: float
    sd_m: float
    tau_s: float
    repaired: Repaired


def crosstalk_of(
    fit: Fit, base: Fit, prior: NoisePrior, above: float = math.inf, beyond: float = -math.inf
) -> Found | None:
    """A crosstalk beside a fit, its time constant integrated out; None where a first look stays above a value (see
    `Weighed`), or a closer one surely below a log evidence.

    base: what has the modes that are begun from the middle of their priors.
    """

    def beside(tau_s: float) -> Problem:
        return replace(fit.problem, shared=_shared(fit, tau_s), amplitude_m=_SIZE_M)

    starts = fit.q, typical(fit, base.problem.model)
    fits = _first_look({t: beside(t) for t in _TAUS_S[1::2]}, starts, prior, above)
    if not fits:
        return None

    def fitted(tau_s: float, start: Array) -> None:
        again = refit(beside(tau_s), start, prior.start(), prior)
        if again is not None:
            fits[tau_s] = again

    top = max(fits, key=lambda t: fits[t].log_evidence)
    at = _TAUS_S.index(top)
    for tau_s in _TAUS_S[max(0, at - 1) : at + 2]:
        if tau_s != top:
            fitted(tau_s, fits[top].q)
    highest = max(f.log_evidence for f in fits.values())
    if highest + OFF * max(highest - fit.log_evidence, 0.0) + _SLACK < beyond:
        return None
    for _ in range(2):
        top = max(fits, key=lambda t: fits[t].log_evidence)
        for tau_s in _about({t: f.log_evidence for t, f in fits.items()}):
            if tau_s not in fits:
                fitted(tau_s, fits[top].q)
    top = max(fits, key=lambda t: fits[t].log_evidence)
    peak = _peak({math.log(t): f.log_evidence for t, f in fits.items()})
    width = math.log(_TAUS_S[-1] / _TAUS_S[0])
    share = math.sqrt(2.0 * math.pi) * peak.sd / width if peak is not None else 1.0 / len(_TAUS_S)
    mean, sd = coefficient(fits[top])
    if peak is not None:
        # the size goes with the time constant
        near = min((t for t in fits if t != top), key=lambda t: abs(math.log(t / top)))
        slope = (coefficient(fits[near])[0] - mean) / math.log(near / top)
        sd = math.hypot(sd, slope * peak.sd)
    repaired = in_column(fits[top], lambda piece: crosstalk_column(piece, top))
    return Found(fits[top].log_evidence + math.log(min(share, 1.0)), mean, sd, top, repaired)


def _first_look(
    problems: Mapping[float, Problem], starts: Sequence[Array], prior: NoisePrior, above: float
) -> dict[float, Fit]:
    """Fits of problems by a number, each from the better of some starts; without those that surely are no rivals of the
    best one, and those of which an approach stays above a value (see `Weighed`)."""
    ends: dict[float, End] = {}
    for number, problem in problems.items():
        for start in starts:
            end = approach(problem, start, prior.start(), hopeless_above=above)
            if end is not None and end.value <= min(above, ends[number].value if number in ends else math.inf):
                ends[number] = end
    reached = min((e.value for e in ends.values()), default=math.inf)
    out = {}
    for number, end in ends.items():
        problem = problems[number]
        if end.value <= hopeless(reached, sum(p.blocks.n for p in problem.pieces), _NO_RIVAL):
            fit = refit(problem, end.q, prior.start(), prior)
            if fit is not None:
                out[number] = fit
    return out


def _about(height: dict[float, float]) -> list[float]:
    """Time constants (s) at the peak of a parabola in their logarithm, and one sd on either side, within the prior."""
    peak = _peak({math.log(t): h for t, h in height.items()})
    if peak is None:
        return []
    low, high = math.log(_TAUS_S[0]), math.log(_TAUS_S[-1])
    wanted = (peak.at, peak.at - peak.sd, peak.at + peak.sd)
    return [round(math.exp(min(max(x, low), high)), 6) for x in wanted]


def _peak(height: dict[float, float]) -> Peak | None:
    """The peak through the three places about the highest; None where it has no peak there."""
    top = max(height, key=lambda x: height[x])
    near = sorted(sorted(height, key=lambda x: abs(x - top))[:3])
    if len(near) < 3 or min(height[x] for x in near) < height[top] - _FAR:
        return None
    # from the top, so that the last digits of an evidence count
    peak = parabola([x - top for x in near], [height[x] - height[top] for x in near])
    return None if peak is None else replace(peak, at=top + peak.at)


def _shared(fit: Fit, *taus_s: float) -> Shared:
    return Shared([np.stack([crosstalk_column(p, t) for t in taus_s]) for p in fit.problem.pieces])


def crosstalk_column(piece: Piece, tau_s: float) -> Array:
    """What an edge of `_EDGE_V` adds to the block means (nb,) of a recording, over its size."""
    nodes = piece.nodes
    if nodes is None:
        return np.zeros(piece.blocks.n)
    h, volts, kept = nodes.durations(), nodes.volts, np.empty(nodes.size)
    lagged(h, nodes.rows(), volts, tau_s, kept)
    return np.asarray(piece.averaging @ ((volts - kept) / _EDGE_V))


def _promise(fit: Fit) -> float:
    """Nats that it promises beside a fit, whose parameters move along linearly; of the time constants the best."""
    own, beside = left(fit, _shared(fit, *_TAUS_S))
    told = np.isfinite(own)
    return float(np.max(0.5 * beside[told] ** 2 / (own[told] + 1.0 / _SIZE_M**2), initial=0.0))

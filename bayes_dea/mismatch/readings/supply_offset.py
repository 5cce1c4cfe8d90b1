"""A supply that adds a constant to every command: physics of no actuator, and on no list of effects.

(V + V_0)^2 adds 2 V V_0 to what drives the actuator, which goes with the root of the displacement; leaks, softening and
permittivities that change imitate it, with parameters that no film has. Where V_0 explains the recordings clearly
better than what was named, the verdict is "unknown", with V_0 said. A negative one is a dead zone, which has a name.
Source: catalogue of missing physics, E6 (V_0 within 5 V, one standard deviation here).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit, refit
from ...likelihood.plant_group import Reading
from ...models.nodes import Nodes
from ..search.hypotheses import NONE, UNKNOWN, prior_odds
from ..search.naming import Naming

#: sd (V) of the prior of an offset, the largest that is looked for, and where is looked first
_SD_V, _LARGEST_V, _FIRST_V = 5.0, 30.0, 1.0
#: prior probability of one worth a word, and nats by which it has to lead
_PRIOR, _CLEAR = 0.01, 3.0
#: nats that a parabola through three places may be off by
_SLACK = 10.0
#: effects that do to the size of an answer, level by level, what an offset may do
_ALIKE = frozenset({
    "supply_dead_zone", "leakage", "charge_retention", "thickness_feedback", "stretch_dependent_permittivity",
    "dielectric_absorption", "strain_stiffening", "amplitude_softening", "rate_independent_hysteresis",
    "mullins_softening", "sensor_nonlinearity",
})  # fmt: skip


@dataclass(frozen=True)
class SupplyOffset:
    """Volts that are added to every command, their standard deviation, nats by which they lead what was named, prior
    odds in, and the log evidence."""

    volts: float
    sd: float
    lead: float
    log_evidence: float
    beside: str  # what else is in the model

    def note(self) -> str:
        """One line on it."""
        what = "the recordings" if self.beside == NONE else f"beside {self.beside} the recordings"
        return (
            f"an offset of the supply of {self.volts:.2g} +- {max(self.sd, 0.05):.1g} V explains {what} better than "
            "any effect on the list: measure the supply's output at a command of 0 V and at half of the range, and "
            "correct the command or record measured_voltage_V"
        )

    def repair(self, partial: str) -> dict[str, Any]:
        """The "repair" of diagnosis.json (see `unknown.repair`)."""
        term = {"term": "offset of the supply", "mean": self.volts, "sd": self.sd, "unit": "V",
                "inclusion_probability": 1.0 / (1.0 + math.exp(-min(self.lead, 500.0)))}  # fmt: skip
        return {"stage": "electrical", "acts_on": "the command",
                "form": f"command + {self.volts:.2g} V", "terms": [term], "partial": partial}  # fmt: skip


def supply_offset(naming: Naming, named: str, prior: NoisePrior) -> SupplyOffset | None:
    """An offset of the supply that is clearly likelier than what is named (physics of a verdict); else None."""
    best = naming.best.weighed
    if named == NONE or not any(p.nodes is not None for p in best.fit.problem.pieces):
        return None
    if named not in naming.log_evidence or (named != UNKNOWN and named not in naming.weighed):
        return None
    effects = best.effects if named == UNKNOWN else naming.weighed[named].effects
    odds, singles = prior_odds(), sum("+" not in n for n in naming.weighed)

    against = naming.log_evidence[named] + math.log(
        odds.unknown if named == UNKNOWN else odds.of(len(effects), singles)
    )
    rests = {tuple(e for e in effects if e != left) for left in effects if left in _ALIKE}
    if named == UNKNOWN:
        rests |= {(), effects}
    found = []
    for rest in sorted(rests, key=len):
        known = naming.none.weighed if not rest else naming.weighed.get("+".join(rest))
        if known is None:
            continue
        cost = math.log(odds.of(len(rest), singles) * _PRIOR)
        at = offset_of(known.fit, prior, against + _CLEAR - cost)
        if at is not None:
            found.append(SupplyOffset(at[0], at[1], at[2] + cost - against, at[2], "+".join(rest) or NONE))
    return max(found, key=lambda o: o.lead, default=None)


def offset_of(fit: Fit, prior: NoisePrior, beyond: float) -> tuple[float, float, float] | None:
    """V_0 (V) beside a fit, its sd, and the log evidence with it, where this may lie beyond so many nats; else None."""
    known = {0.0: fit.log_evidence}
    fits = {0.0: fit}

    def at(volts: float) -> float:
        if volts not in known:
            near = fits[min(fits, key=lambda v: abs(v - volts))]
            pieces = tuple(with_offset(p, volts) for p in fit.problem.pieces)
            again = refit(replace(fit.problem, pieces=pieces), near.q, near.noise, prior)
            known[volts] = -math.inf if again is None else again.log_evidence
            if again is not None:
                fits[volts] = again
        return known[volts]

    if not at(_FIRST_V) > known[0.0]:
        return None  # none, or one below zero, which has a name
    step = _FIRST_V
    while step < _LARGEST_V and at(min(2.0 * step, _LARGEST_V)) > at(step):
        step = min(2.0 * step, _LARGEST_V)
    top = max(known, key=lambda v: known[v])
    for _ in range(2):
        order = sorted(known)
        k = min(max(order.index(top), 1), len(order) - 2)
        bend = _parabola(order[k - 1 : k + 2], [known[v] for v in order[k - 1 : k + 2]])
        if bend is None:
            return None
        middle, sd, height = bend
        middle = min(max(middle, 0.0), _LARGEST_V)
        if height < beyond - _SLACK:
            return None
        for volts in (middle, middle - 2.0 * sd, middle + 2.0 * sd):
            at(round(max(volts, 0.0), 4))
        top = max(known, key=lambda v: known[v])
    near = sorted(known, key=lambda v: abs(v - top))[:3]
    bend = _parabola(sorted(near), [known[v] for v in sorted(near)])
    if bend is None:
        return None
    middle, sd, height = bend
    # the offset integrated out, with its prior
    precision = 1.0 / sd**2 + 1.0 / _SD_V**2
    mean = middle / sd**2 / precision
    total = height - 0.5 * middle**2 / (sd**2 + _SD_V**2) - 0.5 * math.log(precision * _SD_V**2)
    return (mean, precision**-0.5, total) if total > beyond else None


def _parabola(at: Sequence[float], height: Sequence[float]) -> tuple[float, float, float] | None:
    """Where a parabola through three places is highest, the sd of a Gaussian of its curvature, its height; None where
    it opens upwards."""
    if not np.isfinite(height).all():
        return None
    a, b, c = np.polyfit(np.asarray(at), np.asarray(height), 2)
    if a >= 0.0:
        return None
    return float(-0.5 * b / a), float(math.sqrt(-0.5 / a)), float(c - 0.25 * b * b / a)


def with_offset(piece: Piece, volts: float) -> Piece:
    """A piece whose commands are so many volts larger; a mechanical one as it is."""
    if piece.nodes is None:
        return piece
    return replace(
        piece, nodes=_raised(piece.nodes, volts), few=_reading(piece.few, volts), rough=_reading(piece.rough, volts),
        past=None if piece.past is None else _raised(piece.past, volts),
    )  # fmt: skip


def _reading(reading: Reading | None, volts: float) -> Reading | None:
    if reading is None:
        return None
    assert isinstance(reading.where, Nodes)
    return replace(reading, where=_raised(reading.where, volts))


def _raised(nodes: Nodes, volts: float) -> Nodes:
    lines = None if nodes.lines_V is None else nodes.lines_V + volts
    return replace(nodes, volts=nodes.volts + volts, lines_V=lines)

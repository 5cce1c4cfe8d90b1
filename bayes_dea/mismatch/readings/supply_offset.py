"""A supply that adds a constant to every command: physics of no actuator, and on no list of effects.

(V + V_0)^2 adds 2 V V_0 to what drives the actuator, which goes with the root of the displacement; leaks, softening and
permittivities that change imitate it, with parameters that no film has. Where V_0 explains the recordings clearly
better than what was named, the verdict is "unknown", with V_0 said. A negative one is a dead zone, which has a name.
Source: catalogue of missing physics, E6 (V_0 within 5 V, one standard deviation here).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.problem import Problem
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ...gauss_newton.whitening import Shared
from ...likelihood.plant_group import Reading
from ...models.nodes import Nodes
from ..left_out import Repaired
from ..search.hypotheses import UNKNOWN
from ..search.naming import Naming
from .one_number import Climb, Sized
from .shared_column import left
from .unlisted import CLEAR, Claimed, Unlisted, clearest

#: sd (V) of the prior of an offset, the largest that is looked for, and where is looked first
_SD_V, _LARGEST_V, _FIRST_V = 5.0, 30.0, 1.0
#: how much more than one step promises an offset may bring, beside a fit that did its work with something else (nine
#: times beside a leak), and nats of slack
_FALLS_SHORT, _SLACK = 20.0, 10.0
#: effects that do to the size of an answer, level by level, what an offset may do
_ALIKE = frozenset({
    "supply_dead_zone", "leakage", "charge_retention", "thickness_feedback", "stretch_dependent_permittivity",
    "dielectric_absorption", "strain_stiffening", "amplitude_softening", "rate_independent_hysteresis",
    "mullins_softening", "sensor_nonlinearity",
})  # fmt: skip


@dataclass(frozen=True)
class SupplyOffset(Unlisted):
    """Volts that are added to every command."""

    stage, acts_on, term, unit = "electrical", "the command", "offset of the supply", "V"

    def note(self) -> str:
        """One line on it."""
        return (
            f"an offset of the supply of {self.mean:.2g} +- {max(self.sd, 0.05):.1g} V {self._explains} better than "
            "any effect on the list: measure the supply's output at a command of 0 V and at half of the range, and "
            "correct the command or record measured_voltage_V; a sensor that picks up part of the voltage looks much "
            "the same"
        )

    def form(self) -> str:
        """What it does, in words."""
        return f"an offset of {self.mean:.2g} V on every command"


def supply_offset(naming: Naming, named: str, prior: NoisePrior) -> Unlisted | None:
    """An offset of the supply that is clearly likelier than what is named (physics of a verdict); else None."""
    claimed = Claimed.of(naming, named)
    if claimed is None:
        return None
    replaced: list[tuple[str, ...]] = [(e,) for e in claimed.effects if e in _ALIKE]
    if named == UNKNOWN:
        replaced += [claimed.effects, ()]
    rests = {w.name: w for w in (claimed.without(r, prior) for r in replaced) if w is not None}
    found = []
    for rest in sorted(rests.values(), key=lambda w: len(w.effects)):
        cost = claimed.cost(rest)
        at = offset_of(rest.fit, prior, CLEAR - cost)
        if at is not None:
            found.append(SupplyOffset(at.mean, at.sd, at.log_evidence + cost, at.log_evidence, rest.name, at.repaired))
    return clearest(found)


def offset_of(fit: Fit, prior: NoisePrior, beyond: float) -> Sized | None:
    """V_0 (V) beside a fit, where the log evidence with it may lie beyond so many nats; else None.

    None as well where it is below zero, which has a name.
    """

    def raised(problem: Problem, volts: float) -> Problem:
        return replace(problem, pieces=tuple(with_offset(p, volts) for p in problem.pieces))

    if _FALLS_SHORT * _promised(fit, raised(fit.problem, _FIRST_V)) < beyond - fit.log_evidence - _SLACK:
        return None
    climb = Climb(fit, prior, raised, _FIRST_V, _LARGEST_V)
    climb.go_up()
    peak = climb.peak(beyond)
    if peak is None:
        return None
    # the offset integrated out, with its prior
    precision = 1.0 / peak.sd**2 + 1.0 / _SD_V**2
    mean = peak.at / peak.sd**2 / precision
    total = peak.height - 0.5 * peak.at**2 / (peak.sd**2 + _SD_V**2) - 0.5 * math.log(precision * _SD_V**2)
    if total <= beyond:
        return None
    return Sized(mean, precision**-0.5, total, Repaired(peak.fit, lambda piece: with_offset(piece, peak.near)))


def _promised(fit: Fit, raised: Problem) -> float:
    """Nats that an offset promises beside a fit whose parameters move along linearly; one simulation.

    raised: the fit's problem with some volts more.
    """
    there = raised.clean(fit.q)
    if not all(np.isfinite(x).all() for x in there):
        return math.inf
    moved = Shared([(y - x)[None] for x, y in zip(fit.clean, there, strict=True)])
    (own,), (beside,) = left(fit, moved)
    return 0.5 * float(max(beside, 0.0) ** 2 / own) if np.isfinite(own) else 0.0


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

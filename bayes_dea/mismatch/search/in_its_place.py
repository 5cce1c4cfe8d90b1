"""Another effect in the place of one of several, looked for from where they stand."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from ..where.size import effect_size
from .beside import beside_these, names_beside, together
from .frame import Frame
from .hypotheses import extended
from .promising import MASS, of_laws, stripped, too_dear
from .quest import Quest
from .weigh import Weighed, refine

#: effects by which displacement comes late, and which look alike in voltage recordings for that (confusion group G1 of
#: the catalogue of missing physics, and a supply that cannot sink). A mass with much damping does as well, but its
#: frequency and damping trade along a ridge, of which an evidence by Laplace says too much
LATE = frozenset({
    "series_resistance", "supply_current_limit", "one_quadrant_supply", "extra_relaxation_mode", "parallel_damper",
    "acquisition_delay", "sensor_lag",
})  # fmt: skip
#: effects that a mass with a shift, or without one, may pass for
DAMPED = frozenset({"parallel_damper", "sensor_lag"})
#: nats behind what leads within which another one is its rival
_NEAR = 12.0


def without(w: Weighed, others: Sequence[str], quest: Quest) -> Frame | None:
    """An explanation with `others` alone of its effects, from where it stands; None where that has no answer there."""
    bare = extended(quest.model, others, quest.given) if others else quest.model
    plain = stripped(w.fit, bare, quest.prior) if bare is not None else None
    return None if plain is None else Frame(plain)


def in_its_place(
    frame: Frame, others: Sequence[str], name: str, w: Weighed, quest: Quest, reached: float, behind: float
) -> list[Weighed]:
    """An effect beside `others`, all of them among those of `w`, by each of its laws, from where that stands.

    frame: see `without`; reached, behind: see `refine`.
    """
    screened = beside_these(
        [frame], others, name, quest.model, quest.given, sparse=False, series_ohm=w.fit.values().get("R_s_ohm")
    )
    out = []
    for s in screened:
        found = refine(frame.fit, s, quest.prior, 2, reached, behind)
        if found is not None:
            # the grid around a place that is not its own maximum says little of the evidence
            found = of_laws(replace(found, log_evidence=found.fit.log_evidence), screened)
            out.append(replace(found, log_evidence_se=0.1, size_m=effect_size(quest.base, found.fit)))
    return out


def alike(w: Weighed, known: Collection[str], quest: Quest) -> list[Weighed]:
    """Rivals of several effects with another one that comes late in the place of one that does.

    The base of the first effect alone may do what the second one should, by a mode where nothing samples it (a branch
    of 0.4 ms is a damper). From there just one of those that look alike is found, and would stand without its rivals.
    known: names of hypotheses that were fitted.
    """
    out: list[Weighed] = []
    if len(w.effects) < 2:
        return out
    quest = quest.by(w.laws)
    for effect in (n for n in w.effects if n in LATE or n == MASS):
        others = tuple(n for n in w.effects if n != effect)
        rivals = (LATE if effect in LATE else DAMPED) - {effect}
        late = [n for n in names_beside(replace(w, effects=others), quest.names) if n in rivals]
        names = {n: together(others, n) for n in late}
        names = {n: both for n, both in names.items() if "+".join(both) not in known and not too_dear(both)}
        frame = without(w, others, quest) if names else None
        if frame is None:
            continue
        for name, both in names.items():
            quest.say("comparing rivals", 0, 1, "+".join(both))
            out += in_its_place(frame, others, name, w, quest, w.value, _NEAR)
    return out

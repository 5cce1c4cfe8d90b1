"""Every further effect beside those of an explanation: on its grid, and fitted where that promises something."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from ...gauss_newton.laws import laws_of_effect
from ...models.effects import registered_effects
from ...models.model import Model
from .frame import Frame
from .grid import Screened, screen
from .hypotheses import DELAY, extended
from .promising import CHARGES, DEAR, LEAST_GAIN, MASS, asked_of, refined
from .quest import Quest
from .slow_start import driven_start
from .weigh import Weighed, excess

#: nats that a grid has to promise for a third effect, which is taken from 5 nats on
_THIRD = 3.0
#: the damping of a mass and a damper in parallel are one and the same number
SAME = {MASS, "parallel_damper"}
#: effects that are another one at an end of their parameters: a leak acts through the resistance before it
CONTAINS = {"leakage": "series_resistance"}


def together(effects: Sequence[str], name: str) -> tuple[str, ...]:
    """Effects and one more, in the order of the chain."""
    return tuple(sorted((*effects, name), key=list(registered_effects()).index))


def names_beside(w: Weighed, names: Sequence[str]) -> list[str]:
    """What may be added to a hypothesis.

    As a third, nothing that makes a mass dear: as for two of these alone (`too_dear`) every step has to follow both,
    and a pair of them is looked for beside the mass. A shift of the readings costs nothing.
    """
    found = [n for n in names if n not in w.effects and not any({n, e} == SAME for e in w.effects)]
    if len(w.effects) < 2:
        return found
    if _dear_mass(w.effects):
        return [n for n in found if n == DELAY]
    return [n for n in found if not _dear_mass((n, *w.effects))]


def _dear_mass(effects: Sequence[str]) -> bool:
    return MASS in effects and bool((CHARGES | DEAR).intersection(effects) - {MASS})


def beside_these(
    frames: Sequence[Frame], effects: Sequence[str], name: str, model: Model, given: Mapping[str, object],
    sparse: bool = True, series_ohm: float | None = None,
) -> list[Screened]:
    """An effect beside others on its grid, by each of its laws that has an answer. frames: see `screen`."""
    both = together(effects, name)
    models = [extended(model, both, {**given, **law}) for law in laws_of_effect(name, given)]
    found = [screen(frames, m, both, sparse, series_ohm) for m in models if m is not None]
    return [s for s in found if s is not None]


def beside(best: Weighed, quest: Quest, least: float = LEAST_GAIN, reached: float = math.inf) -> list[Weighed]:
    """Every further effect beside the ones found; none where the grid promises less than `least` nats for any.

    reached: the value (see `Weighed`) of the best that is known already.
    """
    frame, promised = Frame(best.fit), LEAST_GAIN if len(best.effects) < 2 else _THIRD
    # what was not fitted after a mode was taken out leaves far more than grids, which move it along, can promise of
    left = excess(best.fit, quest.prior) - frame.unsettled
    found = _each_beside([frame], best, quest)
    most = max((s.promise for s in found), default=0.0)
    if most < max(least, promised) or all(s.promise < asked_of(s, best.effects, left) for s in found):
        # a press may have driven all that is fitted to where no second effect promises anything
        driven = driven_start(best.fit, quest.prior, [])
        if driven is not None:
            quiet = quest.prior.start()
            found = _each_beside([Frame(replace(f, noise=quiet)) for f in (best.fit, driven)], best, quest)
            most = max((s.promise for s in found), default=0.0)
    if most < max(least, promised):
        return []
    return list(refined(best.fit, found, quest, left=left, best=reached, least=promised).values())


def promised_beside(best: Weighed, quest: Quest) -> float:
    """Nats that a grid promises at most for a further effect beside the ones found."""
    return max((s.promise for s in _each_beside([Frame(best.fit)], best, quest)), default=0.0)


def _each_beside(frames: Sequence[Frame], best: Weighed, quest: Quest) -> list[Screened]:
    """Every further effect on its grid."""
    rest, by = names_beside(best, quest.names), quest.by(best.laws)
    found = []
    for k, name in enumerate(rest):
        quest.say("weighing pairs", k, len(rest), "+".join(together(best.effects, name)))
        found += beside_these(frames, best.effects, name, quest.model, by.given)
    return found


def puts_back(narrow: Weighed, w: Weighed) -> bool:
    """Whether an effect of `w` is the one that contains another one of `narrow`, all else being the same."""
    return any(
        a in narrow.effects and wide not in narrow.effects and set(w.effects) == {wide, *narrow.effects} - {a}
        for wide, a in CONTAINS.items()
    )


def top_of(found: Sequence[Weighed], otherwise: Weighed) -> Weighed:
    """The likeliest; what only a grid has weighed has no fit of its own to be judged by."""
    return max((w for w in found if w.refitted), key=lambda w: w.log_evidence, default=otherwise)

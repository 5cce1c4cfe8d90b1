"""Pairs of effects where one is not enough: beside the one that leads alone, and beside others in its place."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from ...gauss_newton.laws import COUNTED
from ...gauss_newton.noise_prior import NoisePrior
from ...models.effects import registered_effects
from ..where.size import effect_size
from .beside import CONTAINS, beside, beside_these, puts_back, together, top_of
from .frame import Frame
from .hypotheses import DELAY
from .promising import DEAR, FOUND, RIVALS, refined
from .quest import Quest
from .relabel import FURTHER, with_stand_in_idle
from .weigh import Weighed, excess

#: nats behind the leading one within which a single effect may be the first of a pair in its place, and how many
_ALIKE, PARTNERS = 30.0, 3
#: the same as a share of the misfit that is left, for one that takes the place of what is dear to simulate
_BESIDE = 0.25
#: the same for one that is tried as the first of a pair where nothing beside the leading one is enough, and how many
NEXT, _NEXT_ONES = 0.5, 2
#: share of the misfit that a single effect has to explain for that
PART = 0.05
#: times what the leading one leaves, up to which another one with a shift of the readings may leave, and how many
_LEAVES, _SHIFTED_ONES = 2.0, 2


def freed(w: Weighed, prior: NoisePrior) -> Weighed | None:
    """An explanation with the mode idle that stands in for something else, which can then be looked for beside it.

    None where there is no such mode, or a further one is among its effects (`second_thoughts` looks there).
    """
    idle = with_stand_in_idle(w, prior) if FURTHER not in w.effects else None
    return None if idle is None else replace(w, fit=idle, log_evidence=idle.log_evidence)


def beside_the_leader(
    first: Weighed, weighed: Sequence[Weighed], quest: Quest, thoughts: Callable[[Weighed], Weighed]
) -> tuple[Weighed, list[Weighed]]:
    """What leads alone or stands for it, and every further effect beside that.

    Where two effects are hidden, what is dear to simulate may lead by doing a little of the other one's work, too: a
    mass that rings beyond what is sampled is a damper and a lag. One that is quick and explains nearly as much, by what
    both leave, is tried first; what is dear has to be tried with everything only where that leaves something.
    thoughts: see `second_thoughts`.
    """
    first = _narrowest(first, weighed)
    quick = _quick_one(first, weighed, quest.prior)
    found = beside(quick, quest)
    if quick is first:
        return first, found
    if not quest.explained_by(top_of(found, quick).fit):
        # another one that is as good alone may be the right one beside what helps here
        others = [w for w in weighed if not DEAR.intersection(w.effects)]
        found += in_place_of_the_first(quick, found, others, quest)
    top = top_of(found, quick)
    if {FURTHER, *COUNTED}.intersection(top.effects) and not quest.explained_by(top.fit):
        # a mode of the base may stand in for what is hidden, or friction have other elements
        top = thoughts(top)
        found.append(top)
    if quest.explained_by(top.fit):
        return quick, found
    return first, found + beside(first, quest, reached=min((w.value for w in found), default=math.inf))


def behind_more(first: Weighed, frames: Sequence[Frame], quest: Quest) -> list[Weighed]:
    """A single effect that contains another one, beside that, looked for from where the base stands; none for any else.

    A leak acts through the resistance of the actuator itself. Behind a resistor that is larger than this may be, its
    fit ends at the end of that prior, where the modes of the base do the rest badly; from there nothing shows that the
    resistance is larger. frames: from which single effects are looked for.
    """
    narrow = CONTAINS.get(first.effects[0]) if len(first.effects) == 1 else None
    if narrow not in quest.names:
        return []
    shared = {p.name for p in registered_effects()[narrow].parameters}
    if not any(name.removeprefix("log ") in shared for name in first.fit.at_bound):
        return []
    quest.say("weighing pairs", 0, 1, "+".join(together(first.effects, narrow)))
    screened = beside_these(frames, (narrow,), first.effects[0], quest.model, quest.given, sparse=False)
    return list(refined(quest.base, screened, quest.unasked(), 2).values())


def _narrowest(first: Weighed, weighed: Sequence[Weighed]) -> Weighed:
    """The same with an effect that one of its own contains, where that explains as much but for what is little beside a
    further effect.

    What it lacks is looked for once there is another effect (`widened`), or as a further effect.
    """
    found = [
        w for w in weighed if puts_back(w, first) and w.refitted and w.log_evidence > first.log_evidence - RIVALS
    ]
    return max(found, key=lambda w: w.log_evidence, default=first)


def _quick_one(first: Weighed, weighed: Sequence[Weighed], prior: NoisePrior) -> Weighed:
    """The best single effect, quick to simulate, that explains nearly what a dear one does; `first` without one."""
    if len(first.effects) != 1 or first.effects[0] not in DEAR:
        return first
    behind = max(_ALIKE, _BESIDE * excess(first.fit, prior))
    alike = [
        w for w in weighed
        if len(w.effects) == 1 and w.effects[0] not in DEAR and w.refitted
        and w.log_evidence > first.log_evidence - behind
    ]
    return max(alike, key=lambda w: w.log_evidence, default=first)


def in_place_of_the_first(
    first: Weighed, pairs: list[Weighed], weighed: Sequence[Weighed], quest: Quest, free: bool = False
) -> list[Weighed]:
    """Pairs whose first effect is one that alone did as well as `first`, beside what does best beside that.

    Of two effects that nothing tells apart alone one leads by chance; a pair found beside it would otherwise stand
    without its rivals. Where nothing helps beside the leading one (a mass with much damping does what two lags do), all
    that may be is tried beside the next. Where readings are off time all of them are so: `first` and what takes its
    place have a delay beside their effect then. pairs: `first` with each further effect; weighed: all that were
    weighed, those of as many effects as `first` among them; free: whether modes that stand in for another effect are
    set free.
    """
    quest = quest.unasked()
    alike = [
        w for w in weighed
        if len(w.effects) == len(first.effects) and w.effects != first.effects and w.refitted
        and (len(w.effects) == 1 or DELAY in w.effects) and w.log_evidence > first.log_evidence - _ALIKE
    ]
    alike = sorted(alike, key=lambda w: -w.log_evidence)[:PARTNERS]
    out: list[Weighed] = []
    helped = max((w.log_evidence for w in pairs), default=-math.inf) >= first.log_evidence + FOUND
    if not free and alike and not helped:
        first = alike.pop(0)
        pairs = beside(first, quest)
        out += pairs
    top = max((w.log_evidence for w in pairs), default=0.0)
    seconds = [
        next(n for n in w.effects if n not in first.effects)
        for w in sorted(pairs, key=lambda w: -w.log_evidence)[:PARTNERS]
        if w.log_evidence > top - RIVALS
    ]
    reached = min((w.value for w in pairs), default=math.inf)
    known = {w.effects for w in pairs}
    for other in alike:
        if puts_back(first, other):
            continue  # a pair of that is looked for from the pair of this (`widened`)
        rest = quest.among(n for n in seconds if n not in other.effects and together(other.effects, n) not in known)
        start = freed(other, quest.prior) if free else None
        if start is None:
            out += beside(other, rest, reached=reached)
        else:
            found = beside(start, rest, reached=reached)
            out += [replace(t, size_m=effect_size(other.fit, t.fit)) for t in found if t.fit is not start.fit]
    return out


def beside_the_next(
    first: Weighed, pairs: Sequence[Weighed], weighed: Sequence[Weighed], quest: Quest
) -> list[Weighed]:
    """Pairs of those that explain less alone than `first` does, where no pair with it leaves noise.

    What leads alone may do a part of the work of two others, and be neither (the curvature of a sensor for a dead zone
    and absorption). Beside what explains next to nothing of what the base leaves, nothing new is learned. pairs: those
    with `first`.
    """
    behind = NEXT * excess(first.fit, quest.prior)
    most = (1.0 - PART) * excess(quest.base, quest.prior)
    following = sorted(
        (
            w for w in weighed
            if len(w.effects) == 1 and w.effects != first.effects and w.refitted and not DEAR.intersection(w.effects)
            and first.log_evidence - behind < w.log_evidence < first.log_evidence - _ALIKE
            and excess(w.fit, quest.prior) < most
        ),
        key=lambda w: -w.log_evidence,
    )  # fmt: skip
    out: list[Weighed] = []
    for other in following[:_NEXT_ONES]:
        if quest.explained_by(top_of([*pairs, *out], first).fit):
            break
        tried = {w.effects for w in [*pairs, *out]}
        # beside the leading one this was looked for already
        rest = (n for n in quest.names if n not in first.effects and together(other.effects, n) not in tried)
        reached = min((w.value for w in [*pairs, *out]), default=math.inf)
        out += beside(other, quest.among(rest), reached=reached)
    return out


def helped_elsewhere(
    first: Weighed, pairs: Sequence[Weighed], weighed: Sequence[Weighed], quest: Quest
) -> list[Weighed]:
    """What helps beside an effect and a shift of the readings, beside others with a shift that explain less.

    For where no pair with the leading one leaves noise: it may do a part of the work of two others, as without a shift
    (`beside_the_next`). pairs: those with `first`, which is an effect and a shift.
    """
    helps = [
        next(n for n in w.effects if n not in first.effects)
        for w in pairs if w.refitted and len(w.effects) == len(first.effects) + 1
        and set(first.effects) < set(w.effects) and w.log_evidence > first.log_evidence + FOUND
    ]  # fmt: skip
    most = _LEAVES * excess(first.fit, quest.prior)
    others = [
        w for w in weighed
        if len(w.effects) == len(first.effects) and DELAY in w.effects and w.effects != first.effects and w.refitted
        and w.log_evidence < first.log_evidence - _ALIKE and excess(w.fit, quest.prior) < most
    ]
    reached = min((w.value for w in pairs), default=math.inf)
    out: list[Weighed] = []
    for other in sorted(others, key=lambda w: -w.log_evidence)[:_SHIFTED_ONES]:
        rest = [n for n in dict.fromkeys(helps) if n not in other.effects]
        out += beside(other, quest.unasked().among(rest), reached=reached) if rest else []
    return out

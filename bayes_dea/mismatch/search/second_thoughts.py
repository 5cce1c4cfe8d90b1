"""Rivals of an explanation that are looked for from where it stands: with one effect less, or another in its place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...gauss_newton.descent import value_at
from ..where.size import effect_size
from .beside import CONTAINS, beside, beside_these, names_beside, puts_back, together, top_of
from .frame import Frame, own_index
from .grid import Screened
from .hypotheses import DELAY, extended
from .in_its_place import in_its_place, without
from .pairs import NEXT, PART
from .promising import LEAST_GAIN, MASS, of_laws
from .quest import Quest
from .relabel import FURTHER, in_place_of_one, within, without_stand_in
from .weigh import Weighed, excess, refine

#: share of what a grid promises for an effect from which on another is tried in its place, and how many are
_PROMISING, _IN_PLACE = 0.4, 5
#: widths of its prior from which on the best point of a grid is another place than that of a fit, how many times the
#: distance of the nearest point, and widths from which on no point of a grid is near
_FAR, _FARTHER, _NOWHERE_NEAR = 0.1, 1.25, 0.5
#: nats behind what was found at which something else in its place is given up
_FAR_BEHIND = 50.0


def second_thoughts(w: Weighed, quest: Quest) -> list[Weighed]:
    """Rivals that are looked for from where an explanation stands.

    Of several effects each is left out: a fit of one alone may have ended where the other was needed; and of two, a
    shift of the readings apart, the one found second gets another beside it. An effect that contains another is put
    back to that one; where it leaves nothing to be seen alone, any other may be beside that one as well. A mode of
    the base may have gone astray, and then a further one does its work; or it stands in for another effect (a mode
    far faster than the sampling is a damper), and then that effect is looked for in its place. Of three one may do
    what is left of an effect that contains another one of them, and then that effect is looked for in place of
    both; of two that leave nothing to be seen in place of that one.
    """
    out: list[Weighed] = []
    base, model, prior, names = quest.base, quest.model, quest.prior, quest.names
    by = quest.by(w.laws)
    simpler_ones = [[n for n in w.effects if n != dropped] for dropped in w.effects] if len(w.effects) > 1 else []
    simpler_ones += [
        [n for n in w.effects if n != wide] + [narrow]
        for wide, narrow in CONTAINS.items()
        if wide in w.effects and narrow not in w.effects and narrow in names
    ]
    steps = len(simpler_ones) + 2
    for k, effects in enumerate(simpler_ones):
        quest.say("leaving one out", k, steps, "+".join(effects))
        m = extended(model, effects, by.given)
        alone = within(w, base, m, prior) if m is not None else None
        if alone is None:
            continue
        out.append(alone)
    # put back into what is here already nothing is learned
    narrow_ones = [t for t in out if not puts_back(t, w)] if len(w.effects) > 2 else []
    if len(w.effects) == 2 and set(w.effects) & set(CONTAINS.values()) and quest.explained_by(w.fit):
        narrow_ones = [w]
    out += [t for pair in narrow_ones for t in widened(pair, by, w.value)]
    if len(w.effects) == 1 and w.effects[0] in CONTAINS and out and quest.explained_by(w.fit):
        out += beside_the_narrow(w, out[0], quest)
    # a shift of the readings is none of two; where both leave nothing there is no need
    late = len(w.effects) == 3 and DELAY in w.effects and not quest.explained_by(w.fit)
    parts = [t for t in out if len(t.effects) == 2 and DELAY in t.effects] if late else out[:2]
    if (late or len(w.effects) == 2) and len(parts) == 2:
        second, first = sorted(parts, key=lambda t: t.log_evidence)  # the first was the one that led alone
        # a mass that explains next to nothing by itself, dear as it is, says little of what it rings beside
        idle = MASS in second.effects and excess(second.fit, prior) > (1.0 - PART) * excess(base, prior)
        if not idle:
            out += beside_the_second(w, second, quest)
        leaves_most = excess(first.fit, prior) > NEXT * excess(base, prior)
        neither = leaves_most and quest.adequate is not None and not quest.adequate(top_of(out[2:], w).fit)
        # what led alone may be neither of the two; and a shift does part of a mode's work, so that the base had another
        # one where others were tried beside the shift: what was found had it back first, as others may from here
        if (neither and not late) or first.effects == (DELAY,):
            out += beside_the_second(w, first, quest)
    others = [n for n in w.effects if n != FURTHER]
    if len(others) == len(w.effects):
        return out
    m = extended(model, others, by.given) if others else model
    if m is None:
        return out
    quest.say("leaving one out", steps - 2, steps, "+".join(others))
    simpler = in_place_of_one(w, base, m, prior)
    quest.say("leaving one out", steps - 1, steps, "+".join(others))
    if simpler is not None and simpler.effects:
        out.append(simpler)
    without = without_stand_in(w, m, prior)
    if without is not None:
        start = Weighed(tuple(others), without, without.log_evidence, 0.1, 0.0)
        found = beside(start, quest.among(n for n in names if n != FURTHER).unasked(), reached=w.value)
        compared = simpler.fit if simpler is not None else base
        out += [replace(t, size_m=effect_size(compared, t.fit)) for t in found if t.fit is not without]
    return out


def widened(pair: Weighed, quest: Quest, reached: float = math.inf) -> list[Weighed]:
    """A hypothesis with an effect that contains one of its own in its place, looked for from where it stands.

    reached: the value (see `Weighed`) of what is known already; what stays far behind it is given up.
    """
    out: list[Weighed] = []
    for wide, narrow in CONTAINS.items():
        if narrow not in pair.effects or wide in pair.effects or wide not in quest.names:
            continue
        others = [n for n in pair.effects if n != narrow]
        frame = without(pair, others, quest)
        if frame is not None:
            quest.say("leaving one out", 0, 1, "+".join(together(others, wide)))
            out += in_its_place(frame, others, wide, pair, quest, min(pair.value, reached), _FAR_BEHIND)
    return out


def beside_the_narrow(w: Weighed, narrow: Weighed, quest: Quest) -> list[Weighed]:
    """Pairs of what a single effect contains with any other, where that one leaves something.

    A leak behind a resistance is as much as two effects: what it does beyond the resistance another may do as well.
    """
    least = _PROMISING * (w.log_evidence - narrow.log_evidence)
    if least < LEAST_GAIN:
        return []
    others = quest.among(n for n in quest.names if n not in w.effects)
    found = beside(narrow, others.unasked(), least, reached=w.value)
    return [replace(t, size_m=effect_size(quest.base, t.fit)) for t in found if t.fit is not narrow.fit]


def merged(found: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """Explanations that name an effect and another that contains it, without the former, from where they stand.

    They are one and the same model: beside a resistance a leak was found that a search for the leak alone has missed.
    """
    out = []
    for w in found:
        twice = [narrow for wide, narrow in CONTAINS.items() if {wide, narrow} <= set(w.effects)]
        rest = [n for n in w.effects if n not in twice]
        m = extended(quest.model, rest, quest.by(w.laws).given) if twice else None
        without = within(w, quest.base, m, quest.prior) if m is not None and w.refitted else None
        if without is not None:
            out.append(without)
    return out


def beside_the_second(pair: Weighed, alone: Weighed, quest: Quest) -> list[Weighed]:
    """Pairs of the effect that was found second with another than the one found first.

    What leads alone does some of the second one's work, too; beside that one another may do better. So may the first
    one itself, elsewhere: a mass that was found before what jumps with it may ring at another frequency.
    alone: the second effect of `pair`, fitted without the first.
    """
    frame = Frame(alone.fit)
    given = quest.by(alone.laws).given
    found = [
        s for name in names_beside(alone, quest.names)
        for s in beside_these([frame], alone.effects, name, quest.model, given)
    ]  # fmt: skip
    # what the grid promises is compared with what it promises for the one that was found, not with what that reached
    least = _PROMISING * next((s.gain for s in found if s.effects == pair.effects), math.inf)
    likely = [s for s in sorted(found, key=lambda s: -s.gain) if s.effects != pair.effects and s.gain > max(least, 1.0)]
    # what contains the one found first is looked for from there (`widened`)
    wide = {n for n, narrow in CONTAINS.items() if narrow in pair.effects and narrow not in alone.effects}
    likely = [s for s in likely if not wide.intersection(s.effects)]
    likely = [s for s in found if s.effects == pair.effects and _elsewhere(s, pair, alone)] + likely[:_IN_PLACE]
    out, reached = [], pair.value
    for k, s in enumerate(likely):
        quest.say("weighing pairs", k, len(likely), "+".join(s.effects))
        # what does not come near what was found changes nothing; of many peaks the grid's best may be the wrong one
        w = refine(alone.fit, s, quest.prior, 2 if s.effects == pair.effects else 1, reached, _FAR_BEHIND)
        if w is not None:
            reached = min(reached, value_at(w.fit.problem, w.fit.q, quest.prior.start()))
            out.append(replace(of_laws(w, found), size_m=effect_size(quest.base, w.fit)))
    return out


def _elsewhere(s: Screened, pair: Weighed, alone: Weighed) -> bool:
    """Whether the best point of a grid beside `alone` is far, for its prior, from where the pair was fitted.

    Far beyond the nearest point, that is: a grid is coarse. One that shows nothing near it at all is elsewhere.
    """
    own = own_index(alone.fit, s.model)
    names = pair.fit.problem.model.priors.names
    if not set(s.model.priors.names) <= set(names):  # another law
        return False
    there = pair.fit.q[[names.index(s.model.priors.names[i]) for i in own]]
    off = [float(np.max(np.abs(p.own - there) / s.model.priors.scales()[own], initial=0.0)) for p in s.points]
    return off[0] > max(_FAR, min(_FARTHER * min(off), _NOWHERE_NEAR))

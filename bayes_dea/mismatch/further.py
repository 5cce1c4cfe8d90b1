"""Effects beside others: where one is not enough, or seems to be so because something stands in for a second."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..models.effects import registered_effects
from ..models.model import Model
from .descent import value_at
from .elements import counted, counted_as
from .frame import Frame, own_index
from .grid import Screened, screen
from .hypotheses import extended
from .laws import COUNTED, laws_of_effect
from .noise_prior import NoisePrior
from .refit import Fit, refit
from .relabel import FURTHER, in_place_of_one, with_stand_in_idle, within, without_stand_in
from .search import CHARGES, DEAR, FOUND, LEAST_GAIN, MASS, RIVALS, Report, asked_of, of_laws, refined, stripped
from .size import effect_size
from .slow_start import driven_start
from .weigh import Weighed, excess, refine

#: nats that it has to promise for a second effect beside one that leaves nothing to be seen
HIDDEN = 8.0
#: the same for a third effect, which is taken from 5 nats on
_THIRD = 3.0
#: nats behind the leading one within which a single effect may be the first of a pair in its place, and how many
_ALIKE, _PARTNERS = 30.0, 3
#: the same as a share of the misfit that is left, for one that takes the place of what is dear to simulate
_BESIDE = 0.25
#: the same for one that is tried as the first of a pair where nothing beside the leading one is enough, and how many
_NEXT, _NEXT_ONES = 0.5, 2
#: share of the misfit that a single effect has to explain for that
_PART = 0.05
#: nats behind the leader within which its rivals are fitted from where it stands
_CROSSED = 60.0
#: share of what a grid promises for an effect from which on another is tried in its place, and how many are
_PROMISING, _IN_PLACE = 0.4, 5
#: widths of its prior from which on the best point of a grid is another place than that of a fit, how many times the
#: distance of the nearest point, and widths from which on no point of a grid is near
_FAR, _FARTHER, _NOWHERE_NEAR = 0.1, 1.25, 0.5
#: nats behind what was found at which something else in its place is given up
_FAR_BEHIND = 50.0
#: the damping of a mass and a damper in parallel are one and the same number
SAME = {MASS, "parallel_damper"}
#: effects that are another one at an end of their parameters: a leak acts through the resistance before it
CONTAINS = {"leakage": "series_resistance"}


def together(effects: Sequence[str], name: str) -> tuple[str, ...]:
    """Effects and one more, in the order of the chain."""
    return tuple(sorted((*effects, name), key=list(registered_effects()).index))


def names_beside(w: Weighed, names: Sequence[str]) -> list[str]:
    """What may be added to a hypothesis.

    As a third, nothing that charges the dielectric beside a mass: as for two of these alone (`too_dear`) every step has
    to follow both, and a pair of them is looked for beside the mass.
    """
    found = [n for n in names if n not in w.effects and not any({n, e} == SAME for e in w.effects)]
    if len(w.effects) < 2:
        return found
    return [n for n in found if not (MASS in (n, *w.effects) and CHARGES.intersection((n, *w.effects)))]


def beside_these(
    frames: Sequence[Frame], effects: Sequence[str], name: str, model: Model, overrides: Mapping[str, object],
    sparse: bool = True, series_ohm: float | None = None,
) -> list[Screened]:
    """An effect beside others on its grid, by each of its laws that has an answer. frames: see `screen`."""
    both = together(effects, name)
    models = [extended(model, both, {**overrides, **law}) for law in laws_of_effect(name)]
    found = [screen(frames, m, both, sparse, series_ohm) for m in models if m is not None]
    return [s for s in found if s is not None]


def beside(
    best: Weighed, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object], say: Report,
    rng: np.random.Generator, adequate: Callable[[Fit], bool] | None = None, least: float = LEAST_GAIN,
    reached: float = math.inf,
) -> list[Weighed]:
    """Every further effect beside the ones found; none where the grid promises less than `least` nats for any.

    reached: the value (see `Weighed`) of the best that is known already.
    """
    def on_grids(frames: Sequence[Frame]) -> list[Screened]:
        return _each_beside(frames, best, model, names, overrides, say)

    left, promised = excess(best.fit, prior), LEAST_GAIN if len(best.effects) < 2 else _THIRD
    found = on_grids([Frame(best.fit)])
    most = max((s.promise for s in found), default=0.0)
    if most < max(least, promised) or all(s.promise < asked_of(s, best.effects, left) for s in found):
        # a press may have driven all that is fitted to where no second effect promises anything
        driven = driven_start(best.fit, prior, [])
        if driven is not None:
            quiet = prior.start()
            found = on_grids([Frame(replace(f, noise=quiet)) for f in (best.fit, driven)])
            most = max((s.promise for s in found), default=0.0)
    if most < max(least, promised):
        return []
    weighed = refined(
        best.fit, found, prior, say, 1, rng, left=left, adequate=adequate, best=reached, least=promised
    )
    return list((weighed or {}).values())


def promised_beside(
    best: Weighed, model: Model, names: list[str], overrides: Mapping[str, object], say: Report
) -> float:
    """Nats that a grid promises at most for a further effect beside the ones found."""
    found = _each_beside([Frame(best.fit)], best, model, names, overrides, say)
    return max((s.promise for s in found), default=0.0)


def _each_beside(
    frames: Sequence[Frame], best: Weighed, model: Model, names: list[str], overrides: Mapping[str, object], say: Report
) -> list[Screened]:
    """Every further effect on its grid."""
    rest, laws = names_beside(best, names), {**overrides, **best.laws}
    found = []
    for k, name in enumerate(rest):
        say("weighing pairs", k, len(rest), "+".join(together(best.effects, name)))
        found += beside_these(frames, best.effects, name, model, laws)
    return found


def widened(
    pair: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object],
    say: Report, reached: float = math.inf,
) -> list[Weighed]:
    """A hypothesis with an effect that contains one of its own in its place, looked for from where it stands.

    reached: the value (see `Weighed`) of what is known already; what stays far behind it is given up.
    """
    out = []
    for wide, narrow in CONTAINS.items():
        if narrow not in pair.effects or wide in pair.effects or wide not in names:
            continue
        others = [n for n in pair.effects if n != narrow]
        bare = extended(model, others, overrides) if others else model
        plain = stripped(pair.fit, bare, prior) if bare is not None else None
        if plain is None:
            continue
        say("leaving one out", 0, 1, "+".join(together(others, wide)))
        screened = beside_these(
            [Frame(plain)], others, wide, model, overrides, sparse=False, series_ohm=pair.fit.values().get("R_s_ohm")
        )
        for s in screened:
            w = refine(plain, s, prior, 2, min(pair.value, reached), _FAR_BEHIND)
            if w is not None:
                # the grid around a place that is not its own maximum says little of the evidence
                w = of_laws(replace(w, log_evidence=w.fit.log_evidence), screened)
                out.append(replace(w, log_evidence_se=0.1, size_m=effect_size(base, w.fit)))
    return out


def beside_the_second(
    pair: Weighed, alone: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior,
    overrides: Mapping[str, object], say: Report,
) -> list[Weighed]:
    """Pairs of the effect that was found second with another than the one found first.

    What leads alone does some of the second one's work, too; beside that one another may do better. So may the first
    one itself, elsewhere: a mass that was found before what jumps with it may ring at another frequency.
    alone: the second effect of `pair`, fitted without the first.
    """
    frame = Frame(alone.fit)
    overrides = {**overrides, **alone.laws}
    found = [
        s for name in names_beside(alone, names) for s in beside_these([frame], alone.effects, name, model, overrides)
    ]
    # what the grid promises is compared with what it promises for the one that was found, not with what that reached
    least = _PROMISING * next((s.gain for s in found if s.effects == pair.effects), math.inf)
    likely = [s for s in sorted(found, key=lambda s: -s.gain) if s.effects != pair.effects and s.gain > max(least, 1.0)]
    # what contains the one found first is looked for from there (`widened`)
    wide = {n for n, narrow in CONTAINS.items() if narrow in pair.effects and narrow not in alone.effects}
    likely = [s for s in likely if not wide.intersection(s.effects)]
    likely = [s for s in found if s.effects == pair.effects and _elsewhere(s, pair, alone)] + likely[:_IN_PLACE]
    out, reached = [], pair.value
    for k, s in enumerate(likely):
        say("weighing pairs", k, len(likely), "+".join(s.effects))
        # what does not come near what was found changes nothing; of many peaks the grid's best may be the wrong one
        w = refine(alone.fit, s, prior, 2 if s.effects == pair.effects else 1, reached, _FAR_BEHIND)
        if w is not None:
            reached = min(reached, value_at(w.fit.problem, w.fit.q, prior.start()))
            out.append(replace(of_laws(w, found), size_m=effect_size(base, w.fit)))
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


def _puts_back(narrow: Weighed, w: Weighed) -> bool:
    """Whether an effect of `w` is the one that contains another one of `narrow`, all else being the same."""
    return any(
        a in narrow.effects and set(w.effects) == {wide, *narrow.effects} - {a} for wide, a in CONTAINS.items()
    )


def freed(w: Weighed, prior: NoisePrior) -> Weighed | None:
    """An explanation with the mode idle that stands in for something else, which can then be looked for beside it.

    None where there is no such mode, or a further one is among its effects (`second_thoughts` looks there).
    """
    idle = with_stand_in_idle(w, prior) if FURTHER not in w.effects else None
    return None if idle is None else replace(w, fit=idle, log_evidence=idle.log_evidence)


def beside_the_leader(
    first: Weighed, weighed: Sequence[Weighed], model: Model, names: list[str], prior: NoisePrior,
    overrides: Mapping[str, object], say: Report, rng: np.random.Generator, adequate: Callable[[Fit], bool],
    thoughts: Callable[[Weighed], Weighed],
) -> tuple[Weighed, list[Weighed]]:
    """What leads alone or stands for it, and every further effect beside that.

    Where two effects are hidden, what is dear to simulate may lead by doing a little of the other one's work, too: a
    mass that rings beyond what is sampled is a damper and a lag. One that is quick and explains nearly as much, by what
    both leave, is tried first; what is dear has to be tried with everything only where that leaves something.
    thoughts: see `second_thoughts`.
    """
    first = _narrowest(first, weighed)
    quick = _quick_one(first, weighed, prior)
    found = beside(quick, model, names, prior, overrides, say, rng, adequate)
    if quick is first:
        return first, found
    if not adequate(_top(found, quick).fit):
        # another one that is as good alone may be the right one beside what helps here
        others = [w for w in weighed if not DEAR.intersection(w.effects)]
        found += in_place_of_the_first(quick, found, others, model, names, prior, overrides, say, rng)
    top = _top(found, quick)
    if {FURTHER, *COUNTED}.intersection(top.effects) and not adequate(top.fit):
        # a mode of the base may stand in for what is hidden, or friction have other elements
        top = thoughts(top)
        found.append(top)
    if adequate(top.fit):
        return quick, found
    reached = min((w.value for w in found), default=math.inf)
    return first, found + beside(first, model, names, prior, overrides, say, rng, adequate, reached=reached)


def _top(found: Sequence[Weighed], otherwise: Weighed) -> Weighed:
    """The likeliest; what only a grid has weighed has no fit of its own to be judged by."""
    return max((w for w in found if w.refitted), key=lambda w: w.log_evidence, default=otherwise)


def _narrowest(first: Weighed, weighed: Sequence[Weighed]) -> Weighed:
    """The same with an effect that one of its own contains, where that explains as much but for what is little beside a
    further effect.

    What it lacks is looked for once there is another effect (`widened`), or as a further effect.
    """
    found = [
        w for w in weighed if _puts_back(w, first) and w.refitted and w.log_evidence > first.log_evidence - RIVALS
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
    first: Weighed, pairs: list[Weighed], weighed: list[Weighed], model: Model, names: list[str], prior: NoisePrior,
    overrides: Mapping[str, object], say: Report, rng: np.random.Generator, free: bool = False,
) -> list[Weighed]:
    """Pairs whose first effect is one that alone did as well as `first`, beside what does best beside that.

    Of two effects that nothing tells apart alone one leads by chance; a pair found beside it would otherwise stand
    without its rivals. Where nothing helps beside the leading one (a mass with much damping does what two lags do), all
    that may be is tried beside the next. pairs: `first` with each second effect; weighed: all that were weighed, single
    ones among them; free: whether modes that stand in for a second effect are set free for it.
    """
    alike = [
        w for w in weighed
        if len(w.effects) == 1 and w.effects != first.effects and w.refitted
        and w.log_evidence > first.log_evidence - _ALIKE
    ]
    alike = sorted(alike, key=lambda w: -w.log_evidence)[:_PARTNERS]
    out: list[Weighed] = []
    helped = max((w.log_evidence for w in pairs), default=-math.inf) >= first.log_evidence + FOUND
    if not free and alike and not helped:
        first = alike.pop(0)
        pairs = beside(first, model, names, prior, overrides, say, rng)
        out += pairs
    top = max((w.log_evidence for w in pairs), default=0.0)
    seconds = [
        next(n for n in w.effects if n not in first.effects)
        for w in sorted(pairs, key=lambda w: -w.log_evidence)[:_PARTNERS]
        if w.log_evidence > top - RIVALS
    ]
    reached = min((w.value for w in pairs), default=math.inf)
    known = {w.effects for w in pairs}
    for other in alike:
        if _puts_back(first, other):
            continue  # a pair of that is looked for from the pair of this (`widened`)
        rest = [n for n in seconds if n not in other.effects and together(other.effects, n) not in known]
        start = freed(other, prior) if free else None
        if start is None:
            out += beside(other, model, rest, prior, overrides, say, rng, reached=reached)
        else:
            found = beside(start, model, rest, prior, overrides, say, rng, reached=reached)
            out += [replace(t, size_m=effect_size(other.fit, t.fit)) for t in found if t.fit is not start.fit]
    return out


def beside_the_next(
    none: Weighed, first: Weighed, pairs: Sequence[Weighed], weighed: Sequence[Weighed], model: Model, names: list[str],
    prior: NoisePrior, overrides: Mapping[str, object], say: Report, rng: np.random.Generator,
    adequate: Callable[[Fit], bool],
) -> list[Weighed]:
    """Pairs of those that explain less alone than `first` does, where no pair with it leaves noise.

    What leads alone may do a part of the work of two others, and be neither (the curvature of a sensor for a dead zone
    and absorption). Beside what explains next to nothing of what the base leaves, nothing new is learned. none: the
    base; pairs: those with `first`.
    """
    behind = _NEXT * excess(first.fit, prior)
    most = (1.0 - _PART) * excess(none.fit, prior)
    following = sorted(
        (
            w for w in weighed
            if len(w.effects) == 1 and w.effects != first.effects and w.refitted and not DEAR.intersection(w.effects)
            and first.log_evidence - behind < w.log_evidence < first.log_evidence - _ALIKE
            and excess(w.fit, prior) < most
        ),
        key=lambda w: -w.log_evidence,
    )  # fmt: skip
    out: list[Weighed] = []
    for other in following[:_NEXT_ONES]:
        if adequate(_top([*pairs, *out], first).fit):
            break
        tried = {w.effects for w in [*pairs, *out]}
        # beside the leading one this was looked for already
        rest = [n for n in names if n not in first.effects and together(other.effects, n) not in tried]
        reached = min((w.value for w in [*pairs, *out]), default=math.inf)
        out += beside(other, model, rest, prior, overrides, say, rng, adequate, reached=reached)
    return out


def merged(
    found: Sequence[Weighed], base: Fit, model: Model, prior: NoisePrior, overrides: Mapping[str, object]
) -> list[Weighed]:
    """Explanations that name an effect and another that contains it, without the former, from where they stand.

    They are one and the same model: beside a resistance a leak was found that a search for the leak alone has missed.
    """
    out = []
    for w in found:
        twice = [narrow for wide, narrow in CONTAINS.items() if {wide, narrow} <= set(w.effects)]
        m = extended(model, [n for n in w.effects if n not in twice], {**overrides, **w.laws}) if twice else None
        without = within(w, base, m, prior) if m is not None and w.refitted else None
        if without is not None:
            out.append(without)
    return out


def again(explanations: Sequence[Fit], base: Fit, prior: NoisePrior) -> list[Weighed]:
    """Explanations from another reading of the recordings on those of `base`, refitted from where they stand."""
    out = []
    for known in explanations:
        model = known.problem.model
        problem = base.problem.with_model(model)
        if model.name == base.problem.model.name:
            continue
        # recordings that come in bring zeros of their own
        own = base.q[base.problem.model.dimension :]
        q = known.q if known.q.size == problem.dimension else np.concatenate([known.q[: model.dimension], own])
        start = Weighed((), replace(known, problem=problem, q=q), known.log_evidence, 0.1, 0.0)
        found = within(start, base, model, prior)
        if found is not None:
            out.append(found)
    return out


def from_the_leader(
    leader: Weighed, weighed: Sequence[Weighed], base: Fit, prior: NoisePrior, say: Report
) -> list[Weighed]:
    """Rivals of as many effects, fitted again from the base that the leader has.

    A search may have ended with a base that is astray (slow modes beside a drift), and then what does just the same as
    the leader looks nats worse. So it does where only the leader's elements of friction were counted. Given are those
    that are likelier than before.
    """
    count = len(leader.effects)
    rivals = sorted(
        (w for w in weighed if w.refitted and len(w.effects) == count and w.effects != leader.effects),
        key=lambda w: -w.log_evidence,
    )[:_PARTNERS]
    out = []
    shared = _coordinates(leader.fit)
    for k, w in enumerate(rivals):
        model = counted_as(w.fit.problem.model, leader.fit.problem.model)
        # how many nats a wrong count costs is not known before
        if model is w.fit.problem.model and w.log_evidence < leader.log_evidence - _CROSSED:
            continue
        say("comparing rivals", k, len(rivals), w.name)
        problem = leader.fit.problem.with_model(model)
        known = {**_coordinates(w.fit), **shared}
        start = np.array([known[n] for n in model.priors.names])
        q = np.concatenate([start, leader.fit.q[leader.fit.problem.model.dimension :]])
        fit = refit(problem, q, prior.start(), prior, coarse=True)
        if fit is not None and fit.log_evidence > w.fit.log_evidence:
            better = replace(w, fit=fit, log_evidence=w.log_evidence + fit.log_evidence - w.fit.log_evidence)
            out.append(better if model is w.fit.problem.model else counted(better, base, prior))
    return out


def _coordinates(fit: Fit) -> dict[str, float]:
    """Those of the model by the name of their parameter."""
    names = fit.problem.model.priors.names
    return dict(zip(names, map(float, fit.q[: len(names)]), strict=True))


def second_thoughts(
    w: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object],
    say: Report, rng: np.random.Generator, explains: Callable[[Fit], bool] | None = None,
) -> list[Weighed]:
    """Rivals that are looked for from where an explanation stands.

    Of several effects each is left out: a fit of one alone may have ended where the other was needed; and of two the
    one found second gets another beside it. An effect that contains another is put back to that one. A mode of the base
    may have gone astray, and then a further one does its work; or it stands in for another effect (a mode far faster
    than the sampling is a damper), and then that effect is looked for in its place. Of three one may do what is left
    of an effect that contains another one of them, and then that effect is looked for in place of both; of two that
    leave nothing to be seen (`explains`) in place of that one.
    """
    out: list[Weighed] = []
    laws = {**overrides, **w.laws}
    simpler_ones = [[n for n in w.effects if n != dropped] for dropped in w.effects] if len(w.effects) > 1 else []
    simpler_ones += [
        [n for n in w.effects if n != wide] + [narrow]
        for wide, narrow in CONTAINS.items()
        if wide in w.effects and narrow not in w.effects and narrow in names
    ]
    steps = len(simpler_ones) + 2
    for k, effects in enumerate(simpler_ones):
        say("leaving one out", k, steps, "+".join(effects))
        m = extended(model, effects, laws)
        alone = within(w, base, m, prior) if m is not None else None
        if alone is None:
            continue
        out.append(alone)
    # put back into what is here already nothing is learned
    narrow_ones = [t for t in out if not _puts_back(t, w)] if len(w.effects) > 2 else []
    if len(w.effects) == 2 and set(w.effects) & set(CONTAINS.values()) and explains is not None and explains(w.fit):
        narrow_ones = [w]
    out += [t for pair in narrow_ones for t in widened(pair, base, model, names, prior, laws, say, w.value)]
    if len(w.effects) == 2 and len(out) > 1:
        second, first = sorted(out[:2], key=lambda t: t.log_evidence)  # the first was the one that led alone
        # a mass that explains next to nothing by itself, dear as it is, says little of what it rings beside
        idle = MASS in second.effects and excess(second.fit, prior) > (1.0 - _PART) * excess(base, prior)
        if not idle:
            out += beside_the_second(w, second, base, model, names, prior, overrides, say)
        leaves_most = excess(first.fit, prior) > _NEXT * excess(base, prior)
        if leaves_most and explains is not None and not explains(_top(out[2:], w).fit):
            # what led alone may be neither of the two
            out += beside_the_second(w, first, base, model, names, prior, overrides, say)
    others = [n for n in w.effects if n != FURTHER]
    if len(others) == len(w.effects):
        return out
    m = extended(model, others, laws) if others else model
    if m is None:
        return out
    say("leaving one out", steps - 2, steps, "+".join(others))
    simpler = in_place_of_one(w, base, m, prior)
    say("leaving one out", steps - 1, steps, "+".join(others))
    if simpler is not None and simpler.effects:
        out.append(simpler)
    without = without_stand_in(w, m, prior)
    if without is not None:
        start = Weighed(tuple(others), without, without.log_evidence, 0.1, 0.0)
        rest = [n for n in names if n != FURTHER]
        found = beside(start, model, rest, prior, overrides, say, rng, reached=w.value)
        compared = simpler.fit if simpler is not None else base
        out += [replace(t, size_m=effect_size(compared, t.fit)) for t in found if t.fit is not without]
    return out

"""The search for explanations: single effects on their grids, refits of the promising, further ones beside them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..models.effects import registered_effects
from ..models.model import Model
from .features import Features
from .frame import Frame, own_index
from .grid import Screened, moved_to, screen
from .hypotheses import VARIANTS, extended, law_of
from .noise_prior import NoisePrior
from .refit import Fit, refit, value_at
from .relabel import FURTHER, in_place_of_one, stands_in, with_stand_in_idle, within, without_stand_in
from .relocate import begun_from, relocated
from .ridge import NARROW, integrated
from .size import effect_size
from .slow_start import LIMITS, slow_start
from .weigh import HOPELESS, Weighed, escape, excess, improved, refine, widths_of

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]

#: how many hypotheses are refitted after the grid, how near in nats to the best others must come, and the least gain
_REFITTED, _NEAR, LEAST_GAIN = 6, 30.0, 1.0
#: nats that it has to promise for a second effect beside one that leaves nothing to be seen
HIDDEN = 8.0
#: nats behind the best within which an effect of several parameters is weighed along its ridge
_RIVALS = 12.0
#: standard error of an evidence from which on it is a grid's
_DOUBTFUL = 0.4
#: how often the leading ones are begun again from where they ended, and the nats that this has to bring
_AGAIN, _HELPS = 3, 0.2
#: how many are searched around, and how many of the leading ones are looked at for that
_ESCAPES, _LOOKED_AT = 5, 5
#: nats by which the leading one has to have found a better place for others to begin there, and how many do
_FOUND, _FOLLOWING = 5.0, 3
#: how far (in logs) a parameter of the base has to move for what was not refitted to be looked at again
_MOVED = 1.0
#: nats behind the leading one within which a single effect may be the first of a pair in its place, and how many
_ALIKE, _PARTNERS = 30.0, 3
#: share of what a grid promises for an effect from which on another is tried in its place, and how many are
_PROMISING, _IN_PLACE = 0.4, 5
#: share of the misfit that is left, but for so many nats, which a grid has to promise for a further effect to be fitted
_SHARE, _SMALL = 0.1, 200.0
#: share of it that may remain, once nothing better takes its place, for rivals to be weighed finely, and for a third
#: effect to be looked for: of two that are there the wrong second one takes half and less
_FINELY, REMAINS = 0.5, 0.7
#: the damping of a mass and a damper in parallel are one and the same number
SAME = {"inertia", "parallel_damper"}
#: effects that are another one at an end of their parameters: a leak acts through the resistance before it
CONTAINS = {"leakage": "series_resistance"}


def typical(base: Fit) -> Array:
    """Coordinates (d,) in the middle of the priors of the model, the rest as in a fit."""
    q = base.q.copy()
    model = base.problem.model
    d = model.dimension
    q[:d] = model.from_prior_coordinates(model.priors.transform(np.full((1, d), 0.5)))[0]
    return q


def frames_of(base: Fit, looks: list[Features], prior: NoisePrior) -> list[Frame]:
    """Where the base may be moved along from: its maximum, and its fit to what is slow."""
    slow = slow_start(base, looks, prior, [typical(base)])
    quiet = prior.start()  # the noise of a wrong model has grown
    return [Frame(replace(f, noise=quiet)) for f in (base, slow) if f is not None]


def on_grids(
    frames: list[Frame],
    common: int,
    model: Model,
    names: list[str],
    overrides: Mapping[str, object],
    say: Report,
    memory: dict[str, Screened] | None,
) -> list[Screened]:
    """All single effects on their grids; those that are limits also from the frames beyond the `common` ones."""
    found = []
    for k, name in enumerate(names):
        say("weighing hypotheses", k, len(names), name)
        own = frames if name in LIMITS else frames[:common]
        for variant in ({}, VARIANTS[name]) if name in VARIANTS else ({},):
            key = "+".join([name, *variant])
            known = memory.get(key) if memory is not None else None
            s = moved_to(known, own) if known is not None else None
            if s is None:
                m = extended(model, [name], {**overrides, **variant})
                s = screen(own, m, (name,)) if m is not None else None
            if s is not None:
                found.append(s)
                if memory is not None:
                    memory[key] = s
    return found


def refined(
    base: Fit,
    screened: list[Screened],
    prior: NoisePrior,
    say: Report,
    starts: int,
    rng: np.random.Generator,
    spoiled: Callable[[Fit], bool] | None = None,
    left: float = 0.0,
    adequate: Callable[[Fit], bool] | None = None,
) -> dict[str, Weighed] | None:
    """Refits of what the grid calls promising; the rest keep the grid's evidence and claim nothing.

    None where the first of them shows readings that are false. left: nats of misfit that further effects are looked
    for in: the grid has to promise a part of it, and what leaves most of it ends the search and is not weighed finely.
    adequate: asked of the leading fit; where it says no, another effect will be looked for beside it, and rivals are
    not weighed finely either.

    The grid moves the base linearly and errs where that is far; so refits go down its order until what it promises is
    less than what a refit has reached.
    """
    out: dict[str, Weighed] = {}
    of: dict[str, Screened] = {}
    # an effect that is in the recordings promises a third of what is left and more; a tenth, where it is one of several
    least = max(LEAST_GAIN, _SHARE * (left - _SMALL))
    reached, best = 0.0, math.inf
    for k, s in enumerate(sorted(screened, key=lambda s: -s.gain)):
        name = "+".join(s.effects)
        say("refitting", k, len(screened), name)
        promising = s.gain > least and (k < _REFITTED or s.gain > reached - _NEAR)
        # a further law of an effect has a ridge where it becomes the plain one: one descent is dear enough
        further = any(o.effects == s.effects and o.model.dimension < s.model.dimension for o in screened)
        w = refine(base, s, prior, 1 if further else starts, best) if promising else None
        if w is not None:
            best = min(best, w.value)
            reached = max(reached, base.objective - w.fit.objective)
            if k == 0 and spoiled is not None and spoiled(w.fit):
                return None
        if w is None:
            most = base.log_evidence + reached - (HOPELESS if promising and reached > HOPELESS else 0.0)
            w = Weighed(s.effects, base, min(s.log_evidence, most), 0.5, 0.0)
        w = _of_laws(w, screened)
        if name not in out or _hopeful(w, base) > _hopeful(out[name], base):
            out[name], of[name] = w, s
    settled: set[str] = set()
    before = {name: w.fit.objective for name, w in out.items()}
    for _ in range(_ESCAPES):  # the leading ones may still sit in a local maximum
        fitted = sorted((n for n, w in out.items() if w.fit is not base), key=lambda n: out[n].fit.objective)
        # of those behind, one with a mode that does the work of what it lacked before may come first without it
        doubtful = [n for n in fitted[2:_LOOKED_AT] if stands_in(out[n].fit)]
        waiting = [n for n in (*fitted[:2], *doubtful) if n not in settled]
        if not waiting:
            break
        found = escape(base, of[waiting[0]], out[waiting[0]], prior)
        elsewhere = relocated(found.fit, prior)
        if elsewhere is not found.fit:
            found = escape(base, of[waiting[0]], improved(found, base, of[waiting[0]], elsewhere), prior)
        out[waiting[0]] = found
        settled.add(waiting[0])
    refitted = sorted((n for n, w in out.items() if w.fit is not base), key=lambda n: out[n].fit.objective)
    if refitted and out[refitted[0]].fit.objective < before[refitted[0]] - _FOUND:
        for name in refitted[1 : 1 + _FOLLOWING]:
            elsewhere = begun_from(out[name].fit, out[refitted[0]].fit, prior)
            if elsewhere is not out[name].fit:
                out[name] = improved(out[name], base, of[name], elsewhere)
    if refitted:
        left_out = [s for s in screened if out["+".join(s.effects)].fit is base]
        for s, w in overlooked(base, out[refitted[0]].fit, left_out, prior, say):
            w = _of_laws(w, screened)
            if _hopeful(w, base) > _hopeful(out[w.name], base):
                out[w.name], of[w.name] = w, s
    top = max((_hopeful(w, base) for w in out.values()), default=0.0)
    for name, w in out.items():
        if w.fit is not base and _hopeful(w, base) >= top - _RIVALS:
            out[name] = _gone_on(w, base, of[name], prior)
    leading = max(out.values(), key=lambda w: _hopeful(w, base), default=None)
    if leading is None or (adequate is not None and leading.fit is not base and not adequate(leading.fit)):
        return out
    top = _hopeful(leading, base)
    for name, w in out.items():  # rivals that are near are weighed along their ridges
        own = own_index(base, of[name].model)
        if w.fit is base or _hopeful(w, base) < top - _RIVALS or own.size > 4:
            continue
        if w.log_evidence_se < _DOUBTFUL if own.size < 2 else np.all(widths_of(w.fit, own) < NARROW):
            continue
        if left > _SMALL and excess(w.fit, prior) > _FINELY * left:
            continue
        better = integrated(w.fit, own, rng, partial(_along, say, name))
        if better is not None:
            out[name] = replace(w, log_evidence=better[0] + w.shared_prior, log_evidence_se=better[1])
    return out


def _of_laws(w: Weighed, screened: Sequence[Screened]) -> Weighed:
    """A hypothesis with its share of the effect's prior: laws of one effect share it, the likelier stands for it."""
    laws = sum(o.effects == w.effects for o in screened)
    return replace(w, log_evidence=w.log_evidence - math.log(laws), shared_prior=-math.log(laws))


def overlooked(
    base: Fit, leader: Fit, waiting: Sequence[Screened], prior: NoisePrior, say: Report
) -> list[tuple[Screened, Weighed]]:
    """Hypotheses that were not refitted, from where the leading one has the base, if that is another place.

    Where a mode of the base does an effect's work, those that would do it, too, promise nothing: a sensor's lag beside
    a damper, say.
    """
    plain = stripped(leader, base.problem.model, prior)
    d = base.problem.model.dimension
    if plain is None or np.max(np.abs(plain.q[:d] - base.q[:d]), initial=0.0) < _MOVED:
        return []
    frame, reached = Frame(plain), value_at(leader.problem, leader.q, prior.start())
    found = []
    for k, s in enumerate(waiting):
        say("looking again", k, len(waiting), "+".join(s.effects))
        again = screen([frame], s.model, s.effects, sparse=True)
        if again is not None and again.gain > LEAST_GAIN:
            found.append((again.points[0].posterior, s, again.points))
    out = []
    for _, s, points in sorted(found, key=lambda f: f[0])[:_FOLLOWING]:
        w = refine(base, replace(s, points=points), prior, 1, reached)
        if w is not None:
            out.append((s, w))
    return out


def stripped(fit: Fit, model: Model, prior: NoisePrior) -> Fit | None:
    """A simpler model with the parameters that it has in a fit; not refitted. None where it has no answer there."""
    theirs = fit.problem.model
    shared = [fit.q[theirs.priors.names.index(n)] for n in model.priors.names]
    q = np.concatenate([np.array(shared), fit.q[theirs.dimension :]])
    return refit(fit.problem.with_model(model), q, prior.start(), prior, max_steps=0, fit_noise=False)


def _gone_on(w: Weighed, base: Fit, screened: Screened, prior: NoisePrior) -> Weighed:
    """The same, begun again from where it ended as long as that helps.

    A descent that follows a bent valley is damped until its next step promises nothing, far from the end of the valley.
    """
    for _ in range(_AGAIN):
        again = refit(w.fit.problem, w.fit.q, prior.start(), prior)
        if again is None or again.objective > w.fit.objective - _HELPS:
            break
        w = improved(w, base, screened, again)
    return w


def _along(say: Report, name: str, done: float, of: float, _text: str) -> None:
    say("along ridges", done, of, name)


def _hopeful(w: Weighed, base: Fit) -> float:
    """Log evidence that a hypothesis may have: a grid that is too coarse for its peak says less."""
    return w.log_evidence if w.fit is base else max(w.log_evidence, w.fit.log_evidence + w.shared_prior)


def second_thoughts(
    w: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object],
    say: Report, rng: np.random.Generator,
) -> list[Weighed]:
    """Rivals that are looked for from where an explanation stands.

    Of several effects each is left out: a fit of one alone may have ended where the other was needed; and of two the
    one found second gets another beside it. An effect that contains another is put back to that one. A mode of the base
    may have gone astray, and then a further one does its work; or it stands in for another effect (a mode far faster
    than the sampling is a damper), and then that effect is looked for in its place. Of three one may do what is left
    of an effect that contains another one of them, and then that effect is looked for in place of both.
    """
    out: list[Weighed] = []
    laws = {**overrides, **law_of(w)}
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
    if len(w.effects) > 2:
        out += [t for pair in list(out) for t in widened(pair, base, model, names, prior, laws, say)]
    if len(w.effects) == 2 and len(out) > 1:
        second = min(out[:2], key=lambda t: t.log_evidence)  # the first was the one that led alone
        out += beside_the_second(w, second, base, model, names, prior, overrides, say)
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
        found = beside(start, model, [n for n in names if n != FURTHER], prior, overrides, say, rng)
        compared = simpler.fit if simpler is not None else base
        out += [replace(t, size_m=effect_size(compared, t.fit)) for t in found if t.fit is not without]
    return out


def beside(
    best: Weighed, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object], say: Report,
    rng: np.random.Generator, adequate: Callable[[Fit], bool] | None = None, least: float = LEAST_GAIN,
) -> list[Weighed]:
    """Every further effect beside the ones found; none where the grid promises less than `least` nats for any."""
    frame = Frame(best.fit)
    found = []
    rest = [n for n in names if n not in best.effects and not any({n, e} == SAME for e in best.effects)]
    order = list(registered_effects())
    overrides = {**overrides, **law_of(best)}
    for k, name in enumerate(rest):
        effects = tuple(sorted((*best.effects, name), key=order.index))
        say("weighing pairs", k, len(rest), "+".join(effects))
        for variant in ({}, VARIANTS[name]) if name in VARIANTS else ({},):
            m = extended(model, effects, {**overrides, **variant})
            s = screen([frame], m, effects, sparse=True) if m is not None else None
            if s is not None:
                found.append(s)
    if max((s.promise for s in found), default=0.0) < least:
        return []
    left = excess(best.fit, prior)
    weighed = refined(best.fit, found, prior, say, 1, rng, left=left, adequate=adequate)
    return list((weighed or {}).values())


def widened(
    pair: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object],
    say: Report,
) -> list[Weighed]:
    """A hypothesis with an effect that contains one of its own in its place, looked for from where it stands."""
    order = list(registered_effects())
    out = []
    for wide, narrow in CONTAINS.items():
        if narrow not in pair.effects or wide in pair.effects or wide not in names:
            continue
        others = [n for n in pair.effects if n != narrow]
        bare = extended(model, others, overrides) if others else model
        plain = stripped(pair.fit, bare, prior) if bare is not None else None
        if plain is None:
            continue
        effects = tuple(sorted((*others, wide), key=order.index))
        say("leaving one out", 0, 1, "+".join(effects))
        laws = ({}, VARIANTS[wide]) if wide in VARIANTS else ({},)
        for law in laws:
            m = extended(model, effects, {**overrides, **law})
            s = screen([Frame(plain)], m, effects) if m is not None else None
            w = refine(plain, s, prior, 2) if s is not None else None
            if w is not None:
                # the grid around a place that is not its own maximum says little of the evidence
                known = w.fit.log_evidence - math.log(len(laws))
                out.append(replace(w, log_evidence=known, log_evidence_se=0.1, size_m=effect_size(base, w.fit)))
    return out


def beside_the_second(
    pair: Weighed, alone: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior,
    overrides: Mapping[str, object], say: Report,
) -> list[Weighed]:
    """Pairs of the effect that was found second with another than the one found first.

    What leads alone does some of the second one's work, too; beside that one another may do better.
    alone: the second effect of `pair`, fitted without the first.
    """
    frame = Frame(alone.fit)
    order = list(registered_effects())
    overrides = {**overrides, **law_of(alone)}
    found = []
    for name in names:
        if name in alone.effects or any({name, e} == SAME for e in alone.effects):
            continue
        effects = tuple(sorted((*alone.effects, name), key=order.index))
        m = extended(model, effects, overrides)
        s = screen([frame], m, effects, sparse=True) if m is not None else None
        if s is not None:
            found.append(s)
    # what the grid promises is compared with what it promises for the one that was found, not with what that reached
    least = _PROMISING * next((s.gain for s in found if s.effects == pair.effects), math.inf)
    likely = [s for s in sorted(found, key=lambda s: -s.gain) if s.effects != pair.effects and s.gain > max(least, 1.0)]
    out = []
    for k, s in enumerate(likely[:_IN_PLACE]):
        say("weighing pairs", k, len(likely), "+".join(s.effects))
        w = refine(alone.fit, s, prior, 1, pair.value)
        if w is not None:
            out.append(replace(w, size_m=effect_size(base, w.fit)))
    return out


def freed(w: Weighed, prior: NoisePrior) -> Weighed | None:
    """An explanation with the mode idle that stands in for something else, which can then be looked for beside it.

    None where there is no such mode, or a further one is among its effects (`second_thoughts` looks there).
    """
    idle = with_stand_in_idle(w, prior) if FURTHER not in w.effects else None
    return None if idle is None else replace(w, fit=idle, log_evidence=idle.log_evidence)


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
        if len(w.effects) == 1 and w.effects != first.effects and w.log_evidence > first.log_evidence - _ALIKE
    ]
    alike = sorted(alike, key=lambda w: -w.log_evidence)[:_PARTNERS]
    out: list[Weighed] = []
    if not free and alike and max(w.log_evidence for w in pairs) < first.log_evidence + _FOUND:
        first = alike.pop(0)
        pairs = beside(first, model, names, prior, overrides, say, rng)
        out += pairs
    top = max((w.log_evidence for w in pairs), default=0.0)
    seconds = [
        next(n for n in w.effects if n not in first.effects)
        for w in sorted(pairs, key=lambda w: -w.log_evidence)[:_PARTNERS]
        if w.log_evidence > top - _RIVALS
    ]
    for other in alike:
        rest = [n for n in seconds if n not in other.effects]
        start = freed(other, prior) if free else None
        if start is None:
            out += beside(other, model, rest, prior, overrides, say, rng)
        else:
            found = beside(start, model, rest, prior, overrides, say, rng)
            out += [replace(t, size_m=effect_size(other.fit, t.fit)) for t in found if t.fit is not start.fit]
    return out

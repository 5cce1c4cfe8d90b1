"""The search for explanations: effects on their grids, refits of the promising ones, and what those overlooked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.descent import value_at
from ...gauss_newton.laws import laws_of_effect
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from ..where.features import Features
from .frame import Frame, own_index
from .grid import Screened, moved_to, screen
from .hypotheses import extended
from .quest import Quest, Report
from .relabel import stands_in
from .relocate import begun_from, relocated
from .ridge import NARROW, integrated
from .slow_start import LIMITS, driven_start, slow_start
from .weigh import HOPELESS, Weighed, escape, excess, improved, refine, widths_of

Array = NDArray[np.float64]

#: how many hypotheses are refitted after the grid, how near in nats to the best others must come, and the least gain
_REFITTED, _NEAR, LEAST_GAIN = 6, 30.0, 1.0
MASS = "inertia"
#: effects that are dear to simulate beside others: what they do bends, or depends on what was before
DEAR = {MASS, "amplitude_softening", "mullins_softening", "rate_independent_hysteresis"}
#: what charges the dielectric slowly: before a mass or what remembers, each step has to follow both
CHARGES = {"series_resistance", "leakage"}
#: what takes several times as long as others to simulate, most parameters included
_COSTLY = DEAR | {"leakage"}
#: nats behind the best within which an effect of several parameters is weighed along its ridge
RIVALS = 12.0
#: parameters of an effect that a ridge is followed in, at most
_RIDGES = 4
#: nats behind its base at which a further effect is not looked around for any more
_NO_BETTER = 1.0
#: standard error of an evidence from which on it is a grid's
_DOUBTFUL = 0.4
#: how often the leading ones are begun again from where they ended, and the nats that this has to bring
_AGAIN, _HELPS = 3, 0.2
#: how many are searched around, and how many of the leading ones are looked at for that
_ESCAPES, _LOOKED_AT = 5, 5
#: nats by which the leading one has to have found a better place for others to begin there, and how many do
FOUND, _FOLLOWING = 5.0, 3
#: how far (in logs) a parameter of the base has to move for what was not refitted to be looked at again
_MOVED = 1.0
#: share of the misfit that is left, but for so many nats, which a grid has to promise for a further effect to be fitted
SHARE, SMALL = 0.1, 200.0
#: the same for a mass beside others, whose peak is far narrower than the steps of a grid
_RINGS = 0.03
#: share of it that may remain, once nothing better takes its place, for rivals to be weighed finely, and for a third
#: effect to be looked for: of two that are there the wrong second one takes half and less
_FINELY, REMAINS = 0.5, 0.7


def too_dear(effects: Sequence[str]) -> bool:
    """Whether two effects together take so long to simulate that a third one is not looked for beside them.

    A tenth of a second, and some thousand times of it.
    """
    dear = len(DEAR.intersection(effects))
    return dear > 1 or (dear == 1 and bool(CHARGES.intersection(effects)))


def typical(base: Fit) -> Array:
    """Coordinates (d,) in the middle of the priors of the model, the rest as in a fit."""
    q = base.q.copy()
    model = base.problem.model
    d = model.dimension
    q[:d] = model.from_prior_coordinates(model.priors.transform(np.full((1, d), 0.5)))[0]
    return q


def frames_of(base: Fit, looks: list[Features], prior: NoisePrior) -> list[Frame]:
    """Where the base may be moved along from: its maximum, and its fits to what is slow and to what a voltage drove."""
    starts = {
        "": base,
        "slow": slow_start(base, looks, prior, [typical(base)]),
        "driven": driven_start(base, prior, [typical(base)]),
    }
    quiet = prior.start()  # the noise of a wrong model has grown
    return [Frame(replace(f, noise=quiet), kind=kind) for kind, f in starts.items() if f is not None]


def on_grids(
    frames: list[Frame], common: int, quest: Quest, memory: dict[str, Screened] | None = None
) -> list[Screened]:
    """All single effects on their grids; those that are limits also from the frames beyond the `common` ones."""
    found = []
    for k, name in enumerate(quest.names):
        quest.say("weighing hypotheses", k, len(quest.names), name)
        own = frames if name in LIMITS else frames[:common]
        for variant in laws_of_effect(name):
            key = "+".join([name, *variant])
            known = memory.get(key) if memory is not None else None
            s = moved_to(known, own) if known is not None else None
            if s is None:
                m = extended(quest.model, [name], quest.by(variant).given)
                s = screen(own, m, (name,)) if m is not None else None
            if s is not None:
                found.append(s)
                if memory is not None:
                    memory[key] = s
    return found


def refined(
    base: Fit,
    screened: list[Screened],
    quest: Quest,
    starts: int = 1,
    look: Callable[[Fit], None] | None = None,
    left: float = 0.0,
    best: float = math.inf,
    least: float = LEAST_GAIN,
) -> dict[str, Weighed]:
    """Refits of what the grid calls promising; the rest keep the grid's evidence and claim nothing.

    base: the fit that they were screened beside, with effects of its own or none. look: is shown the first of them.
    left: nats of misfit that further effects are looked for in: the grid has to promise a part of it, and what leaves
    most of it ends the search and is not weighed finely. Where the quest says of the leading fit that it is not
    adequate, another effect will be looked for beside it, and rivals are not weighed finely either. best: the value
    (see `Weighed`) of the best of others, which these have to come near. least: nats that the grid has to promise.

    The grid moves the base linearly and errs where that is far; so refits go down its order until what it promises is
    less than what a refit has reached.
    """
    prior, say = quest.prior, quest.say
    out: dict[str, Weighed] = {}
    of: dict[str, Screened] = {}
    reached, taken, elsewhere_reached = 0.0, 0.0, best
    half, there = 0.5 * sum(p.blocks.n for p in base.problem.pieces), set(base.problem.model.spec.effects)
    for k, s in enumerate(_in_order(base, screened)):
        name = "+".join(s.effects)
        say("refitting", k, len(screened), name)
        promising = s.gain > max(least, asked_of(s, there, left)) and (k < _REFITTED or s.gain > taken - _NEAR)
        # a further law of an effect has a ridge where it becomes the plain one: one descent is dear enough
        further = any(o.effects == s.effects and o.model.dimension < s.model.dimension for o in screened)
        # what is costly and leaves most is no part of an explanation, and takes minutes to look around in
        most = half + REMAINS * left if left > SMALL and _COSTLY.intersection(s.effects) - there else math.inf
        w = refine(base, s, prior, 1 if further else starts, best, at_most=most) if promising else None
        if w is not None:
            best = min(best, w.value)
            reached = max(reached, base.objective - w.fit.objective)
            # at the noise that the grid has: that of a base may have grown
            taken = max(taken, s.base_objective - w.value)
            if k == 0 and look is not None:
                look(w.fit)
        if w is None:
            highest = base.log_evidence + reached - (HOPELESS if promising and reached > HOPELESS else 0.0)
            w = Weighed(s.effects, base, min(s.log_evidence, highest), 0.5, 0.0)
        w = of_laws(w, screened)
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
        name, leader = waiting[0], out[fitted[0]].fit
        found = escape(base, of[name], out[name], prior)
        # every mode on every time constant takes a minute of what is dear: behind a leader it begins where that stands
        follows = found.fit.objective > leader.objective and bool(base.problem.model.spec.effects) and _dear(name)
        if _dear(name) and found.value > elsewhere_reached - LEAST_GAIN:
            # nor is it worth that where others do as well; if it comes near, it is fitted from their base in the end
            elsewhere = found.fit
        else:
            elsewhere = begun_from(found.fit, leader, prior) if follows else relocated(found.fit, prior)
        if elsewhere is not found.fit:
            found = escape(base, of[name], improved(found, base, of[name], elsewhere), prior)
        out[name] = found
        # what comes to lead is looked at as leaders are
        if not follows or found.fit.objective > leader.objective:
            settled.add(name)
    refitted = sorted((n for n, w in out.items() if w.fit is not base), key=lambda n: out[n].fit.objective)
    if refitted and out[refitted[0]].fit.objective < before[refitted[0]] - FOUND:
        for name in refitted[1 : 1 + _FOLLOWING]:
            elsewhere = begun_from(out[name].fit, out[refitted[0]].fit, prior)
            if elsewhere is not out[name].fit:
                out[name] = improved(out[name], base, of[name], elsewhere)
    if refitted:
        left_out = [s for s in screened if out["+".join(s.effects)].fit is base]
        for s, w in overlooked(base, out[refitted[0]].fit, left_out, quest):
            w = of_laws(w, screened)
            if _hopeful(w, base) > _hopeful(out[w.name], base):
                out[w.name], of[w.name] = w, s
    top = max((_hopeful(w, base) for w in out.values()), default=0.0)
    near = [name for name, w in out.items() if _adds(w, base) and _hopeful(w, base) >= top - RIVALS]
    # behind a leader that another effect is looked for beside, what is dear need not be known to the last nat
    near = sorted(near, key=lambda n: -_hopeful(out[n], base))
    judged: list[tuple[Fit, bool]] = []

    def enough(fit: Fit) -> bool:
        if not any(f is fit for f, _ in judged):
            judged.append((fit, quest.adequate is None or fit is base or quest.adequate(fit)))
        return next(yes for f, yes in judged if f is fit)

    for name in near:
        if name == near[0] or not DEAR.intersection(of[name].effects) - there or enough(out[near[0]].fit):
            out[name] = _gone_on(out[name], base, of[name], prior)
    leading = max(out.values(), key=lambda w: _hopeful(w, base), default=None)
    if leading is None or not enough(leading.fit):
        return out
    top = _hopeful(leading, base)
    for name, w in out.items():  # rivals that are near are weighed along their ridges
        own = own_index(base, of[name].model)
        if w.fit is base or _hopeful(w, base) < top - RIVALS or own.size > _RIDGES:
            continue
        if w.log_evidence_se < _DOUBTFUL if own.size < 2 else np.all(widths_of(w.fit, own) < NARROW):
            continue
        if left > SMALL and excess(w.fit, prior) > _FINELY * left:
            continue
        better = integrated(w.fit, own, quest.rng, partial(_along, say, name))
        if better is not None:
            out[name] = replace(w, log_evidence=better[0] + w.shared_prior, log_evidence_se=better[1])
    return out


def asked_of(s: Screened, there: Collection[str], left: float) -> float:
    """Nats that a grid has to promise of `left` for an effect to be fitted beside those that are `there`.

    An effect that is in the recordings promises a third of what is left and more; a tenth, where it is one of several.
    """
    return (_RINGS if MASS in s.effects and MASS not in there else SHARE) * (left - SMALL)


def _dear(name: str) -> bool:
    """Whether something that is dear to simulate is among the effects of a name."""
    return bool(DEAR.intersection(name.split("+")))


def _in_order(base: Fit, screened: Sequence[Screened]) -> list[Screened]:
    """Hypotheses by what the grid promises; of those that are fitted in any case, beside others, the dear ones last.

    What stays far behind the best so far is soon given up.
    """
    order = sorted(screened, key=lambda s: -s.gain)
    if not base.problem.model.spec.effects:
        return order
    return sorted(order[:_REFITTED], key=lambda s: len(DEAR.intersection(s.effects))) + order[_REFITTED:]


def of_laws(w: Weighed, screened: Sequence[Screened]) -> Weighed:
    """A hypothesis with its share of the effect's prior: laws of one effect share it, the likelier stands for it."""
    laws = sum(o.effects == w.effects for o in screened)
    return replace(w, log_evidence=w.log_evidence - math.log(laws), shared_prior=-math.log(laws))


def overlooked(
    base: Fit, leader: Fit, waiting: Sequence[Screened], quest: Quest
) -> list[tuple[Screened, Weighed]]:
    """Hypotheses that were not refitted, from where the leading one has the base, if that is another place.

    Where a mode of the base does an effect's work, those that would do it, too, promise nothing: a sensor's lag beside
    a damper, say.
    """
    prior = quest.prior
    plain = stripped(leader, base.problem.model, prior)
    d = base.problem.model.dimension
    if plain is None or np.max(np.abs(plain.q[:d] - base.q[:d]), initial=0.0) < _MOVED:
        return []
    frame, reached = Frame(plain), value_at(leader.problem, leader.q, prior.start())
    found = []
    for k, s in enumerate(waiting):
        quest.say("looking again", k, len(waiting), "+".join(s.effects))
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
        again = refit(w.fit.problem, w.fit.q, prior.start(), prior, known=w.fit.linearisation)
        if again is None or again.objective > w.fit.objective - _HELPS:
            break
        w = improved(w, base, screened, again)
    return w


def _along(say: Report, name: str, done: float, of: float, _text: str) -> None:
    say("along ridges", done, of, name)


def _adds(w: Weighed, base: Fit) -> bool:
    """Whether a refit may be better than its base; beside other effects what is not costs more than it tells."""
    if w.fit is base:
        return False
    return not base.problem.model.spec.effects or _hopeful(w, base) > base.log_evidence - _NO_BETTER


def _hopeful(w: Weighed, base: Fit) -> float:
    """Log evidence that a hypothesis may have: a grid that is too coarse for its peak says less."""
    return w.log_evidence if w.fit is base else max(w.log_evidence, w.fit.log_evidence + w.shared_prior)

"""The search for explanations: effects on their grids, refits of the promising ones, and what those overlooked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
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
from .frame import Frame, own_index, trusted
from .grid import Screened, moved_to, screen
from .hypotheses import extended
from .quest import Quest, Report
from .relocate import begun_from, relocated, stands_in
from .ridge import NARROW, integrated
from .slow_start import LIMITS, driven_start, sized_start, slow_start
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
#: the same of two effects beside which no third one is looked for, but for a shift of the readings
_OF_TWO_DEAR = 0.4


def too_dear(effects: Sequence[str]) -> bool:
    """Whether two effects together take so long to simulate that a third one is not looked for beside them.

    A shift of the readings is: it costs nothing.
    A tenth of a second, and some thousand times of it.
    """
    dear = len(DEAR.intersection(effects))
    return dear > 1 or (dear == 1 and bool(CHARGES.intersection(effects)))


def typical(base: Fit, of: Model | None = None) -> Array:
    """Coordinates (d,) in the middle of the priors of the model, the rest as in a fit. of: whose parameters alone."""
    q = base.q.copy()
    model = base.problem.model
    names = (of or model).priors.names
    own = [i for i, n in enumerate(model.priors.names) if n in names]
    q[own] = model.middle()[own]
    return q


def frames_of(base: Fit, looks: list[Features], prior: NoisePrior) -> list[Frame]:
    """Where the base may be moved along from: its maximum, and its fits to what is slow, to what a voltage drove, and
    to readings as large as the sensor states."""
    starts = {
        "": base,
        "slow": slow_start(base, looks, prior, [typical(base)]),
        "driven": driven_start(base, prior, [typical(base)]),
        "sized": sized_start(base, prior, [typical(base)]),
    }
    quiet = prior.start()  # the noise of a wrong model has grown
    return [Frame(replace(f, noise=quiet), kind=kind) for kind, f in starts.items() if f is not None]


def settled(base: Fit, frames: Sequence[Frame], prior: NoisePrior) -> Fit:
    """The base, or a better fit of the same model that begins where one of its frames promises one.

    Readings that were taken out may have driven a mode to where no descent leads back from, and whatever was weighed
    beside that would have found what the base itself should have.
    """
    best, here = base, frames[0].value(frames[0].fit.clean)[0]
    for frame in frames[1:]:
        value, move = frame.value(frame.fit.clean)
        if not value < here - LEAST_GAIN:
            continue
        again = refit(base.problem, frame.fit.q + trusted(move), prior.start(), prior)
        if again is not None and again.objective < best.objective - LEAST_GAIN:
            best = again
    return best


def on_grids(
    frames: list[Frame], common: int, quest: Quest, memory: dict[str, Screened] | None = None
) -> list[Screened]:
    """All single effects on their grids; those that are limits also from the frames beyond the `common` ones."""
    found = []
    for k, name in enumerate(quest.names):
        quest.say("weighing hypotheses", k, len(quest.names), name)
        own = frames if name in LIMITS else frames[:common]
        for variant in laws_of_effect(name, quest.given):
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
    refits = _Refits(base, screened, quest, left)
    refits.fit(starts, look, best, least)
    found_at = refits.climb(best)
    refits.follow(found_at)
    refits.look_again()
    refits.go_on()
    refits.along_ridges()
    return refits.out


class _Refits:
    """Hypotheses by name as far as they have been weighed, and the grids that they come from."""

    def __init__(self, base: Fit, screened: list[Screened], quest: Quest, left: float) -> None:
        self.base, self.screened, self.quest, self.left = base, screened, quest, left
        self.prior = quest.prior
        self.out: dict[str, Weighed] = {}
        self._of: dict[str, Screened] = {}
        self._there = set(base.problem.model.spec.effects)
        self._judged: list[tuple[Fit, bool]] = []

    def fit(self, starts: int, look: Callable[[Fit], None] | None, best: float, least: float) -> None:
        """Refits down the order of the grids; see `refined`."""
        reached, taken = 0.0, 0.0
        for k, s in enumerate(_in_order(self.base, self.screened)):
            self.quest.say("refitting", k, len(self.screened), "+".join(s.effects))
            asked = max(least, asked_of(s, self._there, self.left))
            wanted = s.gain > asked
            promising = wanted and (k < _REFITTED or s.gain > taken - _NEAR)
            # a further law of an effect has a ridge where it becomes the plain one: one descent is dear enough
            further = any(o.effects == s.effects and o.model.dimension < s.model.dimension for o in self.screened)
            most = self._most(s)
            w = None
            if promising:
                once = too_dear(s.effects)
                w = refine(self.base, s, self.prior, 1 if further else starts, best, at_most=most, once=once)
            elif not wanted and self._may_be_between(s):
                w = refine(self.base, s, self.prior, starts, best, at_most=min(most, s.base_objective - asked))
            if w is not None:
                best = min(best, w.value)
                reached = max(reached, self.base.objective - w.fit.objective)
                # at the noise that the grid has: that of a base may have grown
                taken = max(taken, s.base_objective - w.value)
                if k == 0 and look is not None:
                    look(w.fit)
            else:
                highest = self.base.log_evidence + reached - (HOPELESS if promising and reached > HOPELESS else 0.0)
                w = Weighed(s.effects, self.base, min(s.log_evidence, highest), 0.5, 0.0)
            self._take(s, w)

    def _most(self, s: Screened) -> float:
        """The value (see `Weighed`) above which a hypothesis is given up.

        What is costly and leaves most is no part of an explanation, and takes minutes to look around in. Beside two
        that are dear none but a shift of the readings is looked for: they explain most of it, or they do not.
        """
        if self.left <= SMALL or not _COSTLY.intersection(s.effects) - self._there:
            return math.inf
        remains = _OF_TWO_DEAR if too_dear(s.effects) else REMAINS
        return 0.5 * sum(p.blocks.n for p in self.base.problem.pieces) + remains * self.left

    def _may_be_between(self, s: Screened) -> bool:
        """Whether a descent from the best points is to say if an effect lies between those of its grid.

        What is known far better than they are apart looks worse than none at each of them (a mass damped well, by a
        sensor to which a tenth of a millisecond is much). For what has one parameter the grid itself looks between
        them. Beside other effects a descent each takes too long (3 to 13 s a campaign), but for a mass beside what is
        quick to simulate.
        """
        alone = not self._there or (MASS in s.effects and not (DEAR | CHARGES).intersection(self._there))
        return alone and own_index(self.base, s.model).size > 1

    def climb(self, elsewhere_reached: float) -> dict[str, float]:
        """The leading ones may still sit in a local maximum. Given are the objectives that all had before."""
        settled: set[str] = set()
        before = {name: w.fit.objective for name, w in self.out.items()}
        for _ in range(_ESCAPES):
            fitted = self._fitted()
            # of those behind, one with a mode that does the work of what it lacked before may come first without it
            doubtful = [n for n in fitted[2:_LOOKED_AT] if stands_in(self.out[n].fit)]
            waiting = [n for n in (*fitted[:2], *doubtful) if n not in settled]
            if not waiting:
                break
            name, leader = waiting[0], self.out[fitted[0]].fit
            found, follows = self._climbed(name, leader, elsewhere_reached)
            self.out[name] = found
            # what comes to lead is looked at as leaders are
            if not follows or found.fit.objective > leader.objective:
                settled.add(name)
        return before

    def _climbed(self, name: str, leader: Fit, elsewhere_reached: float) -> tuple[Weighed, bool]:
        """A hypothesis out of the local maximum that it may sit in, and whether it was begun from the leader's base."""
        base, grid = self.base, self._of[name]
        found = escape(base, grid, self.out[name], self.prior)
        # every mode on every time constant takes a minute of what is dear: behind a leader it begins where that stands
        follows = found.fit.objective > leader.objective and bool(self._there) and _dear(name)
        if _dear(name) and found.value > elsewhere_reached - LEAST_GAIN:
            # nor is it worth that where others do as well; if it comes near, it is fitted from their base in the end
            elsewhere = found.fit
        else:
            elsewhere = begun_from(found.fit, leader, self.prior) if follows else relocated(found.fit, self.prior)
        if elsewhere is not found.fit:
            found = escape(base, grid, improved(found, base, grid, elsewhere), self.prior)
        return found, follows

    def follow(self, before: Mapping[str, float]) -> None:
        """Where the leading one has found a far better place for the base, others begin there, too."""
        fitted = self._fitted()
        if not fitted or self.out[fitted[0]].fit.objective >= before[fitted[0]] - FOUND:
            return
        for name in fitted[1 : 1 + _FOLLOWING]:
            elsewhere = begun_from(self.out[name].fit, self.out[fitted[0]].fit, self.prior)
            if elsewhere is not self.out[name].fit:
                self.out[name] = improved(self.out[name], self.base, self._of[name], elsewhere)

    def look_again(self) -> None:
        """What was not refitted, from where the leading one has the base."""
        fitted = self._fitted()
        if not fitted:
            return
        left_out = [s for s in self.screened if self.out["+".join(s.effects)].fit is self.base]
        for s, w in overlooked(self.base, self.out[fitted[0]].fit, left_out, self.quest, self._most):
            self._take(s, w)

    def go_on(self) -> None:
        """Those near the leading one to their ends.

        Behind a leader that another effect is looked for beside, what is dear need not be known to the last nat.
        """
        top = max((self._hope(n) for n in self.out), default=0.0)
        near = [n for n, w in self.out.items() if _adds(w, self.base) and self._hope(n) >= top - RIVALS]
        near = sorted(near, key=lambda n: -self._hope(n))
        for name in near:
            grid, leader = self._of[name], self.out[near[0]].fit
            if name == near[0] or not DEAR.intersection(grid.effects) - self._there or self._is_enough(leader):
                self.out[name] = _gone_on(self.out[name], self.base, grid, self.prior, not self._is_enough(leader))

    def along_ridges(self) -> None:
        """Rivals that are near are weighed along their ridges, where no further effect is looked for."""
        leading = max(self.out, key=self._hope, default=None)
        if leading is None or not self._is_enough(self.out[leading].fit):
            return
        top = self._hope(leading)
        for name, w in self.out.items():
            own = own_index(self.base, self._of[name].model)
            if w.fit is self.base or self._hope(name) < top - RIVALS or own.size > _RIDGES:
                continue
            if w.log_evidence_se < _DOUBTFUL if own.size < 2 else np.all(widths_of(w.fit, own) < NARROW):
                continue
            if self.left > SMALL and excess(w.fit, self.prior) > _FINELY * self.left:
                continue
            better = integrated(w.fit, own, self.quest.rng, partial(_along, self.quest.say, name))
            if better is not None:
                self.out[name] = replace(w, log_evidence=better[0] + w.shared_prior, log_evidence_se=better[1])

    def _take(self, s: Screened, w: Weighed) -> None:
        """Keep a hypothesis of a grid, where no other law of its effect explains more."""
        name = "+".join(s.effects)
        w = of_laws(w, self.screened)
        if name not in self.out or _hopeful(w, self.base) > self._hope(name):
            self.out[name], self._of[name] = w, s

    def _fitted(self) -> list[str]:
        """Names of what was refitted, the best first."""
        names = (n for n, w in self.out.items() if w.fit is not self.base)
        return sorted(names, key=lambda n: self.out[n].fit.objective)

    def _hope(self, name: str) -> float:
        return _hopeful(self.out[name], self.base)

    def _is_enough(self, fit: Fit) -> bool:
        """Whether a fit leaves nothing that a further effect is looked for in; asked once of each."""
        for known, enough in self._judged:
            if known is fit:
                return enough
        enough = self.quest.adequate is None or fit is self.base or self.quest.adequate(fit)
        self._judged.append((fit, enough))
        return enough


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
    base: Fit, leader: Fit, waiting: Sequence[Screened], quest: Quest,
    most: Callable[[Screened], float] = lambda _: math.inf,
) -> list[tuple[Screened, Weighed]]:
    """Hypotheses that were not refitted, from where the leading one has the base, if that is another place.

    Where a mode of the base does an effect's work, those that would do it, too, promise nothing: a sensor's lag beside
    a damper, say. most: the value above which each is given up.
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
        w = refine(base, replace(s, points=points), prior, 1, reached, at_most=most(s))
        if w is not None:
            out.append((s, w))
    return out


def stripped(fit: Fit, model: Model, prior: NoisePrior) -> Fit | None:
    """A simpler model with the parameters that it has in a fit; not refitted. None where it has no answer there."""
    theirs = fit.problem.model
    shared = [fit.q[theirs.priors.names.index(n)] for n in model.priors.names]
    q = np.concatenate([np.array(shared), fit.q[theirs.dimension :]])
    return refit(fit.problem.with_model(model), q, prior.start(), prior, max_steps=0, fit_noise=False)


def _gone_on(w: Weighed, base: Fit, screened: Screened, prior: NoisePrior, coarse: bool) -> Weighed:
    """The same, begun again from where it ended as long as that helps. coarse: see `refit`.

    A descent that follows a bent valley is damped until its next step promises nothing, far from the end of the valley.
    """
    for _ in range(_AGAIN):
        again = refit(w.fit.problem, w.fit.q, prior.start(), prior, known=w.fit.linearisation, coarse=coarse)
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

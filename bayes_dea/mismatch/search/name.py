"""Which physics was left out: a search over every hypothesis, "none" and "unknown" among them.

Single effects first; where the best of them is not adequate, a second one (and a third) beside it. "unknown" is a
smooth discrepancy beside the best named explanation. Prior odds stand in priors/diagnosis/hypotheses.toml.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...campaign.schema import Campaign
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ..where.discrepancy import basis, discrepancy
from ..where.features import Features
from ..where.locate import Places, is_adequate, places_of, scan
from ..where.size import effect_size
from .beside import beside, promised_beside, together, top_of
from .containing import containing
from .damper_or_lag import damper_or_lag
from .elements import counted
from .exchanged import exchanged
from .frame import Frame
from .grid import Screened
from .hypotheses import DELAY, candidates, effect_priors, extended, prior_odds
from .in_its_place import alike
from .known import SLIGHT, Known, shares
from .mass_read_late import mass_read_early_or_late
from .naming import (
    WORTH_LABELLING,
    Explanation,
    Naming,
    but_for_what_is_too_small,
    explain,
    log_probabilities,
    with_adequacy,
)
from .pairs import (
    PARTNERS,
    behind_more,
    beside_the_leader,
    beside_the_next,
    freed,
    helped_elsewhere,
    in_place_of_the_first,
)
from .promising import FOUND, LEAST_GAIN, REMAINS, frames_of, on_grids, refined, settled, too_dear, typical
from .quest import Quest, Report, unheard
from .relabel import FURTHER, in_place_of_one, labellings
from .rivals import CROSSED, again, from_the_leader, put_right
from .second_thoughts import merged, second_thoughts
from .shifted import (
    damped_and_shifted,
    either_read_early_or_late,
    pairs_read_early_or_late,
    read_early_or_late,
    shifted_rivals,
)
from .slow_start import LIMITS, low_start
from .weigh import Weighed, excess
from .work_of_a_mode import instead_of_a_mode

Array = NDArray[np.float64]

#: nats that can be seen: by which an effect's likelihood varies over its grid, or a discrepancy is better than none
_VISIBLE = 5.0
#: nats that a grid has to promise for a second effect beside one that leaves nothing to be seen
HIDDEN = 8.0
#: share of what is left that a grid promises for an effect which is in the recordings, at least
_PROMISES = 1.0 / 3.0
#: share of the evidence of another reading that a grid, coarse as it is, has to promise for a further effect to be a
#: rival of that
NEARLY = 0.75
#: share of the misfit that is left which a further effect has to take away for another one to be looked for after it
_STEP = 0.05
#: what another hold convention may pass for
_LATE_BY_A_SAMPLE = (DELAY, "sensor_lag", "series_resistance")
#: nats behind the likeliest within which others are known of when a search begins anew
RIVAL = 30.0


@dataclass(frozen=True)
class Brief:
    """What is asked of a search, whatever the fit that it begins with.

    overrides: priors that the user gives; established: effects that the readings show by themselves; unseen: recordings
    to validate, of which the commands alone are used: an effect is as large as on the recording of the campaign that it
    moves most (CONTRACT 1).
    """

    campaign: Campaign
    prior: NoisePrior
    resolution_m: float
    overrides: Mapping[str, object] = field(default_factory=dict)
    most_effects: int = 3
    established: tuple[str, ...] = ()
    unseen: tuple[Piece, ...] = ()
    say: Report = unheard


@dataclass(frozen=True)
class Spoiled:
    """What ended a search: a fit that shows readings which are false. known: several effects together that led until
    then and their rivals, to begin the next search with: those of single effects are soon found again."""

    known: tuple[Fit, ...] = ()


@dataclass(frozen=True)
class ReadOtherwise:
    """What ended a search: under another reading of the recordings nothing is left, and no effect promises as much."""


@dataclass(frozen=True)
class _Singles:
    """Single effects weighed beside a base: what a search goes on from. given: the base before it was looked at."""

    given: Fit
    frames: list[Frame]
    columns: list[Array]
    places: Places
    none: Explanation
    skipped: dict[str, str]
    quest: Quest
    found: list[Screened]
    weighed: dict[str, Weighed]


@dataclass
class Memory:
    """What searches of recordings, as they are read, know of single effects: on their grids, and weighed in the end."""

    grids: dict[str, Screened] = field(default_factory=dict)
    singles: _Singles | None = None


class _SpoiledError(Exception):
    """A fit has shown readings that are false."""


def name_physics(
    base: Fit,
    looks: list[Features],
    brief: Brief,
    rng: np.random.Generator,
    *,
    spoiled: Callable[[Fit], bool] | None = None,
    memory: Memory | None = None,
    begun: Sequence[Fit] = (),
    otherwise: Callable[[Fit], float] = lambda _: 0.0,
    settled_by: Callable[[Fit], float] = lambda _: 0.0,
) -> Naming | Spoiled | ReadOtherwise:
    """Weigh all hypotheses on the recordings to identify.

    otherwise: nats of evidence that another reading of the recordings would bring to an explanation. Further effects
    are looked for only where a grid promises nearly as much; else they are sought under that reading first, and are put
    off where the grid promises a third of it.

    settled_by: the same of another reading under which the base leaves nothing; asked before any effect is fitted.

    memory: single effects as an earlier search left them; filled in. begun: explanations from another
    reading of the recordings, as what a search may miss that has to begin anew.

    spoiled: asked of the fits that may explain the recordings, before they are judged; where it says yes, the data are
    to be made clean first, and what is known so far is returned.
    """
    memory = memory or Memory()

    def look(fit: Fit) -> None:
        if spoiled is not None and spoiled(fit):
            raise _SpoiledError

    first = memory.singles
    if first is None or first.given is not base:
        try:
            first = _weighed_alone(base, looks, brief, rng, memory.grids, look, settled_by)
        except _SpoiledError:
            return Spoiled(tuple(begun))
        if first is None:
            return ReadOtherwise()
        memory.singles = first
    frames, none, quest, singles, columns = first.frames, first.none, first.quest, first.weighed, first.columns
    search = _Search(quest, brief, none, first.places, columns, dict(singles), look, otherwise, frames)
    search.known.take_from_elsewhere(again(begun, quest.base, brief.prior))
    try:
        search.run()
    except _SpoiledError:
        led = search.together()
        ahead = {f.problem.model.name for f in led}
        return Spoiled((*led, *(f for f in begun if f.problem.model.name not in ahead)))
    visible = tuple("+".join(s.effects) for s in first.found if s.contrast > _VISIBLE)
    return search.naming(first.skipped, visible)


def _weighed_alone(
    base: Fit, looks: list[Features], brief: Brief, rng: np.random.Generator, grids: dict[str, Screened],
    look: Callable[[Fit], None], settled_by: Callable[[Fit], float],
) -> _Singles | None:
    """Single effects on their grids, and fitted where that is promising; None where another reading settles it first.
    """
    given = base
    brief.say("finding starts", 0, 3, "slow waves and plateaus")
    frames = frames_of(base, looks, brief.prior)
    better = settled(base, frames, brief.prior)
    if better is not base:
        base, frames = better, frames_of(better, looks, brief.prior)
    columns, places = basis(base, looks), places_of(base.problem.pieces, rng, looks)
    brief.say("finding starts", 1, 3, "what is left")
    none = Explanation(Weighed((), base, base.log_evidence, 0.1, 0.0), scan(base, rng, places))
    names, skipped = candidates(
        base.problem.model, brief.campaign, {p.channel for p in base.problem.pieces}, brief.established
    )
    laws: dict[str, object] = {**effect_priors(names, brief.campaign), **brief.overrides}
    quest = Quest(base, tuple(names), laws, brief.prior, rng, brief.say, lambda fit: is_adequate(fit, rng, places))
    limited = [] if none.adequate else _from_the_lower_half(quest)
    found = on_grids([*frames, *limited], len(frames), quest, grids)
    taken = 0.0 if none.adequate else settled_by(base)
    if taken > 0.0 and max((s.promise for s in found), default=0.0) < NEARLY * taken:
        return None
    weighed = refined(base, found, quest, 2, look)
    if none.adequate:
        for w in instead_of_a_mode(base, quest):
            if w.name not in weighed or w.log_evidence > weighed[w.name].log_evidence:
                weighed[w.name] = w
    return _Singles(given, frames, columns, places, none, skipped, quest, found, weighed)


def _from_the_lower_half(quest: Quest) -> list[Frame]:
    """Where the base may be moved along from where a limit cuts off what lies above; none where nothing may be one."""
    if not any(n in LIMITS for n in quest.names):
        return []
    quest.say("finding starts", 2, 3, "the lower half of the range")
    base = quest.base
    level = typical(base)
    level[quest.model.dimension + base.problem.zero_mean.size :] = 0.0
    low = low_start(base, quest.prior, [level])
    return [] if low is None else [Frame(replace(low, noise=quest.prior.start()), far=True, kind="low")]


class _Search:
    """What has been found so far, from the single effects on to the best explanation of all."""

    def __init__(
        self, quest: Quest, brief: Brief, none: Explanation, places: Places, columns: list[Array],
        singles: dict[str, Weighed], look: Callable[[Fit], None], otherwise: Callable[[Fit], float],
        frames: Sequence[Frame],
    ) -> None:
        self.quest, self.brief = quest, brief
        self.none = self.best = none
        self.others: list[Explanation] = []
        self.put_off = False
        self.odds = prior_odds()
        elsewhere = [p for p in brief.unseen if p.channel == "displacement"]
        sized = next((f.fit for f in frames if f.kind == "sized"), None)
        self.known = Known(
            none.weighed, brief.resolution_m, self.odds, max(len(quest.names), 1), elsewhere, singles, brief.prior,
            sized,
        )  # fmt: skip
        self._places, self._columns, self._look, self._otherwise = places, columns, look, otherwise
        self._frames = frames
        self._considered: list[Weighed] = []

    def run(self) -> None:
        """One effect, further ones where one is not enough, and what is left after that."""
        ranked = sorted(self.known.counting, key=lambda w: -self.known.weight(w))
        if ranked and ranked[0].log_evidence > self.none.weighed.log_evidence - SLIGHT:
            self._tell(0, 6, ranked[0].name)
            self._look(ranked[0].fit)
            self._lead(self._thoughts(ranked[0]))
        for _ in range(self.brief.most_effects):
            if not self._one_more():
                break
        if self._put_right():
            self._one_more()
        if not self._is_explained and not self.best.adequate and not ranked and self._otherwise(self.quest.base) <= 0.0:
            self._two_below_a_step()
        if not self.best.adequate:
            self._settle(but_for_what_is_too_small(self.best, self.known, self._explained))
        if self.best.discrepancy is None:
            # what imitated something that was left out has to find back, from where parts of the recordings have it
            starts = [f.fit.q for f in self._frames[1:]]
            beside_it = discrepancy(
                self.best.weighed.fit, self._columns, self.brief.prior, [] if self._is_explained else starts,
                self._tell, straight=self._is_explained,
            )  # fmt: skip
            self.best = replace(self.best, discrepancy=beside_it)
            self.none = self.best if self.best.weighed is self.none.weighed else self.none
        if self._is_explained and self.best.adequate:
            best = self.best.weighed
            self.known.take_from_elsewhere(from_the_leader(best, self.known.counting, self.quest))
            fitted = {name for name, w in self.known.weighed.items() if w.refitted}
            self.known.take_from_elsewhere(alike(best, fitted, self.quest))
            self.known.take_from_elsewhere(containing(best, fitted, self.quest))
            self.known.take_from_elsewhere(damped_and_shifted(best, self.known.counting, self.quest))
            self.known.take_from_elsewhere(pairs_read_early_or_late(best, self.known.counting, self.quest))
            self.known.take_from_elsewhere(self._without_the_further_mode(self._likeliest))
            self.known.take_from_elsewhere(damper_or_lag(self._likeliest, self.known.weighed, self.quest))

    def naming(self, skipped: dict[str, str], visible: tuple[str, ...]) -> Naming:
        """The probabilities of all that was weighed."""
        prior = self.brief.prior
        weight = self.known.weight
        least = max(map(weight, [self.none.weighed, *self.known.counting])) - WORTH_LABELLING
        labelled = {
            w.name: labellings(w, prior) for w in self.known.counting if FURTHER in w.effects and weight(w) > least
        }
        evidence, error, log_p = log_probabilities(
            self.known, self.none, [self.best, *self.others], self.odds, prior, labelled
        )
        total = float(logsumexp(list(log_p.values())))
        probability = with_adequacy(
            {k: math.exp(v - total) for k, v in log_p.items()}, self.best, self.none, self.brief.resolution_m
        )
        return Naming(
            self.none, self.best, self.known.weighed, evidence, error, probability, log_p, skipped, labelled, visible,
            {w.name: self.known.timing(w) for w in self.known.counting if DELAY in w.effects}, self.put_off,
        )  # fmt: skip

    def together(self) -> tuple[Fit, ...]:
        """Fits of several effects that are as likely as any, or may be from where that stands, best first."""
        weight = self.known.weight
        ranked = sorted(self.known.counting, key=lambda w: -weight(w))
        near = [w.fit for w in ranked if len(w.effects) > 1 and weight(w) > weight(ranked[0]) - CROSSED]
        return tuple(near[: 1 + PARTNERS])

    @property
    def _likeliest(self) -> Weighed:
        """Of all that was weighed; beside the best there may be a likelier one, read a part of a sample late, say."""
        return max([self.best.weighed, *self.known.counting], key=self.known.weight)

    @property
    def _is_explained(self) -> bool:
        """Whether something else than the base leads."""
        return self.best is not self.none

    def _tell(self, done: float, of: float, text: str) -> None:
        self.brief.say("checking what is left", done, of, text)

    def _lead(self, w: Weighed) -> None:
        """Go on with a hypothesis as the best so far."""
        self.best = self._explained(w)
        self.others.append(self.best)
        if self.best.below_a_step:
            left = (*self.known.nothing_left, frozenset(w.effects))
            self.known = replace(self.known, nothing_left=left)

    def _explained(self, w: Weighed) -> Explanation:
        return explain(w, self._places, self._columns, self.quest.rng, self.brief.prior, self._tell)

    def _settle(self, judged: Explanation) -> None:
        """The best so far as it is judged in the end."""
        self.none = self.none if self._is_explained else judged
        self.others = [judged if e is self.best else e for e in self.others]
        self.best = judged

    def _thoughts(self, w: Weighed) -> Weighed:
        """The same, or what is likelier once no mode of the base stands in for another effect.

        Where that is another one and leaves something to explain, its modes are put right, too (`put_right`).
        """
        if any(w is c for c in self._considered):
            return w
        recounted = counted(w, self.quest.base, self.brief.prior)
        if recounted is not w:
            self.known.weighed[w.name] = w = recounted
        better = self._better(second_thoughts(w, self.quest))
        top = max([w, *better], key=self.known.weight)
        if top is not w and not self.quest.explained_by(top.fit):
            top = max([top, *self._better(put_right(top, [w, *better], self.quest))], key=self.known.weight)
        self._considered.append(top)
        return top

    def _better(self, found: list[Weighed]) -> list[Weighed]:
        """Those that are clearly better than what is known, and change enough to be claimed."""
        return self.known.take_from_elsewhere([t for t in found if self.known.enough(t)])

    def _put_right(self) -> bool:
        """Put a mode of the best so far where it is needed now, where that leaves something; whether that is another.

        A mode that did the work of an effect (a damper's, at 0.3 ms) is idle once that is in, and may be what is
        missing elsewhere: what is on no list is to explain no mode that was left where it had strayed.
        """
        best = self.best
        if not self._is_explained or _is_enough(best):
            return False
        better = self._better(put_right(best.weighed, self.known.counting, self.quest))
        top = max([best.weighed, *better], key=self.known.weight)
        if top is best.weighed:
            return False
        self._lead(top)
        return True

    def _without_the_further_mode(self, w: Weighed) -> list[Weighed]:
        """An explanation with its further mode in the place of one of the base's, where it has not been thought over.

        A mode that did the work of a lag before that was in has stayed where it was, and a further one does its own.
        """
        others = [n for n in w.effects if n != FURTHER]
        if len(others) in (0, len(w.effects)) or any(w is c for c in self._considered):
            return []
        model = extended(self.quest.model, others, self.quest.by(w.laws).given)
        if model is None:
            return []
        self.quest.say("leaving one out", 0, 1, "+".join(others))
        simpler = in_place_of_one(w, self.quest.base, model, self.brief.prior)
        return [] if simpler is None else [simpler]

    def _one_more(self) -> bool:
        """Look for an effect beside the best, where that is not enough; whether yet another may be looked for."""
        best, prior = self.best.weighed, self.brief.prior
        enough_alone = _is_enough(self.best)
        if not 1 <= len(best.effects) < self.brief.most_effects:
            return False
        dear = len(best.effects) > 1 and too_dear(best.effects)
        if dear and (enough_alone or DELAY in best.effects or DELAY not in self.quest.names):
            return False
        if best.log_evidence < self.none.weighed.log_evidence:
            return False
        # what seems to be enough may be so with a mode that stands in for a second effect, or hide a weak one
        free = freed(best, prior) if enough_alone else None
        if enough_alone and free is None and self.known.physics(best) > 1:
            return False
        if dear:
            # but for a shift of the readings, which costs nothing and may be there whatever else is
            more = self._taken(beside(best, self.quest.among([DELAY])))
        else:
            more = self._beside_what_is_enough(free) if enough_alone else self._beside_what_is_not()
        if not more:
            return False
        top = max(more, key=self.known.weight)
        if self.known.weight(top) < self.known.weight(best) + SLIGHT:
            return False
        self._look(top.fit)
        left_over = excess(best.fit, prior)
        if not enough_alone and left_over - excess(top.fit, prior) < _STEP * left_over:
            return False
        if not dear:
            top = self._thoughts(top)
        self._lead(top)
        # the second of two effects leaves noise, that of three the weakest; what leaves most is no part of either, but
        # for a shift below a sample, beside which a second effect may still be
        return self.best.adequate or self.known.physics(top) < 2 or excess(top.fit, prior) <= REMAINS * left_over

    def _beside_what_is_enough(self, free: Weighed | None) -> list[Weighed]:
        """Further effects that may hide beside the best. free: it without a mode that stands in for one."""
        best = self.best.weighed
        start = free or best
        more = beside(start, self.quest, HIDDEN if free is None else LEAST_GAIN)
        more = [replace(t, size_m=effect_size(best.fit, t.fit)) for t in more if t.fit is not start.fit]
        # one that adds nothing to what is enough without it is no rival of that
        more = self._taken([t for t in more if t.log_evidence > best.log_evidence])
        more += self._taken(shifted_rivals(best, list(self.known.weighed.values()), self.quest))
        # what is behind one that is enough shows of no pair that it needs rivals
        if self.known.physics(best) < 2 and any(w.log_evidence > best.log_evidence for w in more):
            more += self._taken(
                in_place_of_the_first(best, more, self.known.counting, self.quest, free is not None)
            )
        return more

    def _beside_what_is_not(self) -> list[Weighed]:
        """Further effects where the best leaves something; put off where another reading promises more."""
        start = self.best.weighed
        first_of_all = len(start.effects) == 1
        taken = self._otherwise(start.fit)
        promised = promised_beside(start, self.quest) if taken > 0.0 else 0.0
        if promised < NEARLY * taken:
            self.put_off = promised >= _PROMISES * taken
            return []
        behind = self._taken(behind_more(start, self._frames, self.quest))
        if behind and behind[0].log_evidence > start.log_evidence + FOUND:
            return behind  # others are looked for beside that
        start, found = beside_the_leader(start, self.known.counting, self.quest, self._thoughts)
        more = self._taken(found)
        if first_of_all and more:
            late = self.known.weighed.get("+".join(together(start.effects, DELAY)))
            more += self._taken(read_early_or_late(max(more, key=self.known.weight), start, late, self.quest))
        if first_of_all:
            swapped = in_place_of_the_first(start, more, self.known.counting, self.quest)
            swapped += beside_the_next(start, more + swapped, self.known.counting, self.quest)
            more += self._taken(swapped)
            more += self._taken(self._swapped_and_shifted(start, more))
        top = top_of([start, *more], start)
        if not self.quest.explained_by(top.fit):
            shifted = mass_read_early_or_late(top, self.known.weighed, self.quest)
            # a shift that takes a little of what another pair would explain is in the way of finding that
            most = REMAINS * excess(top.fit, self.brief.prior)
            more += self._taken([w for w in shifted if excess(w.fit, self.brief.prior) <= most])
        if first_of_all and not self.quest.explained_by(top_of(more, start).fit):
            more += self._taken(self._in_place_of_a_mode(start))
        elif not first_of_all and self.known.physics(start) == 1 and more:
            more += self._taken(in_place_of_the_first(start, more, self.known.counting, self.quest))
            if not self.quest.explained_by(top_of(more, start).fit):
                more += self._taken(helped_elsewhere(start, more, self.known.counting, self.quest))
        if not self.quest.explained_by(top_of(more, start).fit):
            # the likeliest of what was found twice
            once = {w.name: w for w in sorted([start, *more], key=self.known.weight)}
            more += self._taken([w for w in (exchanged(m, self.quest) for m in once.values()) if w is not None])
        return more

    def _swapped_and_shifted(self, start: Weighed, pairs: list[Weighed]) -> list[Weighed]:
        """What took the place of the first effect beside another one, read early or late instead of with either."""
        top = max(pairs, key=self.known.weight, default=start)
        if len(top.effects) != 2 or start.effects[0] in top.effects:
            return []
        return either_read_early_or_late(top, self.known.weighed, self.quest)

    def _in_place_of_a_mode(self, start: Weighed) -> list[Weighed]:
        """Further effects beside what leaves something, where a mode of the base may do badly what one of them does."""
        free = freed(start, self.brief.prior)
        if free is None:
            return []
        found = [t for t in beside(free, self.quest) if t.fit is not free.fit and t.log_evidence > start.log_evidence]
        return [replace(t, size_m=effect_size(start.fit, t.fit)) for t in found]

    def _taken(self, found: list[Weighed]) -> list[Weighed]:
        """What was found is known now; those of it that change enough to be claimed."""
        self.known.take(found)
        self.known.take_from_elsewhere(merged(found, self.quest))
        return [w for w in found if self.known.enough(w)]

    def _two_below_a_step(self) -> None:
        """Two effects, each less than the sensor resolves, may leave more than noise between them."""
        none = self.none.weighed
        small = max((w for w in self.known.weighed.values() if w.refitted), key=self.known.weight, default=none)
        if self.known.weight(small) <= none.log_evidence + LEAST_GAIN:
            return
        self.known.take(beside(small, self.quest))
        pair = max(self.known.counting, key=self.known.weight, default=none)
        if pair is not none and self.known.weight(pair) > self.known.weight(small):
            self._lead(self._thoughts(pair))


def weigh_late(
    base: Fit, campaign: Campaign, overrides: Mapping[str, object] | None, prior: NoisePrior, rng: np.random.Generator
) -> float | None:
    """Log evidence and log prior of what is likeliest, weighed alone, of what makes readings late by about a sample: a
    delay, a lag, a resistance. None where none can be told."""
    known, _ = candidates(base.problem.model, campaign, {p.channel for p in base.problem.pieces}, ())
    names = tuple(n for n in _LATE_BY_A_SAMPLE if n in known)
    if not names:
        return None
    quest = Quest(base, names, {**effect_priors(names, campaign), **(overrides or {})}, prior, rng)
    weighed = refined(base, on_grids([Frame(replace(base, noise=prior.start()))], 1, quest), quest)
    found = (w for w in weighed.values() if w.refitted)
    return max((w.log_evidence + math.log(sum(shares(w, prior_odds(), len(known)))) for w in found), default=None)


def _is_enough(found: Explanation) -> bool:
    """Whether an explanation leaves nothing, nor anything that something smooth would take."""
    gain = found.discrepancy.gain if found.discrepancy else 0.0
    return found.adequate and gain < _VISIBLE

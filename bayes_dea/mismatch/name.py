"""Which physics was left out: probabilities over every hypothesis, "none" and "unknown" among them.

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

from ..campaign.schema import Campaign
from .discrepancy import Discrepancy, basis, discrepancy
from .elements import counted
from .features import Features
from .frame import Frame
from .further import (
    HIDDEN,
    again,
    beside,
    beside_the_leader,
    beside_the_next,
    freed,
    from_the_leader,
    in_place_of_the_first,
    merged,
    promised_beside,
    second_thoughts,
)
from .grid import Screened
from .hypotheses import DELAY, NONE, UNKNOWN, candidates, effect_priors, prior_odds
from .known import SLIGHT, Known
from .locate import ADEQUATE, Places, Scan, is_adequate, places_of, scan
from .noise_prior import NoisePrior
from .places import with_free_places
from .reduced import Piece
from .refit import Fit
from .relabel import FURTHER, labellings
from .search import LEAST_GAIN, REMAINS, Report, frames_of, on_grids, refined, too_dear, typical
from .size import effect_size
from .slow_start import LIMITS, low_start
from .telling import Tell, silence
from .weigh import Weighed, excess

Array = NDArray[np.float64]

#: nats that can be seen: by which an effect's likelihood varies over its grid, or a discrepancy is better than none
_VISIBLE = 5.0
#: probability from which on it matters which of its modes a hypothesis calls the further one
_WORTH_LABELLING = 0.01
#: probability that a mismatch is nothing where a scan refutes the explanation just so
_LEFT = 0.2
#: probability that one below what the sensor resolves is something all the same
_SOMETHING = 0.2
#: scatter of readings, in steps, whose noise is half a step beside the rounding's own 1/sqrt(12)
_ROUNDED = math.sqrt(0.25 + 1.0 / 12.0)
#: share of what is left that a grid promises for an effect which is in the recordings, at least
_PROMISES = 1.0 / 3.0
#: share of the misfit that is left which a further effect has to take away for another one to be looked for after it
_STEP = 0.05


@dataclass(frozen=True)
class Explanation:
    """A weighed hypothesis with its adequacy."""

    weighed: Weighed
    scan: Scan
    discrepancy: Discrepancy | None = None  # of what is adequate and of the best only: beside a poor fit it is dear
    small: Weighed | None = None  # it and an effect too small to be claimed, which leave nothing

    @property
    def adequate(self) -> bool:
        """Whether nothing significant is left in its residuals, or only what is too small to be claimed."""
        return self.scan.p_value > ADEQUATE or self.small is not None

    @property
    def below_a_step(self) -> bool:
        """Whether what is left is seen, and yet nowhere as much as the sensor resolves: no mismatch is claimed then."""
        return not self.adequate and self.scan.nothing_claimed


@dataclass(frozen=True)
class Naming:
    """Probabilities by name, the explanations behind them, and the one with which it all began."""

    none: Explanation
    best: Explanation  # the best named one, or none
    weighed: dict[str, Weighed]
    log_evidence: dict[str, float]
    log_evidence_se: dict[str, float]
    probability: dict[str, float]
    log_weight: dict[str, float]  # log evidence and log prior, not normalised
    skipped: dict[str, str] = field(default_factory=dict)
    labellings: dict[str, list[Fit]] = field(default_factory=dict)  # where modes may change places (`relabel`)
    visible: tuple[str, ...] = ()  # single effects that these recordings would show at some strength
    put_off: bool = False  # further effects promise something, and another reading more


def explain(
    weighed: Weighed, places: Places, columns: list[Array], rng: np.random.Generator, prior: NoisePrior,
    tell: Tell = silence,
) -> Explanation:
    """A hypothesis with its adequacy and, where it is adequate, what a discrepancy would add."""
    tell(1, 6, weighed.name)
    found = Explanation(weighed, scan(weighed.fit, rng, places))
    if not found.adequate:
        return found
    beside = discrepancy(weighed.fit, columns, prior, (), lambda done, of, text: tell(2 + done, 2 + of, text))
    return replace(found, discrepancy=beside)


def name_physics(
    base: Fit,
    campaign: Campaign,
    prior: NoisePrior,
    looks: list[Features],
    rng: np.random.Generator,
    *,
    resolution_m: float,
    overrides: Mapping[str, object] | None = None,
    report: Report | None = None,
    most_effects: int = 3,
    spoiled: Callable[[Fit], bool] | None = None,
    established: Sequence[str] = (),
    memory: dict[str, Screened] | None = None,
    unseen: Sequence[Piece] = (),
    begun: Sequence[Fit] = (),
    otherwise: Callable[[Fit], float] = lambda _: 0.0,
) -> Naming | None:
    """Weigh all hypotheses on the recordings to identify.

    otherwise: nats of what an explanation leaves that another reading of the recordings would take. Further effects are
    looked for only where a grid promises as much; else they are sought under that reading first, and are put off where
    the grid promises a third of it.

    unseen: recordings to validate, of which the commands alone are used: an effect is as large as on the recording of
    the campaign that it moves most (CONTRACT 1).

    begun: explanations from another reading of the recordings, as what a search may miss that has to begin anew.

    spoiled: asked of the fits that may explain the recordings, before they are judged; where it says yes, the data are
    to be made clean first, and None is returned.
    """
    say = report or (lambda *_: None)
    columns, places = basis(base, looks), places_of(base.problem.pieces, rng, looks)
    model = base.problem.model
    say("finding starts", 0, 3, "slow waves and plateaus")
    frames = frames_of(base, looks, prior)
    say("finding starts", 1, 3, "what is left")
    none = Explanation(Weighed((), base, base.log_evidence, 0.1, 0.0), scan(base, rng, places))
    names, skipped = candidates(model, campaign, {p.channel for p in base.problem.pieces}, established)
    given: dict[str, object] = {**effect_priors(names, campaign), **(overrides or {})}
    low = None
    if not none.adequate and any(n in LIMITS for n in names):
        say("finding starts", 2, 3, "the lower half of the range")
        level = typical(base)
        level[model.dimension + base.problem.zero_mean.size :] = 0.0
        low = low_start(base, prior, [level])
    limited = [] if low is None else [Frame(replace(low, noise=prior.start()), far=True, kind="low")]
    found = on_grids([*frames, *limited], len(frames), model, names, given, say, memory)
    visible = tuple("+".join(s.effects) for s in found if s.contrast > _VISIBLE)

    def adequate(fit: Fit) -> bool:
        return is_adequate(fit, rng, places)

    singles = refined(base, found, prior, say, 2, rng, spoiled, adequate=adequate)
    if singles is None:
        return None
    odds = prior_odds()
    elsewhere = [p for p in unseen if p.channel == "displacement"]
    known = Known(none.weighed, resolution_m, odds, max(len(names), 1), elsewhere, singles, prior)
    known.take_from_elsewhere(again(begun, base, prior))
    considered: list[Weighed] = []

    def left(done: float, of: float, text: str) -> None:
        say("checking what is left", done, of, text)

    def thoughts(w: Weighed) -> Weighed:
        """The same, or what is likelier once no mode of the base stands in for another effect."""
        if any(w is c for c in considered):
            return w
        recounted = counted(w, base, prior)
        if recounted is not w:
            known.weighed[w.name] = w = recounted
        more = second_thoughts(w, base, model, names, prior, given, say, rng, adequate)
        better = known.take_from_elsewhere([t for t in more if known.enough(t)])
        considered.append(max([w, *better], key=known.weight))
        return considered[-1]

    ranked = sorted(known.counting, key=lambda w: -w.log_evidence)
    best = none
    others: list[Explanation] = []
    if ranked and ranked[0].log_evidence > none.weighed.log_evidence - SLIGHT:
        left(0, 6, ranked[0].name)
        if spoiled is not None and spoiled(ranked[0].fit):
            return None
        best = explain(thoughts(ranked[0]), places, columns, rng, prior, left)
        others.append(best)
    put_off = False
    # more than one effect, where one is not enough
    for _ in range(most_effects):
        gain = best.discrepancy.gain if best.discrepancy else 0.0
        enough_alone = best.adequate and gain < _VISIBLE
        if not 1 <= len(best.weighed.effects) < most_effects:
            break
        if len(best.weighed.effects) > 1 and too_dear(best.weighed.effects):
            break
        if best.weighed.log_evidence < none.weighed.log_evidence:
            break
        # what seems to be enough may be so with a mode that stands in for a second effect, or hide a weak one
        free = freed(best.weighed, prior) if enough_alone else None
        if enough_alone and free is None and len(best.weighed.effects) > 1:
            break
        start = free or best.weighed
        if enough_alone:
            least = HIDDEN if free is None else LEAST_GAIN
            more = beside(start, model, names, prior, given, say, rng, adequate, least)
            more = [replace(t, size_m=effect_size(best.weighed.fit, t.fit)) for t in more if t.fit is not start.fit]
            # one that adds nothing to what is enough without it is no rival of that
            more = [t for t in more if t.log_evidence > best.weighed.log_evidence]
        else:
            taken = otherwise(start.fit)
            promised = promised_beside(start, model, names, given, say) if taken > 0.0 else 0.0
            if promised < taken:
                put_off = promised >= _PROMISES * taken
                break
            start, more = beside_the_leader(
                start, known.counting, model, names, prior, given, say, rng, adequate, thoughts
            )
        known.take(more)
        known.take_from_elsewhere(merged(more, base, model, prior, given))
        more = [w for w in more if known.enough(w)]
        if len(best.weighed.effects) == 1 and (more or not enough_alone):
            first = start if free is None else best.weighed
            swapped = in_place_of_the_first(
                first, more, known.counting, model, names, prior, given, say, rng, free is not None
            )
            if not enough_alone:
                swapped += beside_the_next(
                    none.weighed, first, more + swapped, known.counting, model, names, prior, given, say, rng, adequate
                )
            known.take(swapped)
            known.take_from_elsewhere(merged(swapped, base, model, prior, given))
            more += [w for w in swapped if known.enough(w)]
        if not more:
            break
        top = max(more, key=lambda w: w.log_evidence)
        if top.log_evidence < best.weighed.log_evidence + SLIGHT + math.log(odds["single"] / odds["double"]):
            break
        if spoiled is not None and spoiled(top.fit):
            return None
        left_over = excess(best.weighed.fit, prior)
        if not enough_alone and left_over - excess(top.fit, prior) < _STEP * left_over:
            break
        top = thoughts(top)
        best = explain(top, places, columns, rng, prior, left)
        others.append(best)
        # the second of two effects leaves noise, that of three the weakest; what leaves most is no part of either
        if not best.adequate and excess(top.fit, prior) > REMAINS * left_over:
            break
    if best is none and not best.adequate and not ranked and otherwise(base) <= 0.0:
        # two effects, each less than the sensor resolves, may leave more than noise between them
        small = max((w for w in known.weighed.values() if w.refitted), key=known.weight, default=none.weighed)
        if known.weight(small) > none.weighed.log_evidence + LEAST_GAIN:
            known.take(beside(small, model, names, prior, given, say, rng, adequate))
            pair = max(known.counting, key=known.weight, default=none.weighed)
            if pair is not none.weighed and known.weight(pair) > known.weight(small):
                best = explain(thoughts(pair), places, columns, rng, prior, left)
                others.append(best)
    if not best.adequate:
        judged = _but_for_what_is_too_small(best, known, places, columns, rng, prior, left)
        none = judged if best is none else none
        others = [judged if e is best else e for e in others]
        best = judged
    if best.discrepancy is None:
        # what imitated something that was left out has to find back
        starts = [f.fit.q for f in frames[1:]] if best is none else []
        beside_it = discrepancy(best.weighed.fit, columns, prior, starts, left, straight=best is not none)
        best = replace(best, discrepancy=beside_it)
        none = best if best.weighed is none.weighed else none
    if best is not none and best.adequate:
        known.take_from_elsewhere(from_the_leader(best.weighed, known.counting, base, prior, say))
    evidence, error, log_p = _log_probabilities(known, none, [best, *others], odds, prior)
    total = float(logsumexp(list(log_p.values())))
    probability = _with_adequacy({k: math.exp(v - total) for k, v in log_p.items()}, best, none, resolution_m)
    labelled = {
        w.name: labellings(w, prior)
        for w in known.weighed.values()
        if FURTHER in w.effects and probability.get(w.name, 0.0) > _WORTH_LABELLING
    }
    return Naming(
        none, best, known.weighed, evidence, error, probability, log_p, skipped, labelled, visible, put_off
    )


def _but_for_what_is_too_small(
    best: Explanation, known: Known, places: Places, columns: list[Array], rng: np.random.Generator,
    prior: NoisePrior, tell: Tell,
) -> Explanation:
    """What is left by an explanation, judged beside one or two further effects that move less than the sensor resolves.

    Such an effect is not claimed as physics (CONTRACT 1); nor is what it leaves without it a mismatch of no known kind.
    """
    effects = set(best.weighed.effects)
    small = [
        w for w in known.weighed.values()
        if effects < set(w.effects) and len(w.effects) <= len(effects) + 2 and w.refitted
        and w.log_evidence > best.weighed.log_evidence and not known.enough(w)
    ]
    if not small:
        return best
    beside = explain(max(small, key=lambda w: w.log_evidence), places, columns, rng, prior, tell)
    return replace(best, discrepancy=beside.discrepancy, small=beside.weighed) if beside.adequate else best


def _log_probabilities(
    known: Known, none: Explanation, explained: Sequence[Explanation], odds: Mapping[str, float], noise: NoisePrior
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Log evidence, its error, and log evidence with prior odds (not normalised), of every hypothesis by its name.

    What explains less than the resolution is not claimed as physics. That the modes of the base lie elsewhere than
    expected speaks for no further one (`places`).
    """
    evidence = {NONE: none.weighed.log_evidence}
    error = {NONE: none.weighed.log_evidence_se}
    prior_of = {NONE: odds["none"], UNKNOWN: odds["unknown"]}
    for w in known.counting:
        evidence[w.name], error[w.name] = w.log_evidence, w.log_evidence_se
        prior_of[w.name] = known.share(w)
    evidence[UNKNOWN] = max(
        e.weighed.log_evidence + (min(e.discrepancy.gain, 0.0) if e.below_a_step else e.discrepancy.gain)
        for e in explained if e.discrepancy is not None
    )  # fmt: skip
    error[UNKNOWN] = 0.5

    def weights() -> dict[str, float]:
        return {k: evidence[k] + math.log(prior_of[k]) for k in evidence}

    least = max(weights().values()) + math.log(_WORTH_LABELLING)
    further = [w for w in known.counting if FURTHER in w.effects and weights()[w.name] > least]
    evidence = with_free_places(evidence, further, noise)
    return evidence, error, weights()


def weigh_delay(
    base: Fit, campaign: Campaign, overrides: Mapping[str, object] | None, prior: NoisePrior, rng: np.random.Generator
) -> float | None:
    """Log evidence and log prior of a delay of the readings, weighed alone; None where none can be told."""
    model = base.problem.model
    names, _ = candidates(model, campaign, {p.channel for p in base.problem.pieces}, ())
    if DELAY not in names:
        return None

    def quiet(*_: object) -> None:
        """Nothing is said of it."""

    given: dict[str, object] = {**effect_priors([DELAY], campaign), **(overrides or {})}
    found = on_grids([Frame(replace(base, noise=prior.start()))], 1, model, [DELAY], given, quiet, None)
    weighed = refined(base, found, prior, quiet, 1, rng)
    if not weighed:
        return None
    return weighed[DELAY].log_evidence + math.log(prior_odds()["single"] / max(len(names), 1))


def _with_adequacy(
    probability: dict[str, float], best: Explanation, none: Explanation, resolution_m: float
) -> dict[str, float]:
    """Where the best named explanation leaves a mismatch that no smooth discrepancy takes, it is unknown.

    But for one that is nowhere as much as the sensor resolves, which is not claimed (CONTRACT 1): what is left by the
    model alone then, or by the best explanation. Beside that, evidences tell how likely something unknown is; not where
    readings scatter by less than half a step, and what is below one is the rounding itself.
    """
    if best.adequate:
        return probability
    if none.below_a_step:
        return {k: 1.0 - _SOMETHING if k == NONE else _SOMETHING if k == UNKNOWN else 0.0 for k in probability}
    scatter_m = best.weighed.fit.noise.sigma.get("displacement", math.inf)
    if best.below_a_step and scatter_m >= _ROUNDED * resolution_m:
        return probability
    named = sum(v for k, v in probability.items() if k != UNKNOWN)
    if named == 0.0:
        return probability
    left = 1.0 - _SOMETHING if best.below_a_step else min(named, _LEFT, _LEFT * best.scan.p_value / ADEQUATE)
    out = {k: v * left / named for k, v in probability.items() if k != UNKNOWN}
    out[UNKNOWN] = 1.0 - left
    return out

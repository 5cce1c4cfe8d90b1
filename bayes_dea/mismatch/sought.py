"""The search for what was left out, under the reading of the campaign that does best: holds, odd ones, gains, limits.

A command read by another convention, a recording of another actuator, gains that differ or a sensor's end explain a
mismatch without physics. Where one of them is likelier than all that is named, the search begins anew under it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..campaign.schema import Campaign
from ..gauss_newton.noise_prior import NoisePrior
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit, refit
from .prepare import ROUNDS, Prepared
from .readings.instead_of_gains import better_than_gains
from .readings.own_gains import MOVED, Loosened, gains_of, nats_of_gains, worth_a_search
from .readings.own_limits import CLIPPING, limit_of_readings
from .readings.reread import Rereading, odd_one_out, other_holds
from .readings.seen import Seen
from .search.hypotheses import NONE, UNKNOWN
from .search.name import RIVAL, Brief, Memory, ReadOtherwise, Spoiled, name_physics, weigh_late
from .search.naming import Naming, across_readings
from .search.once import Once
from .search.quest import Report
from .telling import Tell, silence
from .verdict import FALSE_ALARMS
from .where.features import features
from .where.locate import is_adequate, scan

#: nats by which another hold convention must be ahead to be taken before effects are weighed
_BY_FAR = 100.0
#: how many are, where the best leaves something
_FEW = 3


def sought(
    ready: Prepared, overrides: Mapping[str, Any] | None, most_effects: int, rng: np.random.Generator, say: Report,
    loose: bool = False, known: Sequence[Fit] = (),
) -> tuple[Seen, Naming]:
    """What was left out, and the recordings as they were read in the end.

    loose: a part of the recordings has shown already that nothing explains them without a gain of each; known: what
    explains that part.
    """
    seen, naming = _by_best_reading(ready, overrides, most_effects, rng, say, loose, known)
    if seen.tied is None or not _better_unlisted(seen.tied, naming, ready.prior, ready.resolution_m):
        return seen, naming
    say("reading the campaign again", 0, 1, "one gain of all recordings")
    tied = _named(ready, seen.tied, overrides, most_effects, rng, say, (), Memory(), None)
    assert tied is not None  # but for gains nothing ends a search early
    return seen.tied, tied


def _by_best_reading(
    ready: Prepared, overrides: Mapping[str, Any] | None, most_effects: int, rng: np.random.Generator, say: Report,
    loose: bool, known: Sequence[Fit],
) -> tuple[Seen, Naming]:
    """See `sought`; where gains leave nothing to explain, they do."""
    seen, prior, with_gains = ready.seen, ready.prior, Loosened(ready.prior)

    def tell(*at: Any) -> None:
        say("rereading", *at)

    def named(seen: Seen, memory: Memory, begun: Sequence[Fit] = (), gains_first: bool = True) -> Naming:
        gains = with_gains if gains_first else None
        found = _named(ready, seen, overrides, most_effects, rng, say, begun, memory, gains)
        if found is not None:
            return found
        say("reading the campaign again", 0, 1, "a gain of each recording")
        seen.take(Rereading(seen.base, 0.0, gains=True))
        memory.grids, memory.singles = {}, None
        return named(seen, memory, (), gains_first)

    held: Once[list[Rereading]] = Once()

    def holds(fit: Fit) -> list[Rereading]:
        return held((fit,), lambda: other_holds(fit, prior, rng, tell))

    say("refining the fit", 1, 1, "")
    retimed = _retimed(seen.base, ready.campaign, overrides, prior, rng, holds)
    if retimed is not None:
        seen.take(retimed)
    if loose:
        seen.take(Rereading(seen.base, 0.0, gains=True))
    memory = Memory()
    naming = named(seen, memory, known)
    reread = _reread(naming, seen.pieces, with_gains, rng, holds, tell)
    if reread is not None:
        how = "a gain of each recording" if reread.gains else reread.odd or f"hold = {reread.hold}"
        how = "the end of the sensor's range" if reread.limit else how
        say("reading the campaign again", 0, 1, how)
        begun = _begun(naming, seen.pieces, with_gains, reread.base) if reread.gains else []
        seen.take(reread)
        memory, before = Memory(), naming
        naming = named(seen, memory, begun)
        if reread.gains:
            naming = across_readings(naming, math.log(MOVED), before)
    loosened = [] if naming.best.adequate else _with_gains_that_matter(naming, seen.pieces, with_gains, rng)
    if loosened:
        say("reading the campaign again", 0, 1, "a gain of each recording")
        other = seen.copy()
        other.take(Rereading(seen.base, 0.0, gains=True))
        again = named(other, Memory(), loosened)
        if again.best.adequate or again.best.below_a_step or again.none.below_a_step:
            return other, again
    if naming.put_off:  # gains do not settle it
        naming = named(seen, memory, gains_first=False)
    return seen, naming


def _named(
    ready: Prepared, seen: Seen, overrides: Mapping[str, Any] | None, most_effects: int, rng: np.random.Generator,
    say: Report, begun: Sequence[Fit], memory: Memory, with_gains: Loosened | None,
) -> Naming | None:
    """Every hypothesis weighed, again where that shows false readings; None where a gain of each recording leaves
    nothing, and no effect promises as much.

    memory: single effects as an earlier search left them; filled in. with_gains: where a gain of each
    recording takes more than a further effect promises, none is looked for.
    """
    unseen = tuple(p for p in seen.pieces if not p.identify)
    established = (CLIPPING,) if ready.limit is not None else ()
    brief = Brief(
        ready.campaign, ready.prior, ready.resolution_m, dict(overrides or {}), most_effects, established, unseen, say
    )
    for last in range(ROUNDS, -1, -1):
        base = seen.base
        found = name_physics(
            base,
            [features(p) for p in base.problem.pieces],
            brief,
            rng,
            spoiled=seen.spoiled if last else None,
            memory=memory,
            begun=begun,
            otherwise=lambda fit: _taken_by_gains(fit, seen.pieces, with_gains, rng) if with_gains else 0.0,
            settled_by=lambda fit: _left_to_gains(fit, seen.pieces, with_gains, rng) if with_gains else 0.0,
        )
        if isinstance(found, ReadOtherwise):
            return None
        if not isinstance(found, Spoiled):
            return found
        begun = found.known
        seen.base = refit(seen.base.problem, base.q, base.noise, ready.prior) or base
    raise AssertionError("a search that nobody may end has ended")


def _retimed(
    base: Fit,
    campaign: Campaign,
    overrides: Mapping[str, Any] | None,
    prior: NoisePrior,
    rng: np.random.Generator,
    holds: Callable[[Fit], list[Rereading]],
) -> Rereading | None:
    """Another hold convention that leaves nothing to explain by far: no effect has to be weighed to see that.

    None but what is late by about a sample: a delay that is no whole number of them leaves, read that way, what looks
    like another effect, and a resistance or a lag of half of one is nearly what another convention does.
    holds: a fit under the other conventions (`other_holds`).
    """
    if is_adequate(base, rng):
        return None
    found = [r for r in holds(base) if r.base.log_evidence > base.log_evidence + _BY_FAR]
    if not found:
        return None
    best = max(found, key=lambda r: r.log_weight)
    late = weigh_late(base, campaign, overrides, prior, rng)
    return None if late is not None and late > best.log_weight else best


def _reread(
    naming: Naming, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator,
    holds: Callable[[Fit], list[Rereading]], tell: Tell = silence,
) -> Rereading | None:
    """Another reading of the campaign that is likelier than every named effect and than "unknown"; None without one.

    holds: see `_retimed`.
    """
    if naming.none.adequate:
        return None
    fit, prior = naming.none.weighed.fit, with_gains.prior
    found = [*holds(fit), *odd_one_out(fit, prior, rng, tell)]
    if not naming.best.adequate and naming.best is not naming.none:
        found += odd_one_out(naming.best.weighed.fit, prior, rng, tell)
    found += _with_own_gains(naming, pieces, with_gains, rng, tell)
    if CLIPPING in naming.best.weighed.effects and not naming.best.adequate:
        name = naming.best.weighed.name
        odds = naming.log_weight.get(name, -math.inf) - naming.log_evidence.get(name, 0.0)
        tell(0, 1, "the end of the sensor's range as one of its readings")
        ended = limit_of_readings(naming.best.weighed, odds, prior, rng)
        found += [ended] if ended is not None else []
    if not found:
        return None
    top = max(found, key=lambda r: r.log_weight)
    # "unknown" takes what nothing else explains; another reading does
    rival = max(v for k, v in naming.log_weight.items() if k != UNKNOWN)
    return top if top.log_weight > rival or not naming.best.adequate else None


def _with_own_gains(
    naming: Naming, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator, tell: Tell
) -> list[Rereading]:
    """The base, the best explanation and parts of it with a gain of each recording, where that leaves nothing.

    One of several effects may be there for gains that differ.
    """
    best = naming.best.weighed
    parts = [w for w in naming.weighed.values() if set(w.effects) < set(best.effects) and w.refitted]
    out = []
    for k, w in enumerate({w.name: w for w in (naming.none.weighed, *parts, best)}.values()):
        if w.name not in naming.log_weight:  # too small to be claimed
            continue
        tell(k, len(parts) + 2, f"a gain of each recording, {w.name}")
        loose = with_gains.where_worth(w.fit, pieces)
        if loose is not None and is_adequate(loose, rng):
            odds = naming.log_weight[w.name] - naming.log_evidence[w.name]
            out.append(Rereading(loose, loose.log_evidence + math.log(MOVED) + odds, gains=True))
    return out


def _with_gains_that_matter(
    naming: Naming, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator
) -> list[Fit]:
    """The base, the best explanation and the likeliest, which may be too small to be claimed, with a gain of each
    recording; those of which that takes much, or all that can be seen."""
    refitted = (w for w in naming.weighed.values() if w.refitted)
    likeliest = max(refitted, key=lambda w: w.log_evidence, default=naming.best.weighed)
    fits = {id(w.fit): w.fit for w in (naming.none.weighed, naming.best.weighed, likeliest)}
    loosened = [_loosened(fit, pieces, with_gains, rng) for fit in fits.values()]
    return [fit for fit in loosened if fit is not None]


def _better_unlisted(tied: Seen, naming: Naming, prior: NoisePrior, resolution_m: float) -> bool:
    """Whether something on no list explains the recordings better than a gain of each, where with these no physics is
    claimed. tied: the recordings as they were before."""
    own = naming.probability.get(NONE, 0.0)
    if own <= FALSE_ALARMS or not any(p.nodes is not None for p in tied.base.problem.pieces):
        return False
    behind = math.log(max(naming.probability.values()) / own)
    return better_than_gains(tied.base, naming.none.weighed.fit, prior, resolution_m, behind)


def _taken_by_gains(fit: Fit, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator) -> float:
    """Nats of evidence, prior odds included, that a gain of each recording brings, where it is worth a search; else 0.
    """
    loose = _loosened(fit, pieces, with_gains, rng)
    return 0.0 if loose is None else max(nats_of_gains(fit, loose), 0.0)


def _left_to_gains(fit: Fit, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator) -> float:
    """The same where a gain of each recording leaves nothing, and none is so large that it may be another actuator's.
    """
    loose = with_gains.where_worth(fit, pieces)
    if loose is None or not gains_of(loose).may_be_moved or not is_adequate(loose, rng):
        return 0.0
    return max(nats_of_gains(fit, loose), 0.0)


def _loosened(fit: Fit, pieces: tuple[Piece, ...], with_gains: Loosened, rng: np.random.Generator) -> Fit | None:
    """An explanation with a gain of each recording, where these are worth a search; else None."""
    loose = with_gains.where_worth(fit, pieces)
    if loose is None or not worth_a_search(fit, loose, with_gains.prior, lambda f: scan(f, rng).nothing_claimed):
        return None
    return loose


def _begun(naming: Naming, pieces: tuple[Piece, ...], with_gains: Loosened, found: Fit) -> list[Fit]:
    """The best explanation and its rivals with a gain of each recording, for a search with these to know of.

    Where it leaves something, which gains take, evidences without them say little: the likeliest few with as many
    effects. found: one that has its gains already.
    """
    best = naming.best
    refitted = [w for w in naming.weighed.values() if w.refitted and w.effects]
    if best.weighed.effects and best.adequate:
        least = naming.log_weight[best.weighed.name] - RIVAL
        near = [w for w in refitted if naming.log_weight.get(w.name, -math.inf) > least]
    else:
        count = max(len(best.weighed.effects), 1)
        as_many = sorted((w for w in refitted if len(w.effects) == count), key=lambda w: -w.log_evidence)
        near = as_many[:_FEW]
    model = found.problem.model
    others = [with_gains(w.fit, pieces) for w in near if w.fit.problem.model.name != model.name]
    return [found, *(fit for fit in others if fit is not None)]

"""From weighed hypotheses to a verdict: what readings show by themselves joined on, shifts below a sample taken out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit
from ..models.effects import registered_effects
from .readings.clipped import Limit, expectations, lost_m
from .readings.mains import mains_lines, mains_parameters, mains_probability
from .search.hypotheses import DELAY, MAINS, NONE, UNKNOWN, prior_odds
from .search.naming import Naming
from .timing import as_timing

#: something is claimed to be left out where "none" has no more probability than this. Before the recordings are seen it
#: has a half; by Markov's inequality recordings of a model that lacks nothing then bring it so low with at most this
#: probability, if what else there is was weighed with its priors
FALSE_ALARMS = 0.01
#: recordings that would show less than this share of the effects, however strong, tell nothing
_SILENT = 0.25


@dataclass(frozen=True)
class Ruling:
    """The name that is claimed, the probability of every name, the physics behind each, and shifts that one carries.

    delays_s: shifts below one sample, which are timing and part of no name. nats: by name, evidence of what the
    readings show by themselves, or do not show, beside that of the physics; minus infinity where they rule it out.
    """

    verdict: str
    probability: dict[str, float]
    physics: dict[str, str]
    delays_s: dict[str, float]
    nats: dict[str, float] = field(default_factory=dict)

    @property
    def members(self) -> list[str]:
        """The smallest set of names with 99 % of the probability, the verdict first."""
        order = [self.verdict, *sorted((k for k in self.probability if k != self.verdict), key=self._behind)]
        out, total = [], 0.0
        for name in order:
            out.append(name)
            total += self.probability[name]
            if total >= 0.99:
                break
        return out

    def beside(self, lead: float, nats: float = 0.0, *, overruled: bool = True) -> Ruling:
        """What something unlisted makes of it that is so many nats likelier than the verdict; nats: of its evidence
        beyond that of "unknown"; overruled: whether the verdict is "unknown" then."""
        share = self.probability[self.verdict]
        unlisted = share * math.exp(min(lead, 500.0))
        total = 1.0 + unlisted
        p = {k: v / total for k, v in self.probability.items()}
        p[UNKNOWN] = p.get(UNKNOWN, 0.0) + unlisted / total
        physics, own = {**self.physics, UNKNOWN: UNKNOWN}, {**self.nats, UNKNOWN: nats}
        verdict = UNKNOWN if overruled else self.verdict
        return replace(self, verdict=verdict, probability=p, physics=physics, nats=own)

    def _behind(self, name: str) -> float:
        return -self.probability[name]

    @property
    def named(self) -> str:
        """The physics of what is claimed."""
        return self.physics[self.verdict]


@dataclass(frozen=True)
class Fact:
    """An effect that the readings show by themselves, whatever the physics: its probability and its parameters."""

    name: str
    probability: float
    parameters: dict[str, dict[str, Any]]


def facts_of(fit: Fit, pieces: tuple[Piece, ...], limit: Limit | None, resolution: float) -> list[Fact]:
    lines = mains_lines(fit)
    out = [Fact(MAINS, mains_probability(lines, resolution), mains_parameters(lines))]
    if limit is not None:
        lost = lost_m(expectations(fit, pieces, limit), pieces, limit, fit.noise)
        value, sd = limit.value_m, limit.sd_m
        spread = {"mean": value, "sd": sd, "q05": value - 1.5588 * sd, "q50": value, "q95": value + 1.5588 * sd}
        own = {"y_max_m": {**spread, "unit": "m", "map": value, "contraction": 1.0}}
        out.append(Fact("sensor_clipping", 1.0 if lost >= resolution else 0.0, own))
    return [f for f in out if f.probability > 0]


def verdict_of(naming: Naming, facts: list[Fact], uneven: bool = False) -> Ruling:
    """What is claimed, with what is established joined on: the likeliest name, but none where that is not ruled out.

    See `FALSE_ALARMS`; a shift below one sample counts as none, since recordings that are late by that lack no physics.
    uneven: recordings scatter unlike each other at rest, or swing there, which "none" does not explain.
    """
    weighed = _as_before(naming) if silent(naming) else naming.probability
    shift = as_timing(weighed, naming)
    p, physics, delays = shift.probability, shift.physics, shift.delays_s
    if uneven:
        left = 0.5 * FALSE_ALARMS * p.get(NONE, 0.0)
        p = {**p, NONE: left, UNKNOWN: p.get(UNKNOWN, 0.0) + p.get(NONE, 0.0) - left}
    nats = dict.fromkeys(p, 0.0)
    for fact in facts:
        # every hypothesis carries it in its noise or its masks; with "none" it is by itself what was left out
        for name in list(p):
            if name == UNKNOWN:
                continue
            joined = _joined(name, fact.name)
            p[joined], p[name] = p[name] * fact.probability, p[name] * (1.0 - fact.probability)
            # what is mended has the shift in it, as beside any other name
            physics[joined] = DELAY if name == NONE and name in delays else physics[name]
            nats[joined] = nats[name] + math.log(fact.probability)
            nats[name] += math.log1p(-fact.probability) if fact.probability < 1.0 else -math.inf
            if name in delays:
                delays[joined] = delays[name]
    p = {k: v for k, v in p.items() if v > 0 or k in naming.probability}
    top = max(p, key=lambda k: p[k])
    return Ruling(NONE if p.get(NONE, 0.0) > FALSE_ALARMS else top, p, physics, delays, nats)


def _joined(name: str, more: str) -> str:
    """Names of effects in the order of their stages."""
    order = list(registered_effects())
    return "+".join(sorted({*(name.split("+") if name != NONE else []), more}, key=order.index))


def silent(naming: Naming) -> bool:
    """Whether these recordings would show hardly any effect even where it is strong."""
    alone = [n for n in naming.weighed if "+" not in n]
    return len([n for n in alone if n in naming.visible]) < _SILENT * len(alone)


def _as_before(naming: Naming) -> dict[str, float]:
    """Probabilities where what these recordings could not show at any strength is as probable as it was before."""
    odds = prior_odds()
    singles = [n for n in naming.weighed if "+" not in n]
    p = {NONE: odds.none, UNKNOWN: odds.unknown, **{n: odds.of(1, len(singles)) for n in singles}}
    for name in naming.visible:
        p[name] = naming.probability.get(name, 0.0)
    total = sum(p.values())
    return {k: v / total for k, v in p.items()}

"""Physics that is known and yet on no list of effects, held against what was named: what the two kinds of it share.

Where one is likelier than what is named, the verdict is "unknown", and says with what size it explains the recordings;
where nothing is named it has to be clearly so (`judge`).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ...gauss_newton.descent import value_at
from ...gauss_newton.noise_prior import NoisePrior
from ..left_out import Repaired
from ..search.hypotheses import NONE, UNKNOWN, extended, prior_odds
from ..search.naming import Naming
from ..search.relabel import FURTHER, within
from ..search.weigh import Weighed, hopeless

#: prior probability of one worth a word, and nats of lead from which on recordings tell it from what was named
PRIOR, CLEAR = 0.01, 3.0
#: share of what an exponential explains that is left at twice its time constant (a ninth), and as much again
OFF = 0.25
#: effects that answer an edge for some milliseconds, or tens of them: what else does may pass for one of them
AFTER_AN_EDGE = frozenset({FURTHER, "charge_retention", "dielectric_absorption", "fractional_relaxation"})


@dataclass(frozen=True)
class Unlisted(ABC):
    """What it comes to, the standard deviation of that, nats by which it leads what was named, prior odds in, and the
    log evidence. stage, acts_on: where it lives; term, unit: the name of what it comes to; repaired: the fit with it.
    """

    stage: ClassVar[str]
    acts_on: ClassVar[str]
    term: ClassVar[str]
    unit: ClassVar[str]

    mean: float
    sd: float
    lead: float
    log_evidence: float
    beside: str  # what else is in the model
    repaired: Repaired = field(repr=False, compare=False)

    @property
    def clear(self) -> bool:
        """Whether the recordings tell it from what was named; with less of a lead it may still be the likelier one."""
        return self.lead > CLEAR

    @abstractmethod
    def note(self) -> str:
        """One line on it."""

    def repair(self, partial: str) -> dict[str, Any]:
        """The "repair" of diagnosis.json (see `unknown.repair`)."""
        likely = 1.0 / (1.0 + math.exp(-min(self.lead, 500.0)))
        term = {"term": self.term, "mean": self.mean, "sd": self.sd, "unit": self.unit, "inclusion_probability": likely}
        return {"stage": self.stage, "acts_on": self.acts_on, "form": self.form(), "terms": [term], "partial": partial,
                "beside": self.beside}  # fmt: skip

    @abstractmethod
    def form(self) -> str:
        """What it does, in words."""

    @property
    def _explains(self) -> str:
        return "explains the recordings" if self.beside == NONE else f"beside {self.beside} explains the recordings"


@dataclass(frozen=True)
class Claimed:
    """What is named, for something unlisted to be held against: its effects, log evidence with log prior odds.

    ahead: nats by which something unknown leads the best partial explanation, which stands for it.
    """

    weighed: Weighed
    weight: float
    ahead: float
    naming: Naming
    singles: int

    @staticmethod
    def of(naming: Naming, named: str) -> Claimed | None:
        """The physics of a verdict; None where it claims none, or no voltage was applied."""
        best = naming.best.weighed
        if named == NONE or not any(p.nodes is not None for p in best.fit.problem.pieces):
            return None
        if named not in naming.log_evidence or (named != UNKNOWN and named not in naming.weighed):
            return None
        weighed = best if named == UNKNOWN else naming.weighed[named]
        odds, singles = prior_odds(), sum("+" not in n for n in naming.weighed)
        prior = odds.unknown if named == UNKNOWN else odds.of(len(weighed.effects), singles)
        evidence = naming.log_evidence[named]
        ahead = max(evidence - best.log_evidence, 0.0) if named == UNKNOWN else 0.0
        weight = evidence + math.log(prior)
        if named == UNKNOWN:
            # readings may say so by themselves, of recordings that something on the list explains
            weight = max(weight, *naming.log_weight.values())
        return Claimed(weighed, weight, ahead, naming, singles)

    @property
    def effects(self) -> tuple[str, ...]:
        """Those that are claimed; of something unknown, those of the best partial explanation."""
        return self.weighed.effects

    def without(self, replaced: Iterable[str], prior: NoisePrior) -> Weighed | None:
        """The same but for some of the effects: as it was weighed, or refitted; None where it has no answer."""
        none = self.naming.none.weighed
        rest = [e for e in self.effects if e not in replaced]
        known = self.naming.weighed.get("+".join(rest)) if rest else none
        if known is not None and (known.refitted or not rest):
            return known
        own = {p.name: p for p in self.weighed.fit.problem.model.parameters}
        model = extended(none.fit.problem.model, rest, own)
        return None if model is None else within(self.weighed, none.fit, model, prior)

    def out_of_reach(self, rest: Weighed, prior: NoisePrior) -> float:
        """The value (see `Weighed`) above which something unlisted beside what stays can be no rival of what is named,
        even at a time constant or frequency that is off by a step of a first look."""
        reached, left = (value_at(w.fit.problem, w.fit.q, prior.start()) for w in (self.weighed, rest))
        reached -= self.ahead
        near = reached + OFF * max(left - reached, 0.0)
        return hopeless(near, sum(p.blocks.n for p in rest.fit.problem.pieces))

    def cost(self, rest: Weighed) -> float:
        """Log prior odds of something unlisted beside what stays, less the weight of what is named."""
        return math.log(prior_odds().of(len(rest.effects), self.singles) * PRIOR) - self.weight


def clearest(found: Iterable[Unlisted | None]) -> Unlisted | None:
    """The one that leads by most; None without any."""
    return max((f for f in found if f is not None), key=lambda f: f.lead, default=None)

"""What has been weighed so far: which of it counts as physics, and with what prior odds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.reduced import Piece
from ...gauss_newton.refit import Fit
from ..where.size import effect_size, size_elsewhere
from .hypotheses import DELAY, Odds
from .once import Once
from .phase import below_a_sample
from .slow_start import sized_start
from .stand_ins import with_true_modes
from .weigh import Weighed

#: nats by which a fit from elsewhere has to beat the one that was weighed; the same where its maximum is higher by as
#: many: that is no matter of how an evidence is worked out
_CLEARLY, _HIGHER = 10.0, 3.0
#: nats of posterior density by which a descent that ended elsewhere is told from one that ended a little early
_LOWER = 1.0
#: nats that may well be chance (20 to 1, and there are twenty effects): less is no lead
SLIGHT = 3.0
#: nats by which an effect has to be ahead of what lacks it for a mode that does its work to be looked for
_NEEDED = 5.0


@dataclass(frozen=True)
class Known:
    """Hypotheses by name.

    none: the base alone; singles: number of effects that may be added to it; elsewhere: displacements that were not
    fitted, of which the commands alone are used: an effect is as large as on the recording that it moves most. noise:
    its prior, with which an effect is held against modes that are none of its own making (`stand_ins`). sized: the
    base fitted with gains that keep to what the sensor states, where its own do not (`slow_start`). nothing_left:
    effects of explanations that leave nowhere as much as the sensor resolves. What is found in that is as small; that
    it would be larger on recordings that were not fitted is for these to say (`second_look`).
    """

    none: Weighed
    resolution_m: float
    odds: Odds
    singles: int
    elsewhere: Sequence[Piece] = ()
    weighed: dict[str, Weighed] = field(default_factory=dict)
    noise: NoisePrior | None = None
    sized: Fit | None = None
    nothing_left: tuple[frozenset[str], ...] = ()
    _gains_kept: Once[Fit | None] = field(default_factory=Once, repr=False)
    _sizes: Once[float] = field(default_factory=Once, repr=False)
    _sizes_elsewhere: Once[float] = field(default_factory=Once, repr=False)

    def take(self, found: Iterable[Weighed]) -> None:
        """Add hypotheses that were weighed in full; one that is known from a better place stays what it was.

        The same maximum weighed again replaces what it was taken for: an evidence drawn along a ridge is the finer one.
        """
        for w in found:
            before = self.weighed.get(w.name)
            if before is None or w.log_evidence > before.log_evidence - (0.0 if _lower(w, before) else _CLEARLY):
                self.weighed[w.name] = w

    def take_from_elsewhere(self, found: Sequence[Weighed]) -> list[Weighed]:
        """Add those that are clearly better than what is known, and return them.

        Theirs are Laplace's evidences, which overstate along ridges; a maximum that is higher is another matter.
        """
        for w in found:
            before = self.weighed.get(w.name)
            if before is None or w.log_evidence > before.log_evidence + _least_gain(w, before):
                self.weighed[w.name] = w
        return [w for w in found if self.weighed[w.name] is w]

    @property
    def counting(self) -> list[Weighed]:
        """Those that change enough to be claimed as physics."""
        return [w for w in self.weighed.values() if self.enough(w)]

    def enough(self, w: Weighed) -> bool:
        """Whether it changes as much as the sensor resolves, or explains more than one of its kind that does.

        What a grid calls hopeless has the fit of another one, and changes nothing of its own.
        """
        return w.refitted and (self._large(w) or any(self._large(v) for v in self.poorer(w)))

    def share(self, w: Weighed) -> float:
        """Prior odds of one hypothesis, by what its delay is after the recordings."""
        return sum(shares(w, self.odds, self.singles))

    def timing(self, w: Weighed) -> float:
        """Probability that what a hypothesis has of a delay is a shift of less than one sample, which is no physics."""
        physics, timing = shares(w, self.odds, self.singles)
        return timing / (physics + timing)

    def physics(self, w: Weighed) -> int:
        """Number of effects of a hypothesis without a delay that is more likely a shift of less than one sample."""
        return len(w.effects) - (DELAY in w.effects and self.timing(w) > 0.5)

    def weight(self, w: Weighed) -> float:
        """Log evidence and log prior."""
        return w.log_evidence + math.log(self.share(w))

    def poorer(self, w: Weighed) -> list[Weighed]:
        """Refitted hypotheses of as many effects that explain less, but clearly more than those of fewer do."""
        count = len(w.effects)
        if w.fit is self.none.fit or count == 0:
            return []
        others = self.weighed.values()
        fewer = [v.log_evidence for v in others if len(v.effects) == count - 1] if count > 1 else []
        least = max(fewer, default=self.none.log_evidence) + SLIGHT
        alike = [v for v in others if len(v.effects) == count and v.fit is not self.none.fit and v is not w]
        return [v for v in alike if least < v.log_evidence <= w.log_evidence]

    def _large(self, w: Weighed) -> bool:
        if w.size_m >= self.resolution_m or w.fit is self.none.fit:
            return w.size_m >= self.resolution_m
        sizes = (self._elsewhere, self._with_gains_kept, self._with_modes_kept)
        return any(size(w) >= self.resolution_m for size in sizes)

    def _unseen(self, w: Weighed) -> Sequence[Piece]:
        """Recordings that were not fitted, where its size on these counts."""
        return () if any(effects < set(w.effects) for effects in self.nothing_left) else self.elsewhere

    def _elsewhere(self, w: Weighed) -> float:
        """Its size (m) on recordings that were not fitted; of several effects, that of the one that matters least."""
        if not self._unseen(w):
            return 0.0
        simpler = self._simpler(w) if self.physics(w) > 1 else None
        without = self.none.fit if simpler is None else simpler.fit
        return self._sizes_elsewhere((w.fit, without), lambda: size_elsewhere(without, w.fit, self.elsewhere))

    def _with_gains_kept(self, w: Weighed) -> float:
        """Its size (m) against what lacks it without a gain that no sensor has; 0 where that has none, or is no worse.
        """
        simpler = self._simpler(w)
        if simpler is None or w.log_evidence < simpler.log_evidence + _NEEDED:
            return 0.0
        sized = self._with_stated_gains(simpler)
        return 0.0 if sized is None else self._sizes((w.fit, sized), lambda: effect_size(sized, w.fit))

    def _with_stated_gains(self, w: Weighed) -> Fit | None:
        """A fit again with gains that keep to what the sensor states; None where its own do."""
        if w is self.none:
            return self.sized
        noise = self.noise
        return None if noise is None else self._gains_kept((w.fit,), lambda: sized_start(w.fit, noise, []))

    def _with_modes_kept(self, w: Weighed) -> float:
        """Its size (m) against what lacks it, whose fastest mode is kept from doing its work; 0 where not known."""
        simpler, noise, unseen = self._simpler(w), self.noise, self._unseen(w)
        if noise is None or simpler is None or w.log_evidence < simpler.log_evidence + _NEEDED:
            return 0.0

        def size() -> float:
            held = with_true_modes(w.fit, simpler.fit, noise)
            return 0.0 if held is None else max(effect_size(held, w.fit), size_elsewhere(held, w.fit, unseen))

        return self._sizes((w.fit, simpler.fit, unseen), size)

    def _simpler(self, w: Weighed) -> Weighed | None:
        """The likeliest that lacks one of its effects."""
        if len(w.effects) == 1:
            return self.none
        fewer = [
            v for v in self.weighed.values()
            if v.refitted and len(v.effects) == len(w.effects) - 1 and set(v.effects) < set(w.effects)
        ]  # fmt: skip
        return max(fewer, key=lambda v: v.log_evidence, default=None)


def shares(w: Weighed, odds: Odds, candidates: int) -> tuple[float, float]:
    """Prior odds of a hypothesis as physics, and as the same without its delay on a bench that reads off time."""
    plain = odds.of(len(w.effects), candidates)
    found = below_a_sample(w.fit) if DELAY in w.effects and w.refitted else None
    if found is None:
        return plain, 0.0
    if found.even is None:
        return plain * (1.0 - found.probability), plain * found.probability
    bare = odds.of(len(w.effects) - 1, candidates)
    return plain * (1.0 - found.probability), bare * odds.shift * found.even


def _lower(w: Weighed, before: Weighed) -> bool:
    """Whether the maximum of one fit of a hypothesis is clearly lower than that of another."""
    return before.refitted and w.fit.objective > before.fit.objective + _LOWER


def _least_gain(w: Weighed, before: Weighed) -> float:
    """Nats of evidence by which one fit of a hypothesis has to beat another."""
    higher = before.refitted and before.fit.objective - w.fit.objective
    return _HIGHER if higher > _HIGHER else _CLEARLY

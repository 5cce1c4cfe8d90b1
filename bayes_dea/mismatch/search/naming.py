"""What explains the recordings, how adequate that is, and the probabilities of every hypothesis."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit
from ..telling import Tell, silence
from ..where.discrepancy import Discrepancy, discrepancy
from ..where.locate import ADEQUATE, Places, Scan, scan
from .hypotheses import NONE, UNKNOWN, Odds
from .known import Known
from .places import with_free_places
from .relabel import FURTHER
from .weigh import Weighed

Array = NDArray[np.float64]

#: nats behind at which a probability is zero in floating point
_UNDERFLOW = -700.0
#: probability from which on the freedom of a hypothesis with a further mode is that of the one without it, too
_WORTH_FREEING = 0.01
#: nats behind up to which it matters which of its modes a hypothesis calls the further one: the priors of the places
#: may speak for another labelling than the one that was found, by so much
WORTH_LABELLING = 12.0
#: probability that a mismatch is nothing where a scan refutes the explanation just so
_LEFT = 0.2
#: probability that one below what the sensor resolves is something all the same
_SOMETHING = 0.2
#: scatter of readings, in steps, whose noise is half a step beside the rounding's own 1/sqrt(12)
_ROUNDED = math.sqrt(0.25 + 1.0 / 12.0)


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
    timing: dict[str, float] = field(default_factory=dict)  # that a name's delay is below one sample, and no physics
    put_off: bool = False  # further effects promise something, and another reading more

    def likely(self, least: float, most: int) -> tuple[Fit, ...]:
        """Fits of what has a probability of `least` and more, the best explanation first; so many at most."""
        names = sorted((n for n, p in self.probability.items() if p >= least), key=lambda n: -self.probability[n])
        others = [self.weighed[n] for n in names if n in self.weighed]
        fits = [self.best.weighed.fit, *(w.fit for w in others if w.refitted and w is not self.best.weighed)]
        return tuple(fits[:most])


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


def but_for_what_is_too_small(
    best: Explanation, known: Known, explained: Callable[[Weighed], Explanation]
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
    beside = explained(max(small, key=lambda w: w.log_evidence))
    return replace(best, discrepancy=beside.discrepancy, small=beside.weighed) if beside.adequate else best


def log_probabilities(
    known: Known, none: Explanation, explained: Sequence[Explanation], odds: Odds, noise: NoisePrior,
    labelled: Mapping[str, Sequence[Fit]],
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Log evidence, its error, and log evidence with prior odds (not normalised), of every hypothesis by its name.

    What explains less than the resolution is not claimed as physics. That the modes of the base lie elsewhere than
    expected speaks for no further one (`places`); which of them is the further one is anybody's guess, so that all
    labellings count together. labelled: of those that matter, by name, the found one first (`relabel.labellings`).
    """
    # what all labellings have beyond the one that was found
    further_by = {
        name: float(logsumexp([f.log_evidence - fits[0].log_evidence for f in fits])) for name, fits in labelled.items()
    }
    evidence = {NONE: none.weighed.log_evidence}
    error = {NONE: none.weighed.log_evidence_se}
    prior_of = {NONE: odds.none, UNKNOWN: odds.unknown}
    for w in known.counting:
        evidence[w.name] = w.log_evidence + further_by.get(w.name, 0.0)
        error[w.name] = w.log_evidence_se
        prior_of[w.name] = known.share(w)
    beside = [e for e in explained if e.discrepancy is not None]
    unlisted = max(beside, key=lambda e: _with_discrepancy(e) + math.log(known.share(e.weighed)))
    evidence[UNKNOWN] = _with_discrepancy(unlisted) + further_by.get(unlisted.weighed.name, 0.0)
    # something unlisted beside what is listed takes both; else it would beat what is listed wherever nobody can see it
    prior_of[UNKNOWN] = odds.unknown / odds.none * known.share(unlisted.weighed)
    error[UNKNOWN] = 0.5

    def weights() -> dict[str, float]:
        return {k: evidence[k] + math.log(prior_of[k]) for k in evidence}

    least = max(weights().values()) + math.log(_WORTH_FREEING)
    further = [
        replace(w, fit=max(labelled.get(w.name, (w.fit,)), key=lambda f: f.log_evidence))
        for w in known.counting if FURTHER in w.effects and weights()[w.name] > least
    ]  # fmt: skip
    evidence = with_free_places(evidence, further, noise)
    return evidence, error, weights()


def _with_discrepancy(e: Explanation) -> float:
    """Log evidence of an explanation with a discrepancy, to which taking what no sensor resolves is no merit."""
    assert e.discrepancy is not None
    return e.weighed.log_evidence + (min(e.discrepancy.gain, 0.0) if e.below_a_step else e.discrepancy.gain)


def across_readings(naming: Naming, log_odds: float, other: Naming) -> Naming:
    """The same with what each name weighs under another reading of the same recordings, where that leaves nothing, too.

    Of two readings the likelier is gone on with; what only the other one needs is a rival all the same. log_odds: of
    the reading of `naming` before the recordings were seen.
    """
    if not (naming.best.adequate and other.best.adequate):
        return naming
    weight = {
        k: float(np.logaddexp(w + log_odds, other.log_weight.get(k, -math.inf))) for k, w in naming.log_weight.items()
    }
    total = float(logsumexp(list(weight.values())))
    return replace(naming, log_weight=weight, probability={k: math.exp(w - total) for k, w in weight.items()})


def beside_another_channel(naming: Naming, nats: Mapping[str, float]) -> Naming:
    """The same with the evidence (nats by name) that another channel adds to each."""
    added = {k: nats.get(k, 0.0) for k in naming.log_weight}
    weight = {k: w + added[k] for k, w in naming.log_weight.items()}
    top = max(naming.log_weight.values())

    def log_p_of(name: str) -> float:
        """Of a probability that adequacy has had its say in; what is too far behind for one is where it is."""
        p, behind = naming.probability.get(name, 0.0), naming.log_weight[name] - top
        return math.log(p) if p > 0.0 else behind if behind < _UNDERFLOW else -math.inf

    log_p = {k: log_p_of(k) + added[k] for k in naming.log_weight}
    total = float(logsumexp(list(log_p.values())))
    return replace(
        naming,
        log_evidence={k: e + added[k] for k, e in naming.log_evidence.items()},
        log_weight=weight,
        probability={k: math.exp(v - total) for k, v in log_p.items()},
    )


def with_adequacy(
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

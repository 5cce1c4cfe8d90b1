"""Which physics was left out: probabilities over every hypothesis, "none" and "unknown" among them.

Single effects first; where the best of them is not adequate, a second one (and a third) beside it. "unknown" is a
smooth discrepancy beside the best named explanation. Prior odds stand in priors/diagnosis/hypotheses.toml.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..campaign.schema import Campaign
from ..models.effects import registered_effects
from ..models.model import Model, build_model
from ..priors import Prior, prior_folder
from .discrepancy import Discrepancy, basis, discrepancy
from .features import Features
from .locate import Scan, scan
from .noise_prior import NoisePrior
from .refit import Fit
from .relabel import FURTHER, in_place_of_one, without_one, without_stand_in
from .relocate import relocated
from .ridge import integrated
from .slow_start import LIMITS, low_start, slow_start
from .weigh import (
    HOPELESS,
    Frame,
    Screened,
    Weighed,
    effect_size,
    escape,
    improved,
    moved_to,
    own_index,
    refine,
    screen,
)

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]

NONE, UNKNOWN, MAINS = "none", "unknown", "mains_pickup"
#: below this p-value of the scan an explanation is not adequate
ADEQUATE = 1e-3
#: how many hypotheses are refitted after the grid, how near in nats to the best others must come, and the least gain
_REFITTED, _NEAR, _LEAST_GAIN = 6, 30.0, 1.0
#: an effect could be seen where its likelihood varies by so many nats over its grid
_VISIBLE = 5.0
#: nats behind the best within which an effect of several parameters is weighed along its ridge
_RIVALS = 12.0
#: standard error of an evidence from which on it is a grid's
_DOUBTFUL = 0.4
#: how many of the leading ones are searched around
_ESCAPES = 4


#: laws of one effect beside its plain one, as priors of parameters that are fixed there: a leak that the field
#: activates, R_l exp(-sqrt(E/E_0)), with E_0 as of a Poole-Frenkel law in silicone (catalogue of missing physics, E7)
VARIANTS: dict[str, dict[str, Prior]] = {
    "leakage": {"E_0_V_per_m": Prior("loguniform", 1e6, 1e7), "R_leak_ohm": Prior("loguniform", 1e6, 1e12)},
}


#: nats by which a fit from elsewhere has to beat the one that was weighed
_CLEARLY = 10.0
#: the damping of a mass and a damper in parallel are one and the same number
SAME = {"inertia", "parallel_damper"}


@dataclass(frozen=True)
class Explanation:
    """A weighed hypothesis with its adequacy."""

    weighed: Weighed
    scan: Scan
    discrepancy: Discrepancy | None = None  # of what is adequate and of the best only: beside a poor fit it is dear

    @property
    def adequate(self) -> bool:
        """Whether nothing significant is left in its residuals."""
        return self.scan.p_value > ADEQUATE


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
    visible: tuple[str, ...] = ()  # single effects that these recordings would show at some strength


def prior_odds() -> dict[str, float]:
    """Prior odds of the kinds of hypotheses: none, unknown, one effect, two effects (shares of one)."""
    with (prior_folder() / "diagnosis" / "hypotheses.toml").open("rb") as file:
        table = tomllib.load(file)
    return {k: float(v) for k, v in table["prior_odds"].items()}


def candidates(
    base: Model, campaign: Campaign, channels: set[str], established: Sequence[str] = ()
) -> tuple[list[str], dict[str, str]]:
    """Effects that may be added to the base on these recordings, and why the others may not.

    established: effects that the readings themselves have shown already.
    """
    out, skipped = [], {}
    for name, effect in registered_effects().items():
        if name in base.spec.effects:
            skipped[name] = "is in the model already"
        elif name in established:
            skipped[name] = "is established by the readings themselves"
        elif name == MAINS:
            continue  # part of the noise model of every hypothesis
        elif "displacement" not in channels and "mechanical" not in effect.acts_on:
            skipped[name] = "acts on voltage recordings alone, and there are none"
        elif any(not any(c in r.columns for r in campaign.recordings) for c in effect.needs):
            skipped[name] = f"needs a column {', '.join(effect.needs)}"
        else:
            out.append(name)
    return out, skipped


def effect_priors(names: Sequence[str], campaign: Campaign) -> dict[str, object]:
    """Priors of effects that depend on the campaign (its largest command, its longest recording), by parameter."""
    out: dict[str, object] = {}
    for name in names:
        out.update(registered_effects()[name].prior_for(campaign))
    return out


def extended(base: Model, effects: Sequence[str], overrides: Mapping[str, object]) -> Model | None:
    """The base with effects, in the order of their stages; None where they do not go together."""
    from ..errors import InputError

    order = list(registered_effects())
    names = sorted({*base.spec.effects, *effects}, key=order.index)
    plain = [p for p in base.spec.name.split("+") if p not in base.spec.effects]
    try:
        model = build_model("+".join(plain + names))
    except InputError:
        return None
    own = {p.name: p for p in base.parameters}
    known = {p.name for p in model.parameters}
    given = {
        **{k: v for k, v in own.items() if k in known},
        **{k: v for k, v in overrides.items() if k in known and k not in own},
    }
    return build_model("+".join(plain + names), given)  # type: ignore[arg-type]


def explain(
    weighed: Weighed, looks: list[Features], columns: list[Array], rng: np.random.Generator, prior: NoisePrior
) -> Explanation:
    """A hypothesis with its adequacy and, where it is adequate, what a discrepancy would add."""
    found = Explanation(weighed, scan(weighed.fit, rng, looks))
    return replace(found, discrepancy=discrepancy(weighed.fit, columns, prior)) if found.adequate else found


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
) -> Naming | None:
    """Weigh all hypotheses on the recordings to identify.

    spoiled: asked of the fits that may explain the recordings, before they are judged; where it says yes, the data are
    to be made clean first, and None is returned.
    """
    say = report or (lambda *_: None)
    columns = basis(base, looks)
    model = base.problem.model
    frames = frames_of(base, looks, prior)
    none = Explanation(Weighed((), base, base.log_evidence, 0.1, 0.0), scan(base, rng, looks))
    names, skipped = candidates(model, campaign, {p.channel for p in base.problem.pieces}, established)
    given: dict[str, object] = {**effect_priors(names, campaign), **(overrides or {})}
    low = None
    if not none.adequate and any(n in LIMITS for n in names):
        level = typical(base)
        level[model.dimension + base.problem.zero_mean.size :] = 0.0
        low = low_start(base, prior, [level])
    limited = [] if low is None else [Frame(replace(low, noise=prior.start()), far=True)]
    found = _singles([*frames, *limited], len(frames), model, names, given, say, memory)
    visible = tuple("+".join(s.effects) for s in found if s.contrast > _VISIBLE)
    weighed = _refined(base, found, prior, say, 2, rng, spoiled)
    if weighed is None:
        return None
    odds = prior_odds()

    def enough(w: Weighed) -> bool:
        return w.size_m >= resolution_m

    singles = max(len(names), 1)

    def share(w: Weighed) -> float:
        return odds["single" if len(w.effects) == 1 else "double"] / singles

    def weight(w: Weighed) -> float:
        return w.log_evidence + math.log(share(w))

    def thoughts(w: Weighed) -> Weighed:
        """The same, or what is likelier once no mode of the base stands in for another effect."""
        more = [t for t in _second_thoughts(w, none.weighed.fit, model, names, prior, given, say, rng) if enough(t)]
        for t in more:
            # these are Laplace's evidences, which overstate along ridges
            if t.name not in weighed or t.log_evidence > weighed[t.name].log_evidence + _CLEARLY:
                weighed[t.name] = t
        return max([w, *(t for t in more if weighed[t.name] is t)], key=weight)

    ranked = sorted((w for w in weighed.values() if enough(w)), key=lambda w: -w.log_evidence)
    best = none
    others: list[Explanation] = []
    if ranked and ranked[0].log_evidence > none.weighed.log_evidence - 3.0:
        say("checking what is left", 0, 1, ranked[0].name)
        if spoiled is not None and spoiled(ranked[0].fit):
            return None
        best = explain(thoughts(ranked[0]), looks, columns, rng, prior)
        others.append(best)
    # more than one effect, where one is not enough
    for _ in range(most_effects):
        gain = best.discrepancy.gain if best.discrepancy else 0.0
        if (best.adequate and gain < 5.0) or not 1 <= len(best.weighed.effects) < most_effects:
            break
        if best.weighed.log_evidence < none.weighed.log_evidence:
            break
        more = _beside(best.weighed, model, names, prior, given, say, rng)
        weighed.update({w.name: w for w in more})
        more = [w for w in more if enough(w)]
        if not more:
            break
        top = max(more, key=lambda w: w.log_evidence)
        if top.log_evidence < best.weighed.log_evidence + 3.0 + math.log(odds["single"] / odds["double"]):
            break
        if spoiled is not None and spoiled(top.fit):
            return None
        top = thoughts(top)
        best = explain(top, looks, columns, rng, prior)
        others.append(best)
    # what explains less than the resolution is not claimed as physics
    evidence = {NONE: none.weighed.log_evidence}
    error = {NONE: none.weighed.log_evidence_se}
    prior_of = {NONE: odds["none"], UNKNOWN: odds["unknown"]}
    for w in weighed.values():
        if not enough(w):
            continue
        evidence[w.name], error[w.name] = w.log_evidence, w.log_evidence_se
        prior_of[w.name] = share(w)
    if best.discrepancy is None:
        # what imitated something that was left out has to find back
        starts = [f.fit.q for f in frames[1:]] if best is none else []
        best = replace(best, discrepancy=discrepancy(best.weighed.fit, columns, prior, starts))
        none = best if best.weighed is none.weighed else none
    evidence[UNKNOWN] = max(
        e.weighed.log_evidence + e.discrepancy.gain for e in (best, *others) if e.discrepancy is not None
    )
    error[UNKNOWN] = 0.5
    log_p = {k: evidence[k] + math.log(prior_of[k]) for k in evidence}
    total = float(logsumexp(list(log_p.values())))
    probability = {k: math.exp(v - total) for k, v in log_p.items()}
    probability = _with_adequacy(probability, best)
    return Naming(none, best, weighed, evidence, error, probability, log_p, skipped, visible)


def _with_adequacy(probability: dict[str, float], best: Explanation) -> dict[str, float]:
    """Where the best named explanation leaves a mismatch that no smooth discrepancy takes, it is unknown."""
    if best.adequate:
        return probability
    left = min(1.0, best.scan.p_value / ADEQUATE) * 0.2
    named = sum(v for k, v in probability.items() if k != UNKNOWN)
    if named <= left:
        return probability
    out = {k: v * left / named for k, v in probability.items() if k != UNKNOWN}
    out[UNKNOWN] = 1.0 - left
    return out


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


def _refined(
    base: Fit,
    screened: list[Screened],
    prior: NoisePrior,
    say: Report,
    starts: int,
    rng: np.random.Generator,
    spoiled: Callable[[Fit], bool] | None = None,
) -> dict[str, Weighed] | None:
    """Refits of what the grid calls promising; the rest keep the grid's evidence and claim nothing.

    None where the first of them shows readings that are false.

    The grid moves the base linearly and errs where that is far; so refits go down its order until what it promises is
    less than what a refit has reached.
    """
    out: dict[str, Weighed] = {}
    of: dict[str, Screened] = {}
    reached, best = 0.0, math.inf
    for k, s in enumerate(sorted(screened, key=lambda s: -s.gain)):
        name = "+".join(s.effects)
        say("refitting", k, len(screened), name)
        promising = s.gain > _LEAST_GAIN and (k < _REFITTED or s.gain > reached - _NEAR)
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
        # laws of one effect share its prior, and the likelier stands for it
        laws = sum(o.effects == s.effects for o in screened)
        w = replace(w, log_evidence=w.log_evidence - math.log(laws), shared_prior=-math.log(laws))
        if name not in out or _hopeful(w, base) > _hopeful(out[name], base):
            out[name], of[name] = w, s
    settled: set[str] = set()
    for _ in range(_ESCAPES):  # the leading ones may still sit in a local maximum
        leading = sorted((n for n, w in out.items() if w.fit is not base), key=lambda n: out[n].fit.objective)[:2]
        waiting = [n for n in leading if n not in settled]
        if not waiting:
            break
        found = escape(base, of[waiting[0]], out[waiting[0]], prior)
        elsewhere = relocated(found.fit, prior)
        if elsewhere is not found.fit:
            found = escape(base, of[waiting[0]], improved(found, base, of[waiting[0]], elsewhere), prior)
        out[waiting[0]] = found
        settled.add(waiting[0])
    top = max((_hopeful(w, base) for w in out.values()), default=0.0)
    for name, w in out.items():  # rivals that are near are weighed along their ridges
        own = own_index(base, of[name].model)
        narrow = own.size < 2 and w.log_evidence_se < _DOUBTFUL
        if w.fit is base or _hopeful(w, base) < top - _RIVALS or narrow or own.size > 4:
            continue
        better = integrated(w.fit, own, rng)
        if better is not None:
            out[name] = replace(w, log_evidence=better[0] + w.shared_prior, log_evidence_se=better[1])
    return out


def _hopeful(w: Weighed, base: Fit) -> float:
    """Log evidence that a hypothesis may have: a grid that is too coarse for its peak says less."""
    return w.log_evidence if w.fit is base else max(w.log_evidence, w.fit.log_evidence + w.shared_prior)


def _singles(
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


def _second_thoughts(
    w: Weighed, base: Fit, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object],
    say: Report, rng: np.random.Generator,
) -> list[Weighed]:
    """Rivals that are looked for from where an explanation stands.

    Of several effects each is left out: a fit of one alone may have ended where the other was needed. A mode of the
    base may have gone astray, and then a further one does its work; or it stands in for another effect (a mode far
    faster than the sampling is a damper), and then that effect is looked for in its place.
    """
    out: list[Weighed] = []
    laws = {**overrides, **_law_of(w)}
    for dropped in w.effects if len(w.effects) > 1 else ():
        m = extended(model, [n for n in w.effects if n != dropped], laws)
        alone = without_one(w, dropped, base, m, prior) if m is not None else None
        if alone is not None:
            out.append(alone)
    others = [n for n in w.effects if n != FURTHER]
    if len(others) == len(w.effects):
        return out
    m = extended(model, others, laws) if others else model
    if m is None:
        return out
    simpler = in_place_of_one(w, base, m, prior)
    if simpler is not None and simpler.effects:
        out.append(simpler)
    without = without_stand_in(w, m, prior)
    if without is not None:
        start = Weighed(tuple(others), without, without.log_evidence, 0.1, 0.0)
        found = _beside(start, model, [n for n in names if n != FURTHER], prior, overrides, say, rng)
        compared = simpler.fit if simpler is not None else base
        out += [replace(t, size_m=effect_size(compared, t.fit)) for t in found if t.fit is not without]
    return out


def _law_of(w: Weighed) -> dict[str, Prior]:
    """Priors of the law that a weighed effect was given, where that is not the plain one."""
    free = w.fit.problem.model.priors.names
    laws = [VARIANTS[name] for name in w.effects if name in VARIANTS]
    return {p: prior for law in laws if all(p in free for p in law) for p, prior in law.items()}


def _beside(
    best: Weighed, model: Model, names: list[str], prior: NoisePrior, overrides: Mapping[str, object], say: Report,
    rng: np.random.Generator,
) -> list[Weighed]:
    """Every further effect beside the ones found."""
    frame = Frame(best.fit)
    found = []
    rest = [n for n in names if n not in best.effects and not any({n, e} == SAME for e in best.effects)]
    order = list(registered_effects())
    overrides = {**overrides, **_law_of(best)}
    for k, name in enumerate(rest):
        effects = tuple(sorted((*best.effects, name), key=order.index))
        say("weighing pairs", k, len(rest), "+".join(effects))
        m = extended(model, effects, overrides)
        s = screen([frame], m, effects, sparse=True) if m is not None else None
        if s is not None:
            found.append(s)
    return list((_refined(best.fit, found, prior, say, 1, rng) or {}).values())

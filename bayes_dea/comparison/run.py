"""The road from a campaign and a list of structures to an answer: fit, weigh, leave out, say."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Campaign
from ..errors import InputError
from ..likelihood.remembering import forget
from ..models.model import Model, build_model
from ..priors import Parameter, Prior, hint
from ..run_state import Checkpoints, checkpoint_for
from .align import aligned
from .anneal import QUICK
from .common import CommonData, check_same_likelihood, common_data
from .fit_one import Fitted, Say, fit_one, linear_partner, residual_at, simulated_fit
from .integrate import Integral, IntegralSettings, bridged, integrate
from .kept import Done, keep, recall
from .leave_out import score_left_out
from .names import expand
from .richer import richer_starts, smaller
from .same import corner_of, exact_groups, reparameterised
from .simulated import SimulatedSettings, Survey, integral_of

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]


@dataclass(frozen=True)
class ComparisonSettings:
    """workers: threads; near_nats: models this close to the best get their evidence from a long run and a bridge.

    hopeless_nats: no evidence is larger than the largest likelihood; a model whose likelihood is this far below the
    evidence of another one gets no more than importance draws; far_nats: how far behind Laplace's evidence of the best
    an annealed evidence is left with a larger error. simulated: how models are worked out whose every draw
    costs a simulation.
    """

    workers: int = 1
    near_nats: float = 5.0
    hopeless_nats: float = 100.0
    far_nats: float = 8.0
    integral: IntegralSettings = IntegralSettings()
    simulated: SimulatedSettings = SimulatedSettings()


@dataclass(frozen=True)
class Comparison:
    """What a comparison found. `summary` is comparison.json; `done` every model that was fitted, by name."""

    done: Mapping[str, Done] = field(repr=False)
    summary: dict[str, Any]

    @property
    def best(self) -> str:
        """Name of the model that the recordings support most."""
        return str(self.summary["ranking"][0]["model"])

    def save(self, out: str | Path) -> Path:
        """Write comparison.json and report.html into a folder; returns it."""
        from .store import save_comparison

        return save_comparison(self, Path(out))


def compare(
    campaign: Campaign,
    models: str | Sequence[str],
    seed: int = 1,
    settings: ComparisonSettings | None = None,
    priors: Mapping[str, Parameter | Prior] | None = None,
    report: Report | None = None,
    checkpoints: str | Path | Checkpoints | None = None,
    anew: bool = False,
    again: Sequence[str] = (),
) -> Comparison:
    """Compare model structures on the recordings of a campaign, by evidence and by prediction.

    models: SPECs, as a list or in one text (``"hooke+gm1..6,yeoh+gm3"``, ``"all"``). priors: overrides by parameter
    name, for the models that have it. checkpoints: folder where each finished model is kept, so that a run that was
    interrupted goes on to the same numbers; anew: do not go on. again: words by which another command takes the same
    campaign and priors. Raises InputError for lists and campaigns that cannot be compared.
    """
    from .summary import summarise

    s = settings or ComparisonSettings()
    say = report or (lambda *_: None)
    began = time.perf_counter()
    names = expand(models, campaign)
    built = built_models(names, priors)
    data = common_data(campaign, list(built.values()), s.workers)
    groups = exact_groups(names)
    chosen = [_representative(g, built) for g in groups]
    order = [n for g, c in zip(groups, chosen, strict=True) for n in g if n == c or not _derived(built, c, n)]
    # linear ones first: nonlinear laws start from them
    order.sort(key=lambda n: (bool(built[n].spec.effects), not built[n].is_linear))
    done: dict[str, Done] = {}
    starts: dict[str, Fitted] = {}
    laps = {"assemble": 0.0}
    paths: dict[str, Path] = {}
    for i, name in enumerate(order):
        say("reading noise", i, len(order), name)
        lap = time.perf_counter()
        assembled = data.assembled(built[name])
        laps["assemble"] += time.perf_counter() - lap
        if checkpoints is not None:
            paths[name] = checkpoint_for(checkpoints, identity(built[name], data.fingerprint, seed, s))
            if anew:
                paths[name].unlink(missing_ok=True)
            before = recall(paths[name], built[name], assembled)
            if before is not None:
                done[name] = before
                starts[name] = before.fit
    # all maxima first: which models are hopeless must not depend on the order in which they were named
    searched: dict[str, float] = {}
    for i, name in enumerate(order):
        if name in done or built[name].spec.effects:
            continue
        lap = time.perf_counter()
        _fit(built[name], data, seed, starts, _part(say, i, len(order), name))
        searched[name] = time.perf_counter() - lap
    laplace = [starts[name].laplace for name in order if name in starts]
    best = max((v for v in laplace if np.isfinite(v)), default=-np.inf)
    for i, name in enumerate(order):
        before = done.get(name)
        if before is not None and not (before.spared and not hopeless(before.fit, best, s)):
            continue
        found = _one(name, built[name], data, seed, s, starts, _within(say, i, len(order), name), best)
        found.seconds["map"] += searched.get(name, 0.0)
        if name in paths:
            keep(paths[name], found)
        done[name] = found
        starts.setdefault(name, found.fit)
    done = {name: done[name] for name in order}
    check_same_likelihood([d.fit.posterior for d in done.values()])
    lap = time.perf_counter()
    done = _bridge_the_near(done, data, built, seed, s, say, checkpoints, anew)
    laps["bridge"] = time.perf_counter() - lap
    for key in ("map", "evidence", "leave out"):
        laps[key] = sum(d.seconds.get(key, 0.0) for d in done.values())
    say("weighing", 0, 1, "")
    done, moved = aligned(done, data, built)
    summary = summarise(data, built, groups, chosen, done, np.random.default_rng([seed, 7]), again)
    laps["weigh"] = time.perf_counter() - lap - laps["bridge"]
    summary["aligned_nats"] = moved
    summary["seed"] = seed
    summary["seconds"] = time.perf_counter() - began
    summary["seconds_by"] = laps
    return Comparison(done, summary)


def built_models(
    names: Sequence[str], priors: Mapping[str, Parameter | Prior] | None = None
) -> dict[str, Model]:
    """Models by name, each with the overrides that concern it. Raises InputError for one that concerns none."""
    given = dict(priors or {})
    out = {}
    used: set[str] = set()
    for name in names:
        known = {p.name for p in build_model(name).parameters}
        own = {k: v for k, v in given.items() if k in known}
        used |= set(own)
        out[name] = build_model(name, own)
    lost = [k for k in given if k not in used]
    if lost:
        every = sorted({p.name for m in out.values() for p in m.parameters})
        raise InputError(f"prior for '{lost[0]}': none of the models has it{hint(lost[0], every)} They have "
                         f"{', '.join(every)}.")
    return out


def identity(model: Model, data: str, seed: int, s: ComparisonSettings) -> dict[str, Any]:
    """What a kept model depends on; data: fingerprint of the recordings."""
    return {
        "verb": "compare",
        "model": model.name,
        "seed": seed,
        "priors": {p.name: repr(p.prior) for p in model.parameters},
        "data": data,
        "settings": [repr(s.integral), repr(s.simulated)],
    }


def generator(seed: int, name: str, stage: int) -> np.random.Generator:
    """Random numbers of one stage of one model: the same whatever else is compared, in whatever order."""
    return np.random.default_rng([seed, zlib.crc32(name.encode()), stage])


def _representative(group: list[str], built: Mapping[str, Model]) -> str:
    """Which of several names for one function is worked out: one without effects where there is one."""
    return min(group, key=lambda n: (len(built[n].spec.effects), group.index(n)))


def _derived(built: Mapping[str, Model], chosen: str, name: str) -> bool:
    return reparameterised(built[chosen], built[name])


def _part(say: Report, i: int, n: int, name: str) -> Say:
    """Progress of one search as a part of all."""

    def tell(done: float, of: float, text: str) -> None:
        say("searching", i + min(done / of if of else 0.0, 1.0), n, f"{name}: {text}")

    return tell


def _within(say: Report, i: int, n: int, name: str) -> Report:
    """Progress of one model as a part of the whole."""

    def tell(phase: str, done: float, of: float, text: str) -> None:
        say("comparing", i + _SHARE[phase] + 0.33 * min(done / of if of else 0.0, 1.0), n, f"{name}: {phase} {text}")

    return tell


#: elements up to which swarms find the maximum
_SWARM_ELEMENTS = 3
_SHARE = {"searching": 0.0, "evidence": 0.33, "leaving out": 0.66}  # of one model; searches of most are done


def _one(
    name: str, model: Model, data: CommonData, seed: int, s: ComparisonSettings, starts: dict[str, Fitted], say: Report,
    best: float = -np.inf,
) -> Done:
    """Fit, integrate and score one model. best: Laplace's log evidence of the best one."""
    seconds: dict[str, float] = {}
    lap = time.perf_counter()
    say("searching", 0, 1, "")
    around: tuple[Survey, ...] = ()
    if model.spec.effects:
        fit, around = simulated_fit(
            data.assembled(model), model, generator(seed, name, 0), say=lambda *at: say("searching", *at)
        )
    else:
        fit = _fit(model, data, seed, starts, lambda *at: say("searching", *at))
    seconds["map"] = time.perf_counter() - lap
    lap = time.perf_counter()
    say("evidence", 0, 1, "")
    settings = integral_settings(model, s)
    settings = replace(settings, enough_below=best - s.far_nats)
    spared = not around and hopeless(fit, best, s)
    if spared:
        settings = replace(settings, last_resort="none")
    rng = generator(seed, name, 1)
    if around:
        whole = integral_of(fit.posterior, around, rng, s.simulated, lambda *at: say("evidence", *at))
    else:
        whole = integrate(fit.posterior.log_prob, fit.x, fit.covariance, rng, settings, fit.proposal)
    seconds["evidence"] = time.perf_counter() - lap
    lap = time.perf_counter()
    scores = score_left_out(
        fit, whole, generator(seed, name, 2), settings, lambda *at: say("leaving out", *at)
    )
    seconds["leave out"] = time.perf_counter() - lap
    forget(fit.posterior)
    return Done(fit, whole, tuple(scores), unexplained(fit), seconds, spared)


def hopeless(fit: Fitted, best: float, s: ComparisonSettings) -> bool:
    """Whether a model fits so badly that its evidence, which its likelihood bounds, cannot come near the best one."""
    return bool(np.isfinite(best) and fit.log_likelihood < best - s.hopeless_nats)


def _fit(model: Model, data: CommonData, seed: int, starts: dict[str, Fitted], say: Say | None = None) -> Fitted:
    """One model at its maximum, and those it starts from, which need not be among the compared ones."""
    if model.name in starts:
        return starts[model.name]
    assembled = data.assembled(model)
    rng = generator(seed, model.name, 0)
    linear = linear_partner(model) if data.campaign.share is None else None
    less = smaller(model)
    fit: Fitted | None = None
    if less is None or model.spec.elements <= _SWARM_ELEMENTS:
        fit = fit_one(assembled, model, rng, None if linear is None else _fit(linear, data, seed, starts), (), say)
    if less is not None and (fit is None or not np.isfinite(fit.laplace) or 2 * fit.agree <= fit.swarms):
        places = richer_starts(_fit(less, data, seed, starts), model)
        fit = fit_one(assembled, model, rng, None, [*([] if fit is None else [fit.x]), *places], say)
    assert fit is not None
    starts[model.name] = fit
    return fit


def integral_settings(model: Model, s: ComparisonSettings) -> IntegralSettings:
    """More draws where they cost next to nothing, shorter annealing where every one is a simulation."""
    if model.is_linear:
        return replace(s.integral, draws=2 * s.integral.draws)
    return replace(s.integral, anneal=QUICK, nearly_rounds=2)


def _bridge_the_near(
    done: Mapping[str, Done], data: CommonData, built: Mapping[str, Model], seed: int, s: ComparisonSettings,
    say: Report, checkpoints: str | Path | Checkpoints | None, anew: bool,
) -> dict[str, Done]:
    """The evidences that decide once more, from a run of the sampler and a bridge; the two have to agree."""
    values = {n: d.whole.log_value for n, d in done.items() if np.isfinite(d.whole.log_value)}
    if not values:
        return dict(done)
    top = max(values.values())
    near = [n for n in done if n in values and values[n] > top - s.near_nats and done[n].whole.method == "importance"
            and not built[n].spec.effects]
    out = dict(done)
    for i, name in enumerate(near if len(near) > 1 else []):
        say("bridge sampling", i, len(near), name)
        d = done[name]
        path = None
        if checkpoints is not None:
            path = checkpoint_for(
                checkpoints, {**identity(built[name], data.fingerprint, seed, s), "stage": "bridge"}
            )
            if anew:
                path.unlink(missing_ok=True)
        again = recall(path, built[name], d.fit.assembled) if path is not None else None
        if again is None:
            found = bridged(
                d.fit.posterior.log_prob, d.whole.draws, d.whole.proposal, generator(seed, name, 3), s.integral,
                d.whole.evaluations,
            )  # fmt: skip
            again = replace(d, whole=_agreed(d.whole, found))
            if path is not None:
                keep(path, again)
        out[name] = again
    return out


def _agreed(importance: Integral, bridge: Integral) -> Integral:
    """The bridge's value; where the two are further apart than their errors allow, the gap is the error."""
    if not np.isfinite(bridge.log_value):
        return importance
    gap = abs(bridge.log_value - importance.log_value)
    joint = float(np.hypot(bridge.se, importance.se))
    se = bridge.se if gap < 3 * joint + 0.02 else max(bridge.se, gap)
    return replace(bridge, se=se, pareto_k=importance.pareto_k)


def unexplained(fit: Fitted) -> float | None:
    """RMS (m) of what the model misses of all displacements at its maximum, each after its own offset; None without."""
    total, count = 0.0, 0
    for group in fit.posterior.groups:
        if group.channel != "displacement":
            continue
        for p in (*group.fitted, *group.others):
            left = residual_at(fit.posterior, fit.assembled, fit.x, group, p)[p.observed]
            total, count = total + float(left @ left), count + left.size
    return float(np.sqrt(total / count)) if count else None


__all__ = ["Comparison", "ComparisonSettings", "compare", "corner_of"]

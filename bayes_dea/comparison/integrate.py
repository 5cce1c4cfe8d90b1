"""The integral of a density near a known maximum: adaptive importance draws, checked, or bridge sampling.

Laplace's normal at the maximum, with two wider ones beside it, is the first proposal. Draws of it are weighted; while
the tail of the weights is too heavy (Pareto k, Vehtari et al. 2024, arXiv:1507.02646) a mixture is fitted to the
weighted draws and takes its place. What stays too heavy goes by annealed populations (`anneal`). Evidences that decide
are worked out again by emcee, with that mixture among its moves, and the bridge between draws and mixture
(`fit.evidence`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..errors import InputError
from ..fit.ensemble import EnsembleSettings, sample
from ..fit.evidence import BridgeSettings, bridge_log_evidence
from ..fit.importance import importance_resample
from ..fit.mixture import Mixture, fit_mixture
from .anneal import Annealed, AnnealSettings, anneal, stirred
from .straighten import Straight

Array = NDArray[np.float64]
LogProb = Callable[[Array], Array]
#: (weight, width) of the normals at the maximum
_FIRST = ((0.6, 1.0), (0.3, 1.8), (0.1, 4.0))
#: Pareto k in straightened coordinates that is enough when two rounds agree
_GOOD_TAIL = 0.6
#: how many times as many draws are made where the weights of a round are nearly good enough, up to this Pareto k and
#: standard error
_MANY, _NEARLY_K, _NEARLY_SE = 4, 0.8, 0.4
#: least variance of a component of a proposal, of that of all draws: a wide one misses the thin shells of curved laws
NARROW = 1e-6
#: nats by which draws in straightened coordinates fall short where these do not suit
_FAR_SHORT = 3.0
#: 84 % quantile of Student's t with three degrees of freedom
FEW_POPULATIONS = 1.2


@dataclass(frozen=True)
class IntegralSettings:
    """draws: of a proposal, or per_dimension a dimension where that is more; rounds: proposals at most, and more: with
    _MANY times as many draws where weights are nearly good enough, which costs less than any last resort;
    nearly_rounds: of straightening where that was not enough.

    good_k, good_se: Pareto k and standard error that are enough when two proposals in turn agree; first_k: without
    that; bad_k: above it, weights are not used.
    last_resort: what is done where importance draws do not do: anneal, bridge, or none (what there is, marked as
    unsettled), and anneal: how. bridge_steps: of the sampler at most. enough_below: log value below which an annealed
    integral need not be known well.
    """

    draws: int = 1500
    per_dimension: int = 60
    rounds: int = 4
    more: int = 2
    nearly_rounds: int = 4
    good_k: float = 0.5
    first_k: float = 0.3
    good_se: float = 0.05
    bad_k: float = 0.55
    last_resort: str = "anneal"
    anneal: AnnealSettings = AnnealSettings()
    bridge_steps: int = 6000
    enough_below: float = -np.inf


@dataclass(frozen=True)
class Integral:
    """Log of the integral with its standard error; draws (n, d) of the density, equally weighted; how it was found."""

    log_value: float
    se: float
    draws: Array = field(repr=False)
    proposal: Mixture = field(repr=False)
    method: str  # importance | straightened | annealed | emulated | bridge
    pareto_k: float
    converged: bool
    evaluations: int


def integrate(
    log_prob: LogProb,
    x: Array,
    covariance: Array,
    rng: np.random.Generator,
    settings: IntegralSettings | None = None,
    proposal: Mixture | None = None,
) -> Integral:
    """Integral of exp(log_prob) around its maximum x (d,), where it is like a normal with `covariance` (d, d).

    proposal: to begin with, in place of the normal. Falls back on bridge sampling where importance draws do not do.
    """
    s = settings or IntegralSettings()
    d = x.size
    n = max(s.draws, s.per_dimension * d)
    g = proposal or normal_mixture(x, covariance)
    best: Integral | None = None
    before = float("nan")
    evaluations = 0
    most = s.rounds if s.last_resort == "none" else s.rounds + s.more
    for round_ in range(most):
        if round_ == s.rounds:
            if best is None or best.pareto_k > _NEARLY_K or best.se > _NEARLY_SE:
                break
            n = _MANY * n
        draws = g.draw(n, rng)
        target, reference = _quiet(log_prob, draws), g.log_density(draws)
        evaluations += len(draws)
        found = _weighed(draws, target, reference, g, rng, evaluations)
        if found is not None and (best is None or merit(found) < merit(best)):
            best = found
        if found is not None and found.se < s.good_se:
            # a refitted proposal knows only what was drawn before: it is believed once the estimate stands still
            stands = abs(found.log_value - before) < max(0.05, 3 * found.se)
            if found.pareto_k < (s.good_k if stands else s.first_k):
                return found
        before = found.log_value if found is not None else float("nan")
        if round_ + 1 < most:
            g = _refitted(draws, target - reference, g, rng)
    stands = best is not None and abs(best.log_value - before) < max(0.1, 4 * best.se)
    if best is not None and stands and best.pareto_k < s.bad_k and best.se < 4 * s.good_se:
        return best
    if s.last_resort == "none":
        return nothing(x, g, evaluations) if best is None else replace(best, converged=False)
    if best is not None and len(np.unique(best.draws, axis=0)) > 10 * d:
        # where the weights were nearly good enough a valley is not what makes them heavy
        rounds = s.nearly_rounds if best.pareto_k < _NEARLY_K and best.se < _NEARLY_SE else 4
        found = straightened(log_prob, best.draws, rng, s, evaluations, rounds, known=best.log_value)
        if settled(found):
            return replace(found, converged=True)
        best, evaluations = min(best, found, key=merit), found.evaluations
    if s.last_resort == "anneal":
        wide = widened(proposal or normal_mixture(x, covariance), best)
        far = anneal(wide.draw, wide.log_density, log_prob, rng, replace(s.anneal, enough_below=s.enough_below))
        if np.isfinite(far.log_ratio):
            evaluations += far.evaluations
            checked = _checked(log_prob, far, rng, s, evaluations)
            if settled(checked):
                return replace(checked, converged=True)
            stands = far.settled and not (usable(checked) or checked.log_value > far.log_ratio + 0.3)
            stands = stands or (far.settled and abs(far.log_ratio - checked.log_value) < 0.3)
            return Integral(far.log_ratio, honest_se(far, checked), far.draws, wide, "annealed", checked.pareto_k,
                            stands, checked.evaluations)
    start = best.draws if best is not None else x + 0.1 * (normal_mixture(x, covariance).draw(n, rng) - x)
    found = bridged(log_prob, start, best.proposal if best is not None else g, rng, s, evaluations)
    if np.isfinite(found.log_value):
        return found
    return nothing(x, g, found.evaluations) if best is None else replace(
        best, converged=False, evaluations=found.evaluations)


def straightened(
    log_prob: LogProb, draws: Array, rng: np.random.Generator, settings: IntegralSettings, evaluations: int = 0,
    rounds: int = 4, known: float = -np.inf,
) -> Integral:
    """The integral by importance draws in coordinates in which draws (n, d) of the density, or near it, lie straight.

    The coordinates follow the draws from round to round, until two estimates in turn agree; `converged` says whether.
    known: log of what the integral has to reach. Draws at several places lie straight in no coordinates: where a round
    falls short of it by far no further one is made.
    """
    s = replace(settings, last_resort="none", rounds=2)
    before = float("nan")
    best: Integral | None = None
    for round_ in range(rounds):
        # importance draws alone creep towards the tips of a valley, a little in each round
        moves = 30 * (1 + round_)
        around = stirred(log_prob, draws, rng, moves=moves)
        evaluations += moves * len(around)
        draws = around if len(around) > 10 * draws.shape[1] else draws
        at = Straight.of(draws)
        y = at.forward(draws)
        if not np.isfinite(y).all():
            break

        def density(z: Array, at: Straight = at) -> Array:
            return log_prob(at.inverse(z))

        try:
            g = fit_mixture(y, rng, (1, 2, 4), NARROW)
        except InputError:
            g = normal_mixture(y.mean(axis=0), np.cov(y.T) + 1e-12 * np.diag(y.var(axis=0) + 1e-300))
        size = y.std(axis=0) + 1e-300
        root = size[:, None] * np.linalg.cholesky(np.corrcoef(y, rowvar=False) + 1e-8 * np.eye(size.size))
        wide = Mixture(
            np.concatenate([0.65 * g.weights, 0.2 * g.weights, [0.1, 0.05]]),
            np.concatenate([g.means, g.means, np.tile(y.mean(axis=0), (2, 1))]),
            np.concatenate([1.05 * g.roots, 1.6 * g.roots, np.stack([1.6 * root, 3.0 * root])]),
        )  # fmt: skip
        found = integrate(density, y.mean(axis=0), np.cov(y.T), rng, s, wide)
        evaluations += found.evaluations
        if not np.isfinite(found.log_value):
            break
        draws = at.inverse(found.draws)
        gap = abs(found.log_value - before)
        agree = gap < max(0.05, 3 * found.se)
        before = found.log_value
        se = max(found.se, gap) if np.isfinite(gap) else found.se
        found = replace(found, se=se, draws=draws, method="straightened", evaluations=evaluations)
        if best is None or merit(found) <= merit(best):
            best = found
        if agree and found.pareto_k < _GOOD_TAIL and se < 2 * settings.good_se:
            return replace(found, proposal=_plain(draws, rng, found.proposal), converged=True)
        if found.log_value < known - _FAR_SHORT:
            break
    if best is None:
        return nothing(draws[0], normal_mixture(np.zeros(draws.shape[1]), np.eye(draws.shape[1])), evaluations)
    return replace(best, proposal=_plain(best.draws, rng, best.proposal), converged=False, evaluations=evaluations)


def settled(found: Integral, good_se: float = 0.2) -> bool:
    """Whether a straightened integral, whose standard error knows what the last round moved it, is good enough."""
    return found.converged or (found.pareto_k < 0.7 and found.se < good_se)


def _plain(draws: Array, rng: np.random.Generator, otherwise: Mixture) -> Mixture:
    """A mixture in the coordinates of the draws, for those who go on from them."""
    try:
        return fit_mixture(draws, rng, (1, 2, 4, 8), NARROW)
    except InputError:
        return otherwise


def usable(found: Integral) -> bool:
    """Whether the weights of an integral say anything where it comes out small."""
    return bool(np.isfinite(found.log_value) and found.pareto_k < 0.7 and found.se < 0.5)


def nothing(x: Array, proposal: Mixture, evaluations: int) -> Integral:
    """What is returned where no draw had a density."""
    return Integral(float("nan"), float("inf"), x[None].copy(), proposal, "importance", 1.0, False, evaluations)


def _checked(
    log_prob: LogProb, far: Annealed, rng: np.random.Generator, s: IntegralSettings, evaluations: int
) -> Integral:
    """The integral once more by importance draws from what an annealing found, in plain or straightened coordinates."""
    d = far.draws.shape[1]
    try:
        g = fit_mixture(far.draws, rng, (1, 2, 4, 8), NARROW)
    except InputError:
        return straightened(log_prob, far.draws, rng, s, evaluations, known=far.log_ratio)
    x = far.draws
    size = x.std(axis=0) + 1e-300
    root = size[:, None] * np.linalg.cholesky(np.corrcoef(x, rowvar=False) + 1e-8 * np.eye(d))
    wide = Mixture(
        np.concatenate([0.7 * g.weights, 0.2 * g.weights, [0.1]]),
        np.concatenate([g.means, g.means, x.mean(axis=0)[None]]),
        np.concatenate([1.05 * g.roots, 1.6 * g.roots, 1.5 * root[None]]),
    )
    short = replace(s, draws=2 * s.draws, rounds=2, last_resort="none")
    plain = integrate(log_prob, x.mean(axis=0), np.cov(x.T), rng, short, wide)
    evaluations += plain.evaluations
    if plain.converged and abs(plain.log_value - far.log_ratio) < 3 * float(np.hypot(plain.se, far.se)) + 0.05:
        return replace(plain, evaluations=evaluations)
    bent = straightened(log_prob, x, rng, s, evaluations, known=far.log_ratio)
    return bent if settled(bent) or not np.isfinite(plain.log_value) else min(
        replace(plain, converged=False, evaluations=bent.evaluations), bent, key=merit)


def honest_se(far: Annealed, checked: Integral) -> float:
    """Standard error of an annealed integral, no smaller than what a second way of working it out differs by.

    All populations may miss the same tips of a curved valley: their scatter does not know. It is of few populations,
    too, and Student's t widens it. A second way that comes out smaller counts only where its weights can be used:
    draws that do not suit a density fall short of its integral.
    """
    gap = checked.log_value - far.log_ratio
    joint = float(np.hypot(far.se, checked.se)) if np.isfinite(checked.se) else float("inf")
    counts = abs(gap) > 2.0 * joint and (gap > 0 or usable(checked))
    return float(max(FEW_POPULATIONS * far.se, abs(gap) if counts else 0.0))


def normal_mixture(x: Array, covariance: Array) -> Mixture:
    """Three normals at one place, one as wide as said and two wider: heavier tails than a normal's."""
    d = x.size
    scale = np.sqrt(np.diag(covariance))
    root = scale[:, None] * np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-10 * np.eye(d))
    weights, widths = (np.array(v) for v in zip(*_FIRST, strict=True))
    return Mixture(weights, np.tile(x, (3, 1)), np.stack([w * root for w in widths]))


def widened(first: Mixture, best: Integral | None) -> Mixture:
    """A mixture to begin an annealing with: all places of the first proposal, and wide around what was found since."""
    if best is None:
        return Mixture(first.weights, first.means, 1.5 * first.roots)
    x = best.draws
    size = x.std(axis=0) + 1e-300
    root = size[:, None] * np.linalg.cholesky(np.corrcoef(x, rowvar=False) + 1e-6 * np.eye(x.shape[1]))
    return Mixture(
        np.concatenate([0.4 * first.weights, 0.3 * best.proposal.weights, [0.3]]),
        np.concatenate([first.means, best.proposal.means, x.mean(axis=0)[None]]),
        np.concatenate([first.roots, 1.5 * best.proposal.roots, 2.5 * root[None]]),
    )


def _quiet(log_prob: LogProb, draws: Array) -> Array:
    with np.errstate(all="ignore"):
        value = np.asarray(log_prob(draws), float)
    return np.where(np.isfinite(value), value, -np.inf)


def _weighed(
    draws: Array, target: Array, reference: Array, g: Mixture, rng: np.random.Generator, evaluations: int
) -> Integral | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            r = importance_resample(target, reference, draws, len(draws), rng)
    except InputError:
        return None
    ratio = target - reference
    weight = np.exp(ratio - ratio.max())
    se = float(np.std(weight) / np.mean(weight) / np.sqrt(len(weight)))
    k = r.k_hat if np.isfinite(r.k_hat) else 1.0
    return Integral(r.log_mean_weight, se, r.draws, g, "importance", k, True, evaluations)


def merit(i: Integral) -> float:
    """How far an estimate is to be trusted; small is good."""
    return i.se + max(i.pareto_k, 0.0)


def _refitted(draws: Array, log_weight: Array, g: Mixture, rng: np.random.Generator) -> Mixture:
    """A mixture fitted to the weighted draws, with a share of it widened; weights are tempered while few carry all."""
    finite = np.isfinite(log_weight)
    if finite.sum() < 10 * draws.shape[1]:
        return Mixture(g.weights, g.means, 0.5 * g.roots)
    power = 1.0
    for power in (1.0, 0.5, 0.25, 0.1, 0.03):
        w = np.exp(power * (log_weight - log_weight[finite].max()))
        w = np.where(finite, w, 0.0)
        w /= w.sum()
        if 1.0 / np.sum(w**2) > max(20 * draws.shape[1], 0.1 * len(draws)):
            break
    edges = np.cumsum(w)
    index = np.minimum(np.searchsorted(edges, (rng.random() + np.arange(len(draws))) / len(draws)), len(draws) - 1)
    try:
        fitted = fit_mixture(draws[index], rng, (1, 2, 4), NARROW)
    except InputError:
        return g
    # a part of the proposal is wider than anything that was seen: tails are what importance weights break on
    wide = 1.6 if power == 1.0 else 1.2
    chosen = draws[index]
    size = chosen.std(axis=0) + 1e-300
    spread = size[:, None] * np.linalg.cholesky(np.corrcoef(chosen, rowvar=False) + 1e-8 * np.eye(draws.shape[1]))
    return Mixture(
        np.concatenate([0.7 * fitted.weights, 0.2 * fitted.weights, [0.1]]),
        np.concatenate([fitted.means, fitted.means, chosen.mean(axis=0)[None]]),
        np.concatenate([fitted.roots, wide * fitted.roots, 2.0 * spread[None]]),
    )


def bridged(
    log_prob: LogProb,
    around: Array,
    proposal: Mixture,
    rng: np.random.Generator,
    settings: IntegralSettings | None = None,
    evaluations: int = 0,
) -> Integral:
    """The integral by emcee (two ensembles that begin at draws `around`, widened) and bridge sampling.

    Where there are too few distinct draws to begin from, as resampling a few heavy weights leaves them, draws of the
    proposal join them. nan and not converged where nothing to begin from can be found.
    """
    s = settings or IntegralSettings()
    d = around.shape[1]
    walkers = max(32, 3 * d + (3 * d) % 2)
    start = np.empty((2, walkers, d))
    around = _spanning(log_prob, around, proposal, 2 * walkers, rng)
    centre = around.mean(axis=0)
    for e, width in enumerate((1.2, 0.8)):
        chosen = around[rng.choice(len(around), walkers, replace=len(around) < walkers)]
        wide = centre + width * (chosen - centre) + 1e-3 * around.std(axis=0) * rng.standard_normal(chosen.shape)
        good = np.isfinite(_quiet(log_prob, wide))
        start[e] = np.where(good[:, None], wide, chosen)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            run = sample(log_prob, start, EnsembleSettings(max_steps=s.bridge_steps), rng, proposal=proposal)
        except InputError:
            return replace(nothing(around[0], proposal, evaluations), draws=around, method="bridge")
    flat = run.flat()
    kept = flat[np.linspace(0, len(flat) - 1, min(len(flat), 3000)).astype(int)]
    total = evaluations + run.evaluations
    try:
        value, se = bridge_log_evidence(log_prob, run.chains, rng, BridgeSettings(max_draws=4000))
    except InputError:
        return Integral(float("nan"), float("nan"), kept, proposal, "bridge", float("nan"), False, total)
    return Integral(value, se, kept, proposal, "bridge", float("nan"), run.converged, total)


def _spanning(log_prob: LogProb, around: Array, proposal: Mixture, least: int, rng: np.random.Generator) -> Array:
    """Draws (n, d) themselves, or where too few of them differ, with draws of the proposal that have a density."""
    distinct = np.unique(around, axis=0)
    if len(distinct) >= least:
        return around
    others = proposal.draw(4 * least, rng)
    value = _quiet(log_prob, others)
    best = np.argsort(-value)[: np.count_nonzero(np.isfinite(value))]
    return np.concatenate([distinct, others[best[: least - len(distinct)]]])


def log_mean(values: Array) -> float:
    """Log of the mean of exponentials."""
    return float(logsumexp(values) - np.log(len(values)))

"""Integrals of a density whose every value is a simulation: models with effects.

An emulator (`emulation`, as for a calibration, but with shorter runs) shows where the density is, and its own integral
is found by importance draws in straightened coordinates. The emulator is only a control variate: the integral of the
density itself is that of the emulator plus the mean difference of the two at some hundred independent draws that are
simulated, so that neither its error nor where it does not hold biases anything.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ..emulation import Emulation, EmulationSettings, emulate
from ..errors import InputError
from ..find_map import MapResult
from ..fit.evidence import laplace_log_evidence
from ..fit.pilot import PilotSettings
from ..fit.polish import NewtonSettings, polish_newton
from ..fit.reweigh import smoothed_weights, systematic
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import Prepared
from ..likelihood.remembering import RememberingGroup, remembering
from .integrate import Integral, IntegralSettings, integrate, normal_mixture

Array = NDArray[np.float64]
Say = Callable[[float, float, str], None]
_NEWTON = NewtonSettings(tolerance=1e-3, max_iterations=60)
#: shorter runs than a calibration's: the integral is corrected by simulations
_QUICK = EmulationSettings(
    rounds=5, error_nats=0.3,
    pilot=PilotSettings(steps=100, temperatures=(1.0, 2.0, 1.0), walkers_per_dimension=4, draws=2500),
)  # fmt: skip


@dataclass(frozen=True)
class SimulatedSettings:
    """emulation: how the emulator is found; draws: importance draws on it. corrected: draws that are simulated for the
    integral; kept: draws of the density that are.
    """

    emulation: EmulationSettings = _QUICK
    draws: int = 4000
    corrected: int = 400
    kept: int = 500


@dataclass(frozen=True)
class Survey:
    """Where a density is: an emulator around it and the integral of that in straightened coordinates."""

    emulation: Emulation = field(repr=False)
    found: Integral = field(repr=False)

    @property
    def draws(self) -> Array:
        """Draws (n, d) of the emulated density."""
        return self.emulation.shear.inverse(self.found.draws)


def survey(
    posterior: Posterior, x: Array, linear: Sequence[LinearGroup], rng: np.random.Generator,
    settings: SimulatedSettings | None = None, say: Say | None = None,
) -> Survey:
    """Find where a posterior of plants is, from a point x (d,) near its maximum.

    linear: lag bases of its voltage recordings. Raises InputError where nothing around x has a density.
    """
    s = settings or SimulatedSettings()
    r_emulate, r_integrate = rng.spawn(2)
    # what a simulation's last digits say of second differences is noise: first differences do without
    near = MapResult(x, float("nan"), np.full((x.size, x.size), np.nan), 1, 1, 0, True)
    e = emulate(posterior, near, linear, r_emulate, s.emulation, report=say)
    start = e.start.reshape(-1, x.size)
    how = IntegralSettings(draws=s.draws, last_resort="none", bad_k=0.7)
    return Survey(e, integrate(e.log_prob, start.mean(axis=0), np.cov(start.T), r_integrate, how, e.proposal))


def integral_of(
    exact: Posterior, at: Sequence[Survey], rng: np.random.Generator, settings: SimulatedSettings | None = None,
    say: Say | None = None,
) -> Integral:
    """The integral of the density itself; its draws are simulated ones. at: a survey of each place where it is."""
    s = settings or SimulatedSettings()
    if say is not None:
        say(0, 1, "simulating draws")
    found = _one_place(exact, at[0], rng, s) if len(at) == 1 else _places(exact, at, rng, s)
    draws, w = found.draws, found.weights
    usable = 1.0 / np.sum(w**2) > found.least
    settled = np.isfinite(found.log_value) and found.se < 0.25 and (found.pareto_k < 0.7 or found.se < 0.05) and usable
    kept = draws[systematic(w, s.kept, rng)]
    x, size = kept.mean(axis=0), kept.std(axis=0) + 1e-300
    root = np.eye(x.size) if len(np.unique(kept, axis=0)) < 2 * x.size else np.corrcoef(kept, rowvar=False)
    covariance = (root + 1e-8 * np.eye(x.size)) * np.outer(size, size)
    count = sum(a.emulation.simulations for a in at) + found.simulated
    return Integral(found.log_value, found.se, rng.permutation(kept), normal_mixture(x, covariance), "emulated",
                    found.pareto_k, bool(settled), count)


def emulated_integral(at: Sequence[Survey], n: int, rng: np.random.Generator) -> Integral:
    """The integral of the emulators alone with n draws: no further simulation, and no check on them."""
    values = np.array([a.found.log_value for a in at])
    share = np.exp(values - values.max())
    counts = rng.multinomial(n, share / share.sum())
    draws = np.concatenate([a.draws[rng.integers(len(a.draws), size=c)] for a, c in zip(at, counts, strict=True)])
    first = at[int(np.argmax(values))].found
    return replace(first, log_value=float(logsumexp(values)), draws=draws, method="emulated",
                   proposal=normal_mixture(draws.mean(axis=0), np.cov(draws.T)),
                   converged=all(a.found.converged for a in at))


@dataclass(frozen=True)
class _Found:
    """draws (n, d) with weights (n,) that sum to one; least: effective ones that are enough."""

    log_value: float
    se: float
    pareto_k: float
    draws: Array
    weights: Array
    least: float
    simulated: int


def _one_place(exact: Posterior, at: Survey, rng: np.random.Generator, s: SimulatedSettings) -> _Found:
    """With the emulator as control variate; draws are the emulator's, weighted."""
    e, g = at.emulation, at.found.proposal
    r_many, r_few, r_draws = rng.spawn(3)
    many = g.draw(4 * s.draws, r_many)
    few = g.draw(s.corrected, r_few)
    chosen = at.draws[r_draws.permutation(len(at.found.draws))[: s.kept]]
    with np.errstate(all="ignore"):
        emulated_many = _quiet(e.log_prob(many) - g.log_density(many))
        reference = g.log_density(few)
        emulated_few = _quiet(e.log_prob(few) - reference)
        exact_few = _quiet(_portions(exact, e.shear.inverse(few)) - reference)
    log_value, se = with_control(exact_few, emulated_few, emulated_many)
    w = smoothed_weights(_portions(exact, chosen) - e.emulated.log_prob(chosen))
    k = float(smoothed_weights(exact_few).pareto_k)
    return _Found(log_value, se, k, chosen, w.weights, 0.3 * len(chosen), s.corrected + s.kept)


def _places(exact: Posterior, at: Sequence[Survey], rng: np.random.Generator, s: SimulatedSettings) -> _Found:
    """Several places at once: draws of the proposals of all, weighted by the mixture of them (Veach & Guibas 1995).

    Where places overlap nothing is counted twice.
    """
    values = np.array([a.found.log_value for a in at])
    share = np.exp(values - values.max())
    share = np.maximum(share / share.sum(), 0.15)
    share /= share.sum()
    n = s.corrected + s.kept
    counts = np.maximum(np.round(share * n).astype(int), 2)
    share = counts / counts.sum()
    parts = zip(at, counts, strict=True)
    q = np.concatenate([a.emulation.shear.inverse(a.found.proposal.draw(int(c), rng)) for a, c in parts])
    with np.errstate(all="ignore"):
        densities = [_quiet(a.found.proposal.log_density(a.emulation.shear.forward(q))) for a in at]
        reference = logsumexp(np.stack(densities, axis=1), axis=1, b=share)
        ratio = _quiet(_portions(exact, q) - reference)
    w = smoothed_weights(ratio)
    raw = np.exp(ratio - ratio.max())
    # the counts of each proposal are fixed: the scatter is that within them
    edges = np.cumsum(counts)[:-1]
    inside = sum(len(part) * float(np.var(part)) for part in np.split(raw, edges))
    se = float(np.sqrt(inside) / max(raw.sum(), 1e-300))
    return _Found(w.log_mean, se, float(w.pareto_k), q, w.weights, 0.1 * len(q), len(q))


def with_control(exact: Array, control: Array, many: Array) -> tuple[float, float]:
    """Log of the mean of exp(exact) (n,) and its standard error, exp(control) at the same draws as control variate.

    many (N,): the control's log weights at further, independent draws. The coefficient is the regression's, zero where
    the control does not help. -inf is a weight of zero.
    """
    top = max(float(np.max(exact)), float(np.max(many)))
    if not np.isfinite(top):
        return float("nan"), float("nan")
    w, v, V = np.exp(exact - top), np.exp(control - top), np.exp(many - top)
    n, N = len(w), len(V)
    C = np.cov(w, v)
    b = float(C[0, 1] / (C[1, 1] * (1.0 + n / N))) if C[1, 1] > 0 else 0.0
    value = float(w.mean() - b * (v.mean() - V.mean()))
    variance = float(np.var(w - b * v, ddof=2)) / n + b * b * float(np.var(V, ddof=1)) / N
    if not value > 0:
        value, variance = float(w.mean()), float(np.var(w, ddof=1)) / n
    if not value > 0:
        return float("nan"), float("nan")
    return top + float(np.log(value)), float(np.sqrt(variance) / value)


def _quiet(v: Array) -> Array:
    return np.where(np.isfinite(v), v, -np.inf)


def _portions(exact: Posterior, q: Array) -> Array:
    return np.concatenate([exact.log_prob(part) for part in np.array_split(q, max(1, len(q) // 50))])


def maximum_of(at: Survey, start: Array) -> MapResult:
    """The maximum (d,): the emulator's, from the best of its draws; `start` where a simulation says that is better."""
    e = at.emulation
    draws = np.concatenate([start[None], at.draws[:1000]])
    value = _quiet(e.emulated.log_prob(draws))
    found = polish_newton(e.emulated.log_prob, draws[int(np.argmax(value))], settings=_NEWTON)
    there, here = _quiet(e.exact.log_prob(np.stack([found.x, start])))
    if there >= here:
        return MapResult(found.x, float(there), found.hessian, 1, 1, found.evaluations, found.converged)
    return MapResult(start, float(here), found.hessian, 1, 1, found.evaluations, False)


def remembered(posterior: Posterior, *others: Posterior) -> Posterior:
    """A posterior with a memory that knows what `others` have simulated."""
    out = remembering(posterior)
    for g in out.groups:
        for other in others:
            for kept in other.groups:
                if (
                    isinstance(g, RememberingGroup) and isinstance(kept, RememberingGroup)
                    and (g.channel, g.specimen) == (kept.channel, kept.specimen)
                ):
                    g.memory.update(kept.memory)
    return out


def fitted_to(posterior: Posterior, names: frozenset[str]) -> Posterior:
    """The posterior given the recordings in `names` only, which may be others than those to identify."""
    groups: list[LinearGroup | BlockGroup] = []
    for g in posterior.groups:
        if isinstance(g, BlockGroup):
            g = replace(g, records=tuple(replace(r, prepared=_in_role(r.prepared, names)) for r in g.records))
        groups.append(g)
    return replace(posterior, groups=tuple(groups))


def _in_role(p: Prepared, names: frozenset[str]) -> Prepared:
    return replace(p, recording=replace(p.recording, role="identify" if p.name in names else "validate"))


def laplace_of(found: MapResult, value: float) -> float:
    """Laplace's log evidence at a maximum; nan where it is none."""
    try:
        return laplace_log_evidence(value, found.hessian)
    except InputError:
        return float("nan")


__all__ = [
    "SimulatedSettings", "Survey", "emulated_integral", "fitted_to", "integral_of", "laplace_of", "maximum_of",
    "remembered", "survey", "with_control",
]  # fmt: skip

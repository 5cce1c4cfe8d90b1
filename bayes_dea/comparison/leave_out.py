"""Prediction of recordings that were left out: the log predictive density of each, given the others.

For a recording to identify that is p(y_r | all the others) = Z(all)/Z(all but r), for one to validate
p(y_v | those to identify) = Z(those and v)/Z(those); gain, offset and zero of the recording are integrated out. Both
come from draws of the posterior by Pareto-smoothed weights where these carry it (k < 0.7), else from an integral of
its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..assemble import zero_prior
from ..find_map import MapResult, laplace_covariance
from ..fit.mixture import Mixture, fit_mixture
from ..fit.polish import NewtonSettings, polish_newton
from ..fit.reweigh import smoothed_weights
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import Prepared
from .anneal import AnnealSettings, anneal
from .common import Restricted, group_log_likelihood, restricted
from .fit_one import Fitted, residual_at
from .integrate import Integral, IntegralSettings, integrate, log_mean

Array = NDArray[np.float64]
_NEWTON = NewtonSettings(tolerance=0.02, max_iterations=25)
_LARGEST_K = 0.7
#: spread of log weights over the draws up to which they are trusted without a look at their tail
_QUIET_SD = 0.5


@dataclass(frozen=True)
class LeftOut:
    """Score of one recording: log predictive density in nats with its Monte-Carlo standard error."""

    recording: str
    role: str
    channel: str
    n: int
    elpd: float
    mc_se: float
    method: str  # reweighted | integrated | annealed
    pareto_k: float | None


def score_left_out(
    fit: Fitted,
    whole: Integral,
    rng: np.random.Generator,
    settings: IntegralSettings,
    say: Callable[[float, float, str], None] | None = None,
) -> list[LeftOut]:
    """Scores of every recording, in the campaign's order; the only one that was fitted cannot be left out."""
    posterior = fit.posterior
    fitted = frozenset(p.name for g in posterior.groups for p in g.fitted)
    prepared = fit.assembled.prepared
    step = 1 if posterior.model.is_linear else 3
    scoring = _Scoring(fit, whole, whole.draws[::step], fitted, settings)
    out = []
    for i, (p, child) in enumerate(zip(prepared, rng.spawn(len(prepared)), strict=True)):
        if say is not None:
            say(i, len(prepared), f"without {p.name}" if p.name in fitted else p.name)
        if p.name in fitted and len(fitted) == 1:
            continue
        out.append(scoring.score(p, child))
    return out


@dataclass(frozen=True)
class _Scoring:
    """draws (n, d): of the posterior, thinned where a likelihood is dear."""

    fit: Fitted
    whole: Integral
    draws: Array
    fitted: frozenset[str]
    settings: IntegralSettings
    _known: dict[tuple[str, str], Array] = field(default_factory=dict)

    def score(self, p: Prepared, rng: np.random.Generator) -> LeftOut:
        """Score of one recording."""
        sign = -1.0 if p.name in self.fitted else 1.0
        if sign < 0 or not p.recording.is_mechanical:
            own = self._own_likelihood(p)
            w = smoothed_weights(sign * own)
            trusted = (w.pareto_k < _LARGEST_K or w.sd < _QUIET_SD) and w.effective > 100 and np.isfinite(own).all()
            if trusted and self.whole.converged:
                if sign < 0:
                    value = float(np.logaddexp.reduce(np.log(np.maximum(w.weights, 1e-300)) + own))
                else:
                    value = log_mean(own)
                se = float(np.sqrt(max(1.0 / w.effective - 1.0 / len(own), 0.0)))
                return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, "reweighted", w.pareto_k)
        posterior, start = self.fit.posterior, self.fit.x
        if self.whole.method == "annealed" and (sign < 0 or not p.recording.is_mechanical):
            return self._annealed(p, sign, rng)
        names = self.fitted - {p.name} if sign < 0 else self.fitted | {p.name}
        if sign > 0 and p.recording.is_mechanical:
            posterior, start = _with_zero(self.fit, p, names)
        short = replace(self.settings, draws=1500, rounds=5, bad_k=_LARGEST_K, last_resort="none")
        other = _integral(restricted(posterior, names), posterior, start, rng, short)
        value = sign * (other.log_value - self.whole.log_value)
        se = float(np.hypot(other.se, self.whole.se))
        return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, "integrated", other.pareto_k)

    def _annealed(self, p: Prepared, sign: float, rng: np.random.Generator) -> LeftOut:
        """Populations from a mixture fitted to the draws, its unseen coordinates at their prior and all of it wider."""
        names = self.fitted - {p.name} if sign < 0 else self.fitted | {p.name}
        posterior = self.fit.posterior
        pool = self.whole.draws.copy()
        blind = unseen(posterior, names)
        pool[:, blind] = posterior.prior_draws(len(pool), rng)[:, blind]
        g = fit_mixture(pool, rng, (1, 2, 4, 8))
        wide = Mixture(
            np.concatenate([0.7 * g.weights, 0.3 * g.weights]), np.concatenate([g.means, g.means]),
            np.concatenate([1.2 * g.roots, 2.5 * g.roots]),
        )  # fmt: skip
        quick = AnnealSettings(populations=3, particles=400, moves=8, last_moves=16)
        found = anneal(wide.draw, wide.log_density, restricted(posterior, names).log_prob, rng, quick)
        value = sign * (found.log_ratio - self.whole.log_value)
        se = float(np.hypot(found.se, self.whole.se))
        return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, "annealed", None)

    def _own_likelihood(self, p: Prepared) -> Array:
        """(n,) log likelihood of a recording at the draws, given the others of its group that are fitted."""
        posterior = self.fit.posterior
        group = next(g for g in posterior.groups if any(r.name == p.name for r in (*g.fitted, *g.others)))
        key = (group.channel, group.specimen)
        if key not in self._known:
            self._known[key] = group_log_likelihood(posterior, group, self.draws, self.fitted)
        if p.name in self.fitted:
            return self._known[key] - group_log_likelihood(posterior, group, self.draws, self.fitted - {p.name})
        return group_log_likelihood(posterior, group, self.draws, self.fitted | {p.name}) - self._known[key]


def unseen(posterior: Posterior, names: frozenset[str]) -> NDArray[np.int64]:
    """Coordinates that the recordings in `names` say nothing about: zeros of others, noise of channels without any."""
    out = [posterior.zero_start + i for i, z in enumerate(posterior.zeros) if z.recording not in names]
    at = posterior.zero_start + len(posterior.zeros)
    for c in posterior.channels:
        count = 1 + len(c.rates.steps_s)
        seen = any(
            p.name in names for g in posterior.groups if g.channel == c.channel for p in (*g.fitted, *g.others)
        )
        out += [] if seen else list(range(at, at + count))
        at += count
    return np.array(out, dtype=np.int64)


def _integral(
    density: Restricted, posterior: Posterior, start: Array, rng: np.random.Generator, s: IntegralSettings
) -> Integral:
    """The integral from its own maximum; no further resort, as one score of many does not carry it."""
    found = polish_newton(density.log_prob, start, settings=_NEWTON)
    at = MapResult(found.x, found.value, found.hessian, 1, 1, found.evaluations, found.converged)
    covariance = laplace_covariance(at, posterior, rng)
    return integrate(density.log_prob, found.x, covariance, rng, s)


def _with_zero(fit: Fitted, p: Prepared, names: frozenset[str]) -> tuple[Posterior, Array]:
    """The posterior with the zero of position of a recording that was not fitted, and a start at its best place."""
    prior = zero_prior(p)
    posterior = fit.posterior
    extended = replace(posterior, zeros=(*posterior.zeros, prior))
    at = posterior.zero_start + len(posterior.zeros)
    start = np.insert(fit.x, at, prior.mean)
    density = restricted(extended, names)
    for width in (3.0, 0.1, 0.005):
        points = np.tile(start, (81, 1))
        points[:, at] = start[at] + width * prior.sd * np.linspace(-1, 1, 81)
        value = density.log_prob(points)
        if np.isfinite(value).any():
            start = points[int(np.argmax(np.where(np.isfinite(value), value, -np.inf)))]
    groups: list[LinearGroup | BlockGroup] = []
    for group in extended.groups:
        if isinstance(group, BlockGroup) and any(r.name == p.name for r in group.others):
            left = residual_at(posterior, fit.assembled, fit.x, group, p, float(start[at]))
            group = group.with_reference({p.name: left})
        groups.append(group)
    return replace(extended, groups=tuple(groups)), start

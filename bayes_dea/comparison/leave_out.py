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
from ..errors import InputError
from ..find_map import MapResult, laplace_covariance
from ..fit.mixture import Mixture, fit_mixture, joined
from ..fit.polish import NewtonSettings, polish_newton
from ..fit.reweigh import smoothed_weights
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.plant_group import PlantGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import Prepared
from .anneal import QUICK, anneal
from .climb import climb, first_difference_covariance
from .common import Restricted, group_log_likelihood
from .fit_one import Fitted, residual_at
from .integrate import (
    FEW_POPULATIONS,
    NARROW,
    Integral,
    IntegralSettings,
    honest_se,
    integrate,
    log_mean,
    normal_mixture,
    settled,
    straightened,
)
from .simulated import SimulatedSettings, fitted_to, integral_of, remembered, survey
from .terms import RecordTerms

Array = NDArray[np.float64]
_NEWTON = NewtonSettings(tolerance=0.02, max_iterations=25)
_LARGEST_K = 0.7
#: spread of log weights over the draws up to which they are trusted without a look at their tail
_QUIET_SD = 0.5
#: importance draws where each is a simulation, and the standard error (nats) that is good enough for one score
_FEW = IntegralSettings(
    draws=250, per_dimension=20, rounds=2, good_k=0.6, first_k=0.6, good_se=0.1, bad_k=_LARGEST_K, last_resort="none"
)
_GOOD_SE = 0.2
#: what single populations scatter by on average: three that happen to agree are no better (nats)
_LEAST_SE = 0.15


@dataclass(frozen=True)
class LeftOut:
    """Score of one recording: log predictive density in nats with its Monte-Carlo standard error."""

    recording: str
    role: str
    channel: str
    n: int
    elpd: float
    mc_se: float
    method: str  # reweighted | integrated | annealed | emulated
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
    step = 1 if posterior.model.is_linear or posterior.model.spec.effects else 3
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
    _terms: dict[tuple[str, str], RecordTerms] = field(default_factory=dict)

    def score(self, p: Prepared, rng: np.random.Generator) -> LeftOut:
        """Score of one recording."""
        sign = -1.0 if p.name in self.fitted else 1.0
        if sign < 0 or not p.recording.is_mechanical:
            own = self._own_likelihood(p)
            w = smoothed_weights(sign * own)
            trusted = (w.pareto_k < _LARGEST_K or w.sd < _QUIET_SD) and w.effective > 100 and np.isfinite(own).all()
            if trusted and (self.whole.converged or self.whole.method == "annealed"):
                if sign < 0:
                    value = float(np.logaddexp.reduce(np.log(np.maximum(w.weights, 1e-300)) + own))
                else:
                    value = log_mean(own)
                se = float(np.sqrt(max(1.0 / w.effective - 1.0 / len(own), 0.0)))
                return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, "reweighted", w.pareto_k)
        posterior, start = self.fit.posterior, self.fit.x
        names = self.fitted - {p.name} if sign < 0 else self.fitted | {p.name}
        if sign > 0 and p.recording.is_mechanical:
            posterior, start = _with_zero(self.fit, p, names)
        if posterior.model.spec.effects:
            return self._emulated(p, posterior, start, names, sign, rng)
        curved = self.whole.method in ("annealed", "straightened") and (sign < 0 or not p.recording.is_mechanical)
        if self.whole.method == "annealed" and curved:  # at several places: one maximum is not enough
            return self._curved(p, sign, rng)
        short = replace(self.settings, draws=1500, rounds=5, bad_k=_LARGEST_K, last_resort="none")
        other = _integral(Restricted(posterior, names), posterior, start, rng, short)
        if curved and self.settings.last_resort != "none" and not (other.converged and other.se < _GOOD_SE):
            return self._curved(p, sign, rng)
        value = sign * (other.log_value - self.whole.log_value)
        se = float(np.hypot(other.se, self.whole.se))
        return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, "integrated", other.pareto_k)

    def _emulated(
        self, p: Prepared, posterior: Posterior, start: Array, names: frozenset[str], sign: float,
        rng: np.random.Generator,
    ) -> LeftOut:
        """By some hundred simulations at the maximum with (or without) the recording; by an emulator where few do."""
        given = remembered(fitted_to(posterior, names), posterior)
        r_climb, r_few, r_survey, r_many = rng.spawn(4)
        starts = [start]
        if self.fit.proposal is not None and start.size == self.fit.x.size:
            starts = list(np.unique(self.fit.proposal.means, axis=0))
        places = [climb(x, lambda _: given, r_climb, 0.3)[0] for x in starts]
        parts = [normal_mixture(x, first_difference_covariance(given, x, r_climb)) for x in places]
        proposal = joined(parts, np.full(len(parts), 1.0 / len(parts)))
        size = first_difference_covariance(given, places[0], r_climb)
        other = integrate(given.log_prob, places[0], size, r_few, _FEW, proposal)
        method = "integrated"
        if not other.converged or other.se > _GOOD_SE:
            method = "emulated"
            around = [survey(given, x, self.fit.assembled.search_groups, r_survey) for x in places]
            other = integral_of(given, around, r_many, SimulatedSettings(corrected=200, kept=40))
        value = sign * (other.log_value - self.whole.log_value)
        se = float(np.hypot(other.se, self.whole.se))
        return LeftOut(p.name, p.recording.role, p.channel, p.n, value, se, method, other.pareto_k)

    def _curved(self, p: Prepared, sign: float, rng: np.random.Generator) -> LeftOut:
        """From the draws, their unseen coordinates at their prior: straightened, or by populations where that fails.

        Populations begin wide: what a recording left out held narrow has to be found again, and from narrow to wide
        they would not get there.
        """
        names = self.fitted - {p.name} if sign < 0 else self.fitted | {p.name}
        posterior = self.fit.posterior
        pool = self.whole.draws.copy()
        blind = unseen(posterior, names)
        anywhere = posterior.prior_draws(len(pool), rng)
        pool[:, blind] = anywhere[:, blind]
        density = Restricted(posterior, names).log_prob
        found = None
        if self.whole.method != "annealed":  # draws at several places lie straight in no coordinates
            found = straightened(density, pool, rng, self.settings, rounds=3 if posterior.model.is_linear else 2)
            if settled(found, 0.5):
                return self._scored(p, sign, found.log_value, found.se, "integrated", float(found.pareto_k))
        prior = normal_mixture(anywhere.mean(axis=0), np.cov(anywhere.T))
        try:
            g = fit_mixture(pool, rng, (1, 2, 4, 8), NARROW)
            wide = Mixture(
                np.concatenate([0.5 * g.weights, 0.3 * g.weights, 0.15 * g.weights, 0.05 * prior.weights]),
                np.concatenate([g.means, g.means, g.means, prior.means]),
                np.concatenate([1.2 * g.roots, 2.5 * g.roots, 6.0 * g.roots, prior.roots]),
            )  # fmt: skip
        except InputError:  # too few draws that differ
            wide = prior
        far = anneal(wide.draw, wide.log_density, density, rng, QUICK)
        if np.isfinite(far.log_ratio) or found is None:
            se = FEW_POPULATIONS * far.se if found is None else honest_se(far, found)
            se = max(se, _LEAST_SE)
            return self._scored(p, sign, far.log_ratio, se, "annealed", None)
        return self._scored(p, sign, found.log_value, found.se, "integrated", float(found.pareto_k))

    def _scored(self, p: Prepared, sign: float, log_value: float, se: float, method: str, k: float | None) -> LeftOut:
        """The score from an integral without (or with) the recording and that of the whole."""
        value = sign * (log_value - self.whole.log_value)
        return LeftOut(p.name, p.recording.role, p.channel, p.n, value, float(np.hypot(se, self.whole.se)), method, k)

    def _own_likelihood(self, p: Prepared) -> Array:
        """(n,) log likelihood of a recording at the draws, given the others of its group that are fitted."""
        posterior = self.fit.posterior
        group = next(g for g in posterior.groups if any(r.name == p.name for r in (*g.fitted, *g.others)))
        key = (group.channel, group.specimen)
        rest = self.fitted - {p.name}
        if isinstance(group, PlantGroup):
            if key not in self._terms:
                self._terms[key] = RecordTerms.of(posterior, group, self.draws)
            terms = self._terms[key]
            return terms.log_likelihood(rest | {p.name}) - terms.log_likelihood(rest)
        if key not in self._known:
            self._known[key] = group_log_likelihood(posterior, group, self.draws, self.fitted)
        if p.name in self.fitted:
            return self._known[key] - group_log_likelihood(posterior, group, self.draws, rest)
        return group_log_likelihood(posterior, group, self.draws, self.fitted | {p.name}) - self._known[key]


def unseen(posterior: Posterior, names: frozenset[str]) -> NDArray[np.int64]:
    """Coordinates that the recordings in `names` say nothing about.

    Zeros of others, noise of channels without any, correlation at rates that none of them was sampled at.
    """
    out = [posterior.zero_start + i for i, z in enumerate(posterior.zeros) if z.recording not in names]
    at = posterior.zero_start + len(posterior.zeros)
    for c in posterior.channels:
        seen = {
            c.rates.of(p) for g in posterior.groups if g.channel == c.channel for p in (*g.fitted, *g.others)
            if p.name in names
        }
        out += [] if seen else [at]
        out += [at + 1 + j for j in range(len(c.rates.steps_s)) if j not in seen]
        at += 1 + len(c.rates.steps_s)
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
    density = Restricted(extended, names)
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

"""Names for one and the same function, shown in numbers: likelihoods at converted parameters, maxima in corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fit.polish import NewtonSettings, polish_newton
from ..fit.reweigh import smoothed_weights
from ..likelihood.posterior import Posterior
from ..models.model import Model
from .common import CommonData
from .fit_one import reference_at
from .kept import Done
from .same import corner_of, log_prior_ratio, preimages

Array = NDArray[np.float64]
#: maxima of the likelihood closer than this are one (nats)
SAME_NATS = 0.1
#: share of the prior that is left when the maximum of the likelihood is looked for: flat directions stay finite
_WEAK = 0.01
_NEWTON = NewtonSettings(tolerance=1e-3, max_iterations=30)


@dataclass(frozen=True)
class Partner:
    """A second name for a function that was worked out under another.

    log_evidence: its own, which differs through its priors alone (None where the draws do not carry it); gap: of the
    log likelihood at the same function, worked out both ways (nats).
    """

    model: str
    of: str
    log_evidence: float | None
    log_evidence_se: float | None
    gap: float | None
    why: str


def exact_partner(data: CommonData, source: Model, target: Model, done: Done) -> Partner:
    """A model that is the same function as the one that was worked out, with its evidence and the check in numbers."""
    p = done.fit.posterior
    draws = done.whole.draws
    ratio = log_prior_ratio(source, target, p.model_part(draws))
    w = smoothed_weights(ratio)
    value = done.whole.log_value + w.log_mean
    se = float(np.hypot(done.whole.se, 1.0 / np.sqrt(max(w.effective, 1.0))))
    usable = w.usable or w.sd < 0.5
    return Partner(
        target.name, source.name, value if usable else None, se if usable else None,
        likelihood_gap(data, source, target, done), _why(source, target),
    )  # fmt: skip


def likelihood_gap(data: CommonData, source: Model, target: Model, done: Done) -> float | None:
    """Log likelihood of `target` at converted parameters minus that of `source` at its maximum."""
    fit = done.fit
    here = fit.posterior
    values = {k: np.atleast_1d(v) for k, v in source.physical(here.model_part(fit.x[None])).items()}
    assembled = data.assembled(target)
    reference = fit.log_likelihood
    if target.spec.effects and not source.spec.effects and not source.is_black_box:
        same = reference_at(data.simulated(source, target), fit.x)  # both worked out in the same way
        reference = float(same.log_likelihood(fit.x[None])[0])
    gaps = []
    for point in preimages(source, target, values):
        coordinates = target.priors.to_coordinates({name: point[name] for name in target.priors.names})
        z = target.from_prior_coordinates(coordinates)[0]
        q = np.concatenate([z, fit.x[source.dimension :]])
        there = assembled.refresh(assembled.posterior, q) if assembled.has_blocks else assembled.posterior
        gaps.append(float(there.log_likelihood(q[None])[0]) - reference)
    finite = [g for g in gaps if np.isfinite(g)]
    return max(finite, key=abs) if finite else None


def _why(source: Model, target: Model) -> str:
    networks = {source.spec.network, target.spec.network}
    if networks == {"gm", "gkv"}:
        return "generalised Maxwell and generalised Kelvin-Voigt networks with a spring are one transfer function"
    if networks == {"pz3", "ss3"}:
        return "a process model and its own discrete state space"
    both = (*source.spec.effects, *target.spec.effects)
    if "parallel_damper" in both:
        return "a generalised Kelvin-Maxwell network is a generalised Maxwell network with a parallel damper"
    return "an extra relaxation mode is one more Maxwell branch"


def in_corner(done: Mapping[str, Done], names: Sequence[str]) -> list[Partner]:
    """Models that fit these recordings no better than the neo-Hookean law that is a corner of them."""
    out = []
    for name in names:
        simple = corner_of(name)
        if simple is None or simple not in done or name not in done:
            continue
        reference = done[simple].fit
        gain = _best_likelihood(done[name]) - _best_likelihood(done[simple])
        if abs(gain) < SAME_NATS:
            out.append(Partner(
                name, reference.model.name, done[name].whole.log_value, done[name].whole.se, gain,
                f"these recordings put {name} in the corner where it is the neo-Hookean law",
            ))  # fmt: skip
    return out


def _best_likelihood(d: Done) -> float:
    """Largest log likelihood of a model: its maximum with the prior all but taken away."""
    posterior = d.fit.posterior
    loose = _Loosened(posterior)
    found = polish_newton(loose.log_prob, d.fit.x, settings=_NEWTON)
    return float(posterior.log_likelihood(found.x[None])[0])


@dataclass(frozen=True)
class _Loosened:
    posterior: Posterior

    def log_prob(self, q: Array) -> Array:
        """(B,) log likelihood plus a hundredth of the log prior."""
        prior = self.posterior.log_prior(q)
        good = np.isfinite(prior)
        out = np.full(len(q), -np.inf)
        if good.any():
            out[good] = self.posterior.log_likelihood(q[good]) + _WEAK * prior[good]
        return out


__all__ = ["SAME_NATS", "Partner", "exact_partner", "in_corner", "likelihood_gap"]

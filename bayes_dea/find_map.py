"""The maximum of the posterior: particle swarms over what is nonlinear, then a Newton polish of everything.

With voltage recordings the swarms move over the logarithms of the time constants, in quantiles of their prior; the
compliances are projected out: for each particle an inner Gauss-Newton iteration on their logarithms against the Gram
sums, with a normal approximation of their prior. For a nonlinear law the same search on its linearisation gives the
start. Without voltage recordings the swarms move over relaxation times and zeros of position, the moduli projected
out in the same way; where neither form holds (fixed parameters), over the whole prior box.

A swarm finds the basin soon and contracts for long. So after a few iterations all are led down by Newton steps on the
projected problem; when they end in one place the search is over, and those that end elsewhere go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .fit.descent import descend
from .fit.polish import NewtonPolish, NewtonSettings, polish_newton
from .likelihood.linear_group import LinearGroup
from .likelihood.posterior import Posterior
from .map_search.settings import MapSettings
from .map_search.starts import basins
from .map_search.straight import bent, parted
from .models.model import Model
from .search_clock import SearchClock

#: searches, each with the noise that the one before ended with
_ROUNDS = 3
#: starts as near as this, by the curvature at the end of one of them, are one start
_SAME_NATS = 0.01


@dataclass(frozen=True)
class MapResult:
    """Best point (d,), its log posterior, the Hessian there (d, d); how many of the swarms end there."""

    x: NDArray[np.float64]
    log_posterior: float
    hessian: NDArray[np.float64]
    swarms: int
    agree: int
    evaluations: int
    converged: bool


def find_map(
    posterior: Posterior,
    search_model: Model,
    linear_groups: list[LinearGroup],
    rng: np.random.Generator,
    settings: MapSettings | None = None,
    refresh: Callable[[Posterior, NDArray], Posterior] | None = None,
    given: Sequence[NDArray] = (),
    report: Callable[[float, float, str], None] | None = None,
) -> tuple[MapResult, Posterior]:
    """Maximum of the posterior and the posterior itself, with its block reference at that maximum.

    search_model: the linear model whose time constants the swarm searches (the model itself, or its linearisation).
    linear_groups: Gram groups of the voltage recordings; empty when there are none. refresh: gives the posterior with
    its within-block reference moved to a point (None when nothing is in blocks). given: starts (d,) that were found
    otherwise and take the place of the swarms'. report: called with (seconds gone, seconds expected, text).
    """
    s = settings or MapSettings()
    newton = NewtonSettings(tolerance=1e-3, max_iterations=80)
    evaluations = 0
    best: NewtonPolish | None = None
    kept: list[NDArray] = []
    clock = SearchClock(report)
    for number in range(1, _ROUNDS + 1):
        clock.round(number)
        found_at = None
        if len(given):
            starts, count = list(given), 0
        else:
            starts, count, found_at = basins(posterior, search_model, linear_groups, rng, s, clock)
        evaluations += count
        swarms = len(starts)
        if refresh is not None:
            posterior = refresh(posterior, starts[0] if best is None else best.x)
        if number < _ROUNDS and found_at is not None and search_model.spec == posterior.model.spec:
            # a search that assumed another noise than it finds leads beside the maximum, or to another one
            here, count = _noise_fitted(posterior, starts[0])
            evaluations += count
            again, nearer = _noise_moved(posterior, here), _noise_moved(posterior, here, 0.1)
            if again or nearer:
                posterior = _with_noise_of(posterior, here)
            if again:
                kept = [here]
                continue
            if nearer:
                starts, count, _ = basins(posterior, search_model, linear_groups, rng, s, clock, found_at)
                evaluations += count
        if best is not None:
            starts.append(best.x)
        elif kept:
            # what an earlier round found counts where this one has found nothing as good
            evaluations += swarms + 1
            known = np.nanmax(posterior.log_prob(np.array(starts)))
            starts += [x for x in kept if posterior.log_prob(x[None])[0] > known]
        if number == 1 and not len(given) and bent(posterior.model, search_model):
            starts.append(parted(posterior.model, starts[0]))
            evaluations += 1
        found = _polish_all(posterior, starts, newton, clock)
        evaluations += sum(f.evaluations for f in {id(f): f for f in found}.values())
        best = max(found, key=lambda f: f.value)
        runs = found[:swarms]
        if not _noise_moved(posterior, best.x):
            break
        # a misfit counts as noise: with that noise the projected search may see another maximum
        posterior = _with_noise_of(posterior, best.x)
    assert best is not None
    near = [f for f in runs if f.value >= best.value - s.agreement or _close(posterior, f.x, best.x)]
    if refresh is not None:
        # the reference moves to the maximum, and the maximum with it
        for _ in range(2):
            posterior = refresh(posterior, best.x)
            best = polish_newton(posterior.log_prob, best.x, settings=newton)
            evaluations += best.evaluations
    return MapResult(best.x, best.value, best.hessian, len(runs), len(near), evaluations, best.converged), posterior


def swarm_starts(
    posterior: Posterior,
    search_model: Model,
    linear_groups: list[LinearGroup],
    rng: np.random.Generator,
    settings: MapSettings,
    report: Callable[[float, float, str], None] | None = None,
) -> list[NDArray]:
    """Where the best swarm leads, not polished: coordinates of the posterior (d,); arguments as for `find_map`.

    For a law that is not straight the same again with its fastest branch faster (`parted`).
    """
    clock = SearchClock(report)
    starts = basins(posterior, search_model, linear_groups, rng, settings, clock, most=1)[0][:1]
    if bent(posterior.model, search_model):
        starts.append(parted(posterior.model, starts[0]))
    return starts


def _polish_all(
    posterior: Posterior,
    starts: list[NDArray],
    newton: NewtonSettings,
    clock: SearchClock,
) -> list[NewtonPolish]:
    """Each start polished; those that stand at one and the same place share their polish."""
    scale = posterior_scale(posterior)
    found: list[NewtonPolish] = []
    polished: list[int] = []
    clock.polishing()
    for i, start in enumerate(starts):
        twin = next((k for k in polished if _same(start, starts[k], found[k], scale)), None)
        if twin is not None:
            found.append(found[twin])
        else:
            polished.append(i)
            if np.isfinite(posterior.log_prob(start[None])[0]):
                found.append(polish_newton(posterior.log_prob, start, settings=newton))
            else:
                nowhere = np.full((start.size, start.size), np.nan)
                found.append(NewtonPolish(start, -np.inf, nowhere, np.zeros(start.size, bool), np.inf, False, 0, 1))
        clock.polished(len(polished), len(polished) + len(starts) - 1 - i)
    return found


def _same(start: NDArray, other: NDArray, end: NewtonPolish, scale: NDArray) -> bool:
    """Whether a start stands where `other` stood, or at the end that was reached from there.

    A thousandth of the coordinates' scales is the same place; so is, once the curvature is known, what lies within a
    hundredth of a nat.
    """
    if np.max(np.abs(start - other) / scale) < 1e-3:
        return True
    if not end.converged or not np.isfinite(end.hessian).all():
        return False
    return any(-0.5 * (start - x) @ end.hessian @ (start - x) < _SAME_NATS for x in (other, end.x))


def _close(posterior: Posterior, a: NDArray, b: NDArray) -> bool:
    return bool(np.linalg.norm((a - b) / posterior_scale(posterior)) < 0.05)


def _noise_moved(posterior: Posterior, q: NDArray, share: float = 1.0) -> bool:
    """Whether the noise at q differs from what the search assumed by more than it forgives, or a share of that."""
    for c in posterior.channels:
        sigma, rho = posterior.noise_part(q[None], c.channel)
        if abs(np.log(sigma[0] / c.sigma_guess)) > 0.25 * share:
            return True
        guess = np.arctanh(np.clip(c.rho_guess, -0.99, 0.9999))
        if np.any(np.abs(np.arctanh(np.clip(rho[0], -0.9999, 0.99999)) - guess) > 0.4 * share):
            return True
    return False


def _noise_fitted(posterior: Posterior, q: NDArray) -> tuple[NDArray, int]:
    """q with its noise, and nothing else, at the maximum; and how often the density was called."""
    first = posterior.zero_start + len(posterior.zeros)

    def objective(noise: NDArray) -> NDArray:
        at = np.tile(q, (len(noise), 1))
        at[:, first:] = noise
        return -posterior.log_prob(at)

    ends, _, evaluations = descend(objective, q[None, first:], np.ones(q.size - first))
    return np.concatenate([q[:first], ends[0]]), evaluations


def _with_noise_of(posterior: Posterior, q: NDArray) -> Posterior:
    """The posterior whose searches start from the noise at q."""
    channels = []
    for c in posterior.channels:
        sigma, rho = posterior.noise_part(q[None], c.channel)
        channels.append(replace(c, sigma_guess=float(sigma[0]), rho_guess=tuple(float(r) for r in rho[0])))
    return replace(posterior, channels=tuple(channels))


def posterior_scale(posterior: Posterior) -> NDArray:
    """A length for each coordinate: one for logarithms, the prior sd for zeros of position."""
    scale = np.ones(posterior.dimension)
    for i, p in enumerate(posterior.model.priors.free):
        if not p.prior.is_log:
            scale[i] = p.prior.coordinate_sd()
    for i, zero in enumerate(posterior.zeros):
        scale[posterior.zero_start + i] = zero.sd
    return scale


def laplace_covariance(result: MapResult, posterior: Posterior, rng: np.random.Generator) -> NDArray:
    """Covariance (d, d) at the maximum, no direction wider than the prior."""
    prior = np.cov(posterior.prior_draws(2000, rng).T) + 1e-12 * np.eye(posterior.dimension)
    hessian = np.where(np.isfinite(result.hessian), result.hessian, 0.0)
    scale = np.sqrt(np.diag(prior))
    eig, vec = np.linalg.eigh(-hessian * np.outer(scale, scale))
    eig = np.maximum(eig, 0.5)
    return (vec / eig) @ vec.T * np.outer(scale, scale)


__all__ = ["MapResult", "MapSettings", "find_map", "laplace_covariance", "posterior_scale", "swarm_starts"]

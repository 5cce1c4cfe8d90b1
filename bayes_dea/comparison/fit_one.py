"""One model on the common data: maximum, Laplace's evidence, and what the comparison needs of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ..assemble import Assembled, remove_nuisance
from ..errors import InputError
from ..find_map import MapResult, MapSettings, find_map, laplace_covariance
from ..fit.evidence import laplace_log_evidence
from ..fit.mixture import Mixture, joined
from ..fit.polish import NewtonSettings, polish_newton
from ..fit.swarm import SwarmSettings
from ..forward import memory, simulate
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import Prepared
from ..likelihood.remembering import remembering
from ..models.model import PRIMARY, Model, build_model
from .climb import climb, first_difference_covariance
from .integrate import normal_mixture
from .same import preimages
from .simulated import Survey, laplace_of, maximum_of, remembered, survey

Array = NDArray[np.float64]
Say = Callable[[float, float, str], None]
#: fewer swarms than a calibration has: a maximum that one of four misses shows as a gap to a neighbour in the list
SEARCH = MapSettings(
    swarms=4, swarm=SwarmSettings(particles=32, max_iterations=120, stall_iterations=15, tolerance=0.02)
)
_NEWTON = NewtonSettings(tolerance=0.01, max_iterations=25)
_APART = 5.0


@dataclass(frozen=True)
class Fitted:
    """A model at its maximum; laplace: its log evidence, nan where the maximum is none (a bound, a ridge).

    proposal: normals at all maxima that were found, where there are several.
    """

    model: Model
    assembled: Assembled = field(repr=False)
    posterior: Posterior = field(repr=False)
    x: Array = field(repr=False)
    covariance: Array = field(repr=False)
    log_posterior: float
    log_likelihood: float
    laplace: float
    agree: int
    swarms: int
    proposal: Mixture | None = field(default=None, repr=False)


def fit_one(
    assembled: Assembled,
    model: Model,
    rng: np.random.Generator,
    linear: Fitted | None = None,
    starts: Sequence[Array] = (),
    say: Say | None = None,
    search: MapSettings = SEARCH,
) -> Fitted:
    """Maximum of one model's posterior and Laplace's evidence there.

    linear: the fit of Hooke's law with the same network, where a nonlinear law starts from. starts: where maxima are
    expected, in place of a search with swarms.
    """
    if starts:
        return _from_starts(assembled, model, rng, starts, say)
    if model.spec.effects:
        return simulated_fit(assembled, model, rng, search, say)[0]
    if linear is not None and not model.is_linear:
        found, posterior = _from_linear(assembled, model, linear)
    else:
        found, posterior = find_map(
            assembled.posterior, assembled.search_model, list(assembled.search_groups), rng, search,
            assembled.refresh if assembled.has_blocks else None, (), say,
        )  # fmt: skip
    return fitted_at(assembled, model, posterior, found, rng)


def fitted_at(
    assembled: Assembled, model: Model, posterior: Posterior, found: MapResult, rng: np.random.Generator
) -> Fitted:
    """What is kept of a maximum."""
    if not np.isfinite(found.log_posterior):
        raise InputError(f"{model.name}: has no answer on these recordings anywhere near its prior; check the geometry")
    covariance = laplace_covariance(found, posterior, rng)
    # a function of x alone, so that a run that goes on has the very same density
    posterior = reference_at(assembled, found.x)
    value = float(posterior.log_prob(found.x[None])[0])
    try:
        laplace = laplace_log_evidence(value, found.hessian)
    except InputError:
        laplace = float("nan")
    return Fitted(
        model, assembled, posterior, found.x, covariance, value,
        float(posterior.log_likelihood(found.x[None])[0]), laplace, found.agree, found.swarms,
    )  # fmt: skip


def _from_starts(
    assembled: Assembled, model: Model, rng: np.random.Generator, starts: Sequence[Array], say: Say | None
) -> Fitted:
    """The best of several maxima; the others join the proposal by the share of the posterior that they hold."""
    posterior = assembled.posterior
    values = posterior.log_prob(np.array(starts))
    order = [i for i in np.argsort(-values) if np.isfinite(values[i])]
    if not order:
        raise InputError(f"{model.name}: has no answer on these recordings anywhere near its prior; check the geometry")
    posterior = assembled.refresh(posterior, starts[order[0]]) if assembled.has_blocks else posterior
    found: list[MapResult] = []
    for n, i in enumerate(order):
        if say is not None:
            say(n, len(order), f"place {n + 1} of {len(order)}")
        f = polish_newton(posterior.log_prob, starts[i], settings=_NEWTON)
        found.append(MapResult(f.x, f.value, f.hessian, 1, 1, f.evaluations, f.converged))
    best = max(found, key=lambda f: f.log_posterior)
    near = [f for f in found if f.log_posterior > best.log_posterior - 0.1]
    out = fitted_at(assembled, model, posterior, replace(best, agree=len(near), swarms=len(near)), rng)
    parts: list[Mixture] = []
    places: list[tuple[Array, Array]] = []
    shares: list[float] = []
    for m in sorted(found, key=lambda m: -m.log_posterior):
        covariance = laplace_covariance(m, posterior, rng)
        scale = np.sqrt(np.diag(covariance))
        if m.log_posterior < best.log_posterior - 15 or any(
            np.max(np.abs(m.x - x) / np.minimum(scale, size)) < 0.5 for x, size in places
        ):
            continue
        places.append((m.x, scale))
        shares.append(m.log_posterior + float(np.sum(np.log(np.diag(np.linalg.cholesky(
            covariance / np.outer(scale, scale) + 1e-10 * np.eye(scale.size))))) + np.sum(np.log(scale))))
        parts.append(normal_mixture(m.x, covariance))
    # no maximum gets less than a few per cent: what a normal at it says of its share is a guess
    share = np.maximum(np.exp(np.array(shares) - max(shares)), 0.05)
    share /= share.sum()
    mixture = Mixture(
        np.concatenate([a * g.weights for a, g in zip(share, parts, strict=True)]),
        np.concatenate([g.means for g in parts]), np.concatenate([g.roots for g in parts]),
    )  # fmt: skip
    return replace(out, proposal=mixture)


def reference_at(assembled: Assembled, x: Array) -> Posterior:
    """The posterior with what block means average away taken from the residuals at x (d,), of every recording.

    Without it a recording that is only predicted would be scored by its block means alone, and a model in blocks could
    not be compared with one that is scored sample by sample.
    """
    if not assembled.has_blocks:
        return assembled.posterior
    posterior = assembled.refresh(assembled.posterior, x)
    groups: list[LinearGroup | BlockGroup] = []
    for group in posterior.groups:
        kept = [p for p in group.others if p.recording.is_voltage]
        if isinstance(group, BlockGroup) and kept:
            group = group.with_reference({p.name: residual_at(posterior, assembled, x, group, p) for p in kept})
        groups.append(group)
    posterior = replace(posterior, groups=tuple(groups))
    return remembering(posterior) if posterior.model.spec.effects else posterior


def residual_at(
    posterior: Posterior, assembled: Assembled, x: Array, group: LinearGroup | BlockGroup, p: Prepared,
    zero: float | None = None,
) -> Array:
    """What a recording leaves (n,) at coordinates x (d,), after its own offset and mains and the group's gain."""
    model = posterior.model
    values = {k: float(v[0]) for k, v in model.physical(posterior.model_part(x[None], group.specimen)).items()}
    gain = float(posterior.group_terms(x[None], group)[0, 1]) if group.fitted else 0.0
    earlier = memory([q.recording for q in assembled.prepared], p.recording)
    return remove_nuisance(p, p.y - (1 + gain) * simulate(model, values, p.recording, zero, earlier))


def _from_linear(assembled: Assembled, model: Model, linear: Fitted) -> tuple[MapResult, Posterior]:
    """A nonlinear law from the maximum of Hooke's law with the same network: modulus and network kept.

    Where a straight law is fitted to a bent one, its branches take on the bend, and from there a descent may end at a
    minor maximum, two of them in one place: the second start has the fastest branch five times faster.
    """
    start = _start_of(model, linear)
    posterior = assembled.refresh(assembled.posterior, start) if assembled.has_blocks else assembled.posterior
    starts = [start] if model.spec.network == "none" else [start, _start_of(model, linear, parted=True)]
    found = max((polish_newton(posterior.log_prob, x, settings=_NEWTON) for x in starts
                 if np.isfinite(posterior.log_prob(x[None])[0]) or x is start), key=lambda f: f.value)
    if assembled.has_blocks:
        # the reference moves to the maximum, and the maximum with it
        posterior = assembled.refresh(posterior, found.x)
        found = polish_newton(posterior.log_prob, found.x, settings=_NEWTON)
    return MapResult(found.x, found.value, found.hessian, 1, 1, found.evaluations, found.converged), posterior


def _start_of(model: Model, linear: Fitted, parted: bool = False) -> Array:
    """Coordinates (d,) of a nonlinear law: what it shares with the linear fit from there, the rest at its prior.

    parted: the fastest branch another factor of five faster.
    """
    posterior = linear.posterior
    values = {k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(linear.x[None])).items()}
    primary, factor = PRIMARY[model.spec.law or "hooke"]
    values[primary] = values["Y_Pa"] / factor
    times = [k for k in values if k.startswith("tau_")]
    if parted and times:
        values[min(times, key=lambda k: values[k])] /= _APART
    centre = replace(model, plain=False).priors.draw(2000, np.random.default_rng(0)).mean(axis=0)
    for i, p in enumerate(model.priors.free):
        if p.name in values and p.name != "Y_Pa":
            centre[i] = p.prior.to_coordinate(values[p.name])
    z = model.from_prior_coordinates(centre[None])[0]
    further = linear.x[linear.posterior.model.dimension :]
    return np.concatenate([z, further])


def simulated_fit(
    assembled: Assembled, model: Model, rng: np.random.Generator, search: MapSettings = SEARCH, say: Say | None = None
) -> tuple[Fitted, tuple[Survey, ...]]:
    """Maximum of a model with effects, searched as the diagnosis does, and an emulator around each maximum.

    Second differences of simulations take minutes and drown in their last digits: those of the emulator do not.
    """
    from ..mismatch.search.starts import effect_starts

    r_search, r_climb, r_survey, r_laplace = rng.spawn(4)
    starts = effect_starts(assembled, model, r_search, search)
    if not starts:
        found, _ = find_map(
            assembled.posterior, assembled.search_model, list(assembled.search_groups), r_search, search,
            assembled.refresh if assembled.has_blocks else None, (), say,
        )  # fmt: skip
        starts = [found.x]
    places = _places(assembled, model, starts, r_climb, say)
    surveys = []
    for i, (x, posterior) in enumerate(places):
        part = None if say is None else lambda a, b, text, i=i: say((i + a / b) / len(places), 1.0, text)
        surveys.append(survey(posterior, x, assembled.search_groups, r_survey, say=part))
    maxima = [maximum_of(a, x) for a, (x, _) in zip(surveys, places, strict=True)]
    at = max(maxima, key=lambda m: m.log_posterior)
    if not np.isfinite(at.log_posterior):
        raise InputError(f"{model.name}: has no answer on these recordings anywhere near its prior; check the geometry")
    posterior = remembered(reference_at(assembled, at.x), *(a.emulation.exact for a in surveys))
    log_posterior = float(posterior.log_prob(at.x[None])[0])
    proposal = None
    if len(maxima) > 1:
        parts = [normal_mixture(m.x, laplace_covariance(m, posterior, r_laplace)) for m in maxima]
        proposal = joined(parts, np.full(len(parts), 1.0 / len(parts)))
    fit = Fitted(
        model, assembled, posterior, at.x, laplace_covariance(at, posterior, r_laplace), log_posterior,
        float(posterior.log_likelihood(at.x[None])[0]), laplace_of(at, log_posterior), 1, 1, proposal,
    )  # fmt: skip
    return fit, tuple(surveys)


def _places(
    assembled: Assembled, model: Model, starts: Sequence[Array], rng: np.random.Generator, say: Say | None
) -> list[tuple[Array, Posterior]]:
    """Maxima that differ, the best first, each with the posterior that has its reference there."""
    value = assembled.posterior.log_prob(np.array(starts))
    order = [starts[i] for i in np.argsort(-np.where(np.isfinite(value), value, -np.inf)) if np.isfinite(value[i])]
    if not order:
        raise InputError(f"{model.name}: has no answer on these recordings anywhere near its prior; check the geometry")
    order = _distinct([*order, *_relabelled(assembled, model, order[0])], 0.02)
    out: list[tuple[Array, Posterior, Array]] = []
    for i, start in enumerate(order):
        if say is not None:
            say(i, len(order), "climbing")
        if i and not np.isfinite(assembled.posterior.log_prob(start[None])[0]):
            continue
        x, posterior = climb(start, lambda x: reference_at(assembled, x), rng)
        sd = np.sqrt(np.diag(first_difference_covariance(posterior, x, rng)))
        if not any(np.max(np.abs(x - other) / np.minimum(sd, size)) < 1.0 for other, _, size in out):
            out.append((x, posterior, sd))
    heights = [float(p.log_prob(x[None])[0]) for x, p, _ in out]
    best = max(heights)
    kept = sorted(((h, i) for i, h in enumerate(heights) if h > best - 12.0), reverse=True)
    return [(out[i][0], out[i][1]) for _, i in kept]


def _relabelled(assembled: Assembled, model: Model, start: Array) -> list[Array]:
    """The same function with another of its branches called the extra one: a maximum of its own."""
    if "extra_relaxation_mode" not in model.spec.effects or model.spec.elements == 0 or assembled.posterior.own:
        return []
    values = {k: np.atleast_1d(v) for k, v in model.physical(start[None, : model.dimension]).items()}
    out = []
    for point in preimages(model, model, values):
        there = model.priors.to_coordinates({name: point[name] for name in model.priors.names})
        out.append(np.concatenate([model.from_prior_coordinates(there)[0], start[model.dimension :]]))
    return out


def _distinct(points: Sequence[Array], apart: float) -> list[Array]:
    """Points (d,) without those that are next to an earlier one; coordinates are logarithms."""
    out: list[Array] = []
    for x in points:
        if not any(np.max(np.abs(x - other)) < apart for other in out):
            out.append(x)
    return out


def linear_partner(model: Model) -> Model | None:
    """Hooke's law with the network of a nonlinear law; None where there is none to start from."""
    if model.is_linear or model.spec.effects or model.plain:
        return None
    network = f"+{model.spec.network}{model.spec.elements}" if model.spec.network != "none" else ""
    own = {p.name: p for p in model.parameters}
    bare = build_model(f"hooke{network}")
    if any(own[p.name].fixed for p in bare.parameters if p.name in own):
        return None
    return bare

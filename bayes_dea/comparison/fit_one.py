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
from ..fit.mixture import Mixture
from ..fit.polish import NewtonSettings, polish_newton
from ..fit.swarm import SwarmSettings
from ..forward import memory, simulate
from ..likelihood.block_group import BlockGroup
from ..likelihood.linear_group import LinearGroup
from ..likelihood.posterior import Posterior
from ..likelihood.prepare import Prepared
from ..likelihood.remembering import remembering
from ..models.model import PRIMARY, Model, build_model
from .integrate import normal_mixture

Array = NDArray[np.float64]
Say = Callable[[float, float, str], None]
#: fewer swarms than a calibration has: a maximum that one of four misses shows as a gap to a neighbour in the list
SEARCH = MapSettings(
    swarms=4, swarm=SwarmSettings(particles=32, max_iterations=120, stall_iterations=15, tolerance=0.02)
)
_NEWTON = NewtonSettings(tolerance=0.01, max_iterations=25)


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
        found, posterior = _with_effects(assembled, model, rng, search, say)
    elif linear is not None and not model.is_linear:
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
    """A nonlinear law from the maximum of Hooke's law with the same network: modulus and network kept."""
    start = _start_of(model, linear)
    posterior = assembled.refresh(assembled.posterior, start) if assembled.has_blocks else assembled.posterior
    found = polish_newton(posterior.log_prob, start, settings=_NEWTON)
    if assembled.has_blocks:
        # the reference moves to the maximum, and the maximum with it
        posterior = assembled.refresh(posterior, found.x)
        found = polish_newton(posterior.log_prob, found.x, settings=_NEWTON)
    return MapResult(found.x, found.value, found.hessian, 1, 1, found.evaluations, found.converged), posterior


def _start_of(model: Model, linear: Fitted) -> Array:
    """Coordinates (d,) of a nonlinear law: what it shares with the linear fit from there, the rest at its prior."""
    posterior = linear.posterior
    values = {k: float(v[0]) for k, v in posterior.model.physical(posterior.model_part(linear.x[None])).items()}
    primary, factor = PRIMARY[model.spec.law or "hooke"]
    values[primary] = values["Y_Pa"] / factor
    centre = replace(model, plain=False).priors.draw(2000, np.random.default_rng(0)).mean(axis=0)
    for i, p in enumerate(model.priors.free):
        if p.name in values and p.name != "Y_Pa":
            centre[i] = p.prior.to_coordinate(values[p.name])
    z = model.from_prior_coordinates(centre[None])[0]
    further = linear.x[linear.posterior.model.dimension :]
    return np.concatenate([z, further])


def _with_effects(
    assembled: Assembled, model: Model, rng: np.random.Generator, search: MapSettings, say: Say | None
) -> tuple[MapResult, Posterior]:
    """Effects are searched as the diagnosis searches them; what was simulated is remembered."""
    from ..mismatch.starts import effect_starts

    starts = effect_starts(assembled, model, rng, search)
    found, posterior = find_map(
        assembled.posterior, assembled.search_model, list(assembled.search_groups), rng, search,
        assembled.refresh if assembled.has_blocks else None, starts[:1], say,
    )  # fmt: skip
    return found, posterior


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

"""How many springs with sliders friction has: counted where it is among the effects that explain.

The law of friction is a distribution of yield strains; its elements are how a material or a simulator fills it. Few of
them leave corners in a loop, which recordings of strong friction show: to a model with other elements they are a
mismatch that nothing on the list explains. The count is a whole number, and so no coordinate of a fit: each is a law.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...gauss_newton.descent import Linearisation, value_at
from ...gauss_newton.laws import COUNTED, COUNTS
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model, build_model
from ...priors import Prior
from ..where.size import effect_size
from .frame import Frame, trusted
from .weigh import Weighed, excess

#: counts to either side of the best that are tried, too, and how often the search goes on from there
_AROUND, _ROUNDS = 4, 4
#: nats of likelihood that another count has to promise
_LEAST = 1.0
#: nats of misfit that may be left in any case
_SMALL = 200.0


def counted(found: Weighed, base: Fit, prior: NoisePrior) -> Weighed:
    """The same explanation with as many elements as the recordings say.

    Itself where it has none that are counted, where no other count is likelier by more than that it is one of many, or
    where one leaves more than it takes: it does the work of another effect then, a little of it.
    """
    name = next((COUNTED[e] for e in found.effects if e in COUNTED), None)
    if name is None or not found.refitted:
        return found
    best = fit = found.fit
    for _ in range(_ROUNDS):
        again = _nearer(fit, name, prior)
        # the first step away from the usual count pays for all that were possible
        if again is None or (fit is not found.fit and again.objective > fit.objective - _LEAST):
            break
        fit = again
        best = min(best, fit, key=lambda f: f.objective)
    if best is found.fit or excess(best, prior) > max(found.fit.objective - best.objective, _SMALL):
        return found
    # that of several is what the last of them moves, beside the others
    size = effect_size(base, best) if len(found.effects) == 1 else found.size_m
    return replace(
        found, fit=best, log_evidence=best.log_evidence + found.shared_prior,
        log_evidence_se=max(found.log_evidence_se, 0.1), size_m=size,
        value=value_at(best.problem, best.q, prior.start()),
    )


def counted_as(model: Model, leader: Model) -> Model:
    """A model with as many elements as another one has, where both have any."""
    for name in COUNTED.values():
        if name in model.priors.fixed and name in leader.priors.fixed:
            count = leader.priors.fixed[name]
            model = model if model.priors.fixed[name] == count else _with_count(model, name, round(count))
    return model


def _nearer(fit: Fit, name: str, prior: NoisePrior) -> Fit | None:
    """The fit with the count that promises most, everything else moved along, refitted; None where none promises."""
    problem = fit.problem
    model = problem.model
    if name not in model.priors.fixed:  # left free, or without a meaning here
        return None
    now = round(model.priors.fixed[name])
    frame = Frame(replace(fit, noise=prior.start()))
    below = frame.value(fit.clean)[0] - _LEAST
    found = []
    around = range(max(now - _AROUND, COUNTS[0]), now + _AROUND + 1) if now else ()
    for count in sorted({*COUNTS, *around} - {now}):
        other = problem.with_model(_with_count(model, name, count))
        clean = other.clean(fit.q)
        if not all(np.isfinite(x).all() for x in clean):
            continue
        value, move = frame.value(clean)
        if value < below:
            found.append((value, other, move, clean))
    if not found:
        return None
    _, likeliest, move, clean = min(found, key=lambda f: f[0])
    start = fit.q + trusted(move)
    # hardly another model: its sensitivities are nearly these
    near = Linearisation(fit.q, clean, fit.slopes, exact=False)
    return refit(likeliest, start, prior.start(), prior, coarse=True, known=near)


def _with_count(model: Model, name: str, count: int) -> Model:
    """The same model with another count of elements."""
    given = {p.name: p for p in model.parameters} | {name: Prior("fixed", float(count))}
    return build_model(model.name, given)

"""By how much the true equations lead every rival, in one campaign of the study.

What recordings can name is what no rival comes near: it does not matter how much an effect changes them but how much
better the truth explains them than the best of everything else. The truth is fitted from its true values, so that a
search that missed it does not count as recordings that cannot tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

DELAY = "acquisition_delay"


def lead_of(case: Any, campaign: Any, result: Any) -> float | None:
    """Nats of log evidence by which the truth leads the best rival that was weighed ("none" is one of them).

    Hypotheses that hold the truth and more are no rivals. Readings that stand beside their command are part of what is
    true, and of every rival. None where nothing, or nothing on the list, is concealed, or
    where the true values cannot be fitted.
    """
    truth = set(case.truth.split("+"))
    if truth & {"none", "unknown"} or set(case.effects) != truth:
        return None
    weighed = {k: v for k, v in result.naming.log_evidence.items() if k != "unknown"}
    whole = truth | _timing(case)
    own = [v for k, v in weighed.items() if set(k.split("+")) == whole]
    fitted = fit_of_the_truth(case, campaign, result.base, result.assembled)
    own += [] if fitted is None else [float(fitted.log_evidence)]
    rivals = [v for k, v in weighed.items() if not truth <= set(k.split("+"))]
    return max(own) - max(rivals) if own and rivals else None


def names_of(case: Any) -> list[str]:
    """What is true of a case: its effects, and the delay by which its readings stand beside their command."""
    return [*case.truth.split("+"), *_timing(case)]


def _timing(case: Any) -> set[str]:
    """The delay by which readings stand beside their command in a case, be it early or late."""
    return {DELAY} if case.plan.faults.displacement_late_s else set()


def _laws(names: Sequence[str], known: Mapping[str, float]) -> dict[str, Any]:
    """Priors of further laws that effects follow in the truth, by parameter.

    One that stands still unless asked for (a leak that the field activates) acts where the truth has it; one of
    negative values (readings that lead, a material that shrinks) where that is negative.
    """
    from bayes_dea.gauss_newton.laws import VARIANTS

    laws = [law for n in names for law in VARIANTS.get(n, {}).items()]
    return {p: prior for p, prior in laws if known.get(p) and (prior.b > 0.0 or known[p] < 0.0)}


def fit_of_the_truth(case: Any, campaign: Any, base: Any, assembled: Any) -> Any:
    """The true model fitted from its true values, on the recordings that `base` was fitted to; None where it has no
    answer there."""
    from bayes_dea.gauss_newton.laws import COUNTED
    from bayes_dea.gauss_newton.noise_prior import noise_prior
    from bayes_dea.gauss_newton.refit import refit
    from bayes_dea.mismatch.search.hypotheses import effect_priors, extended
    from bayes_dea.priors import Prior

    late_s = case.plan.faults.displacement_late_s
    names = names_of(case)
    known = {**case.parameters, **({"T_d_s": late_s} if late_s else {})}
    counts = {COUNTED[n]: Prior("fixed", case.parameters["elements"]) for n in names if n in COUNTED}
    model = extended(base.problem.model, names, {**effect_priors(names, campaign), **_laws(names, known), **counts})
    if model is None:
        return None
    fixed = model.priors.fixed
    true = {p.name: np.array([fixed.get(p.name, known.get(p.name, np.nan))]) for p in model.parameters}
    if not all(np.isfinite(v[0]) for v in true.values()):
        return None
    z = model.from_prior_coordinates(model.priors.to_coordinates(true))[0]
    q = np.concatenate([z, base.q[base.problem.model.dimension :]])
    prior = noise_prior(assembled)
    fit = refit(base.problem.with_model(model), q, prior.start(), prior)
    return None if fit is None or not np.isfinite(fit.log_evidence) else fit

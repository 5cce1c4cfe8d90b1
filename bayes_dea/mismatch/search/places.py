"""Where the priors expect a mode is no evidence for one more.

The time constants of a network have priors of their own places, slowest first; a further mode may lie anywhere. An
actuator whose modes are all quicker than the places say pays for that, tens of nats, where nothing is left out; with a
further mode it pays nothing: that takes the quick place, the others move up by one, and one of the base's idles. So
what is explained with a further mode is weighed without one in the same freedom: the further mode stays, and one of the
base's is gone. It has as many modes as the base, wherever they lie.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from ...gauss_newton.descent import approach
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import build_model
from ...priors import Parameter, Prior
from .hypotheses import NONE
from .relabel import FURTHER
from .weigh import Weighed

#: modulus of a mode that is gone, by the static one
_GONE = 1e-7


def in_any_place(found: Weighed, prior: NoisePrior) -> Fit | None:
    """`found` (with `FURTHER` among its effects) with one of the base's modes gone, refitted; None where there is none.

    The one that is missed least. Networks whose modes are exchangeable with a further one only (gm).
    """
    model = found.fit.problem.model
    spec = model.spec
    if FURTHER not in found.effects or spec.network != "gm" or spec.elements < 1:
        return None
    own = {p.name: p for p in model.parameters}
    values = found.fit.values()
    ends = []
    for i in range(1, spec.elements + 1):
        tau, k = f"tau_{i}_s", f"k_{i}_Pa"
        if not {tau, k} <= set(model.priors.names):
            continue
        next_to_nothing = _GONE * values.get("Y_Pa", values[k])
        gone: dict[str, Parameter | Prior] = {tau: Prior("fixed", values[tau]), k: Prior("fixed", next_to_nothing)}
        problem = found.fit.problem.with_model(build_model(model.name, {**own, **gone}))
        x = np.array([[p.prior.to_coordinate(values[p.name]) for p in problem.model.priors.free]])
        q = np.concatenate([problem.model.from_prior_coordinates(x)[0], found.fit.q[model.dimension :]])
        if not np.isfinite(q).all():
            continue
        end = approach(problem, q, prior.start())
        if end is not None:
            ends.append((end.value, i, problem, end.q))
    if not ends:
        return None
    _, _, problem, q = min(ends, key=lambda e: e[:2])
    return refit(problem, q, prior.start(), prior, coarse=True)


def with_free_places(
    evidence: Mapping[str, float], weighed: Iterable[Weighed], prior: NoisePrior
) -> dict[str, float]:
    """Log evidences by name, those of hypotheses without a further mode with the freedom of those that have one.

    weighed: the hypotheses with a further mode that matter. The places that are gone share the weight that the base's
    own have.
    """
    out = dict(evidence)
    for w in weighed:
        name = "+".join(e for e in w.effects if e != FURTHER) or NONE
        fit = in_any_place(w, prior) if name in out else None
        if fit is not None:
            free = fit.log_evidence - math.log(fit.problem.model.spec.elements)
            out[name] = float(np.logaddexp(out[name], free))
    return out

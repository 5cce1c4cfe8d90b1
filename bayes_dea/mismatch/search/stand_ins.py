"""How large an effect is where a mode of the base does its work: against a base whose modes stay what they are.

Without the effect the fastest mode may leave for where it is needed more: a damper of 1.4 kPa s is a branch of 250 MPa
that relaxes in 6 us. What such a base leaves to be seen of the effect is a few hundredths of a micrometre, and yet it
is no smaller a damper. So an effect is held against the simpler explanation with that mode where the effect lets it be;
or, where it has left for what no recording shows as a mode, at the edge of that.
"""

from __future__ import annotations

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import build_model
from ...priors import Parameter, Prior
from .relocate import FAST_STEPS, stands_in, with_modes


def with_true_modes(fit: Fit, simpler: Fit, prior: NoisePrior) -> Fit | None:
    """The simpler of two explanations with its fastest mode where the other has it, the rest refitted.

    None where these modes are not to be told by their places (networks but gm), or one of the other stands in for
    something itself (`stands_in`).
    """
    spec = simpler.problem.model.spec
    if spec.network != "gm" or spec.elements < 1 or stands_in(fit):
        return None
    values, edge = fit.values(), FAST_STEPS * min(p.prepared.step_s for p in fit.problem.pieces)
    n = spec.elements
    slower = values.get(f"tau_{n - 1}_s", np.inf)
    places = (values[f"tau_{n}_s"], edge) if stands_in(simpler) else (values[f"tau_{n}_s"],)
    found = [_held(fit, simpler, t, prior) for t in places if t < slower]
    return min((f for f in found if f is not None), key=lambda f: f.objective, default=None)


def _held(fit: Fit, simpler: Fit, fastest_s: float, prior: NoisePrior) -> Fit | None:
    """The simpler one, refitted from where the other stands, with the time constant (s) of its fastest mode held."""
    model, values = simpler.problem.model, fit.values()
    own: dict[str, Parameter | Prior] = {p.name: p for p in model.parameters}
    held = Prior("fixed", fastest_s)
    problem = fit.problem.with_model(build_model(model.name, {**own, f"tau_{model.spec.elements}_s": held}))
    if not set(problem.model.priors.names) <= set(values):
        return None
    q = with_modes(fit, problem.model, values, [])
    if not np.isfinite(q).all():
        return None
    # at the noise of what explains more: that of a base has grown
    return refit(problem, q, fit.noise, prior, fit_noise=False, coarse=True)

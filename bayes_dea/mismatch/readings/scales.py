"""Voltage and mechanical recordings that disagree on how stiff the actuator is by a factor: a number of its geometry,
or a unit, is wrong, and no physics brings the two together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit

#: sd of the logarithm of a factor that nothing is known of
_ANY = 3.0
#: nats of evidence that such a factor has to bring, and the least one that no physics of an actuator makes
_CLEAR, _LEAST = 50.0, 1.5


@dataclass(frozen=True)
class OddScale:
    """Displacements over what the geometry and the mechanical recordings lead to expect."""

    ratio: float

    def note(self) -> str:
        """One line on it."""
        return (
            f"the displacements under voltage are {self.ratio:.3g} times what the geometry and the mechanical "
            "recordings lead to expect, more than physics of an actuator does: check stack_height_m, layers, "
            "layer_thickness_m, relative_permittivity and the areas in [actuator], and the units of displacement, "
            "position and force"
        )


def odd_scale(base: Fit, prior: NoisePrior) -> OddScale | None:
    """The factor between the two kinds of recordings, where it explains far more than the sensors' accuracy allows."""
    problem = base.problem
    groups = {p.group for p in problem.pieces if p.channel == "displacement"}
    if not groups or all(p.channel == "displacement" for p in problem.pieces):
        return None
    sd = problem.gain_sd.copy()
    sd[list(groups)] = _ANY
    free = refit(replace(problem, gain_sd=sd), base.q, prior.start(), prior)
    if free is None or free.log_evidence < base.log_evidence + _CLEAR:
        return None
    first = problem.dimension - sd.size
    ratio = math.exp(float(np.mean([free.q[first + g] for g in groups])))
    return OddScale(ratio) if abs(math.log(ratio)) > math.log(_LEAST) else None

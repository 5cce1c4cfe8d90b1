"""A shift of less than one sample is timing, not physics: what of a delay is too short to be claimed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import ndtr

from .hypotheses import DELAY, NONE
from .name import Naming
from .refit import Fit

_PARAMETER = "T_d_s"


@dataclass(frozen=True)
class Shift:
    """Probabilities by name with every delay below one sample taken out of its name.

    physics: the hypothesis behind each name. delays_s: the shift that a name carries unsaid, by name.
    """

    probability: dict[str, float]
    physics: dict[str, str]
    delays_s: dict[str, float]


def as_timing(probability: dict[str, float], naming: Naming, step_s: float) -> Shift:
    """Move the probability that a delay is shorter than one sample (step_s) to the name without it."""
    p = dict(probability)
    physics = {k: k for k in p}
    delays: dict[str, float] = {}
    for name in list(p):
        parts = name.split("+")
        if DELAY not in parts or name not in naming.weighed:
            continue
        fit = naming.weighed[name].fit
        if all(x.name != _PARAMETER for x in fit.problem.model.priors.free):  # not refitted: it is far behind
            continue
        centre, sd = _log_delay(fit)
        share = float(ndtr((math.log(step_s) - centre) / max(sd, 1e-9)))
        bare = "+".join(x for x in parts if x != DELAY) or NONE
        moved = p[name] * share
        if moved > p.get(bare, 0.0):
            delays[bare] = math.exp(centre)
            # "none" stays what it is; another name is corrected with the shift in it
            physics[bare] = NONE if bare == NONE else name
        p[name] -= moved
        p[bare] = p.get(bare, 0.0) + moved
        physics.setdefault(bare, bare)
    return Shift(p, physics, delays)


def sample_step_s(fit: Fit) -> float:
    """The finest sampling step of the recordings that a delay was seen on."""
    return min((p.prepared.step_s for p in fit.problem.pieces if p.channel == "displacement"), default=0.0)


#: how the note of a shift begins: by it the statement knows that there is one
LAG_NOTE = "timing: the readings lag the command"


def timing_note(delay_s: float, step_s: float) -> str:
    """One line about a shift that is no physics."""
    return (
        f"{LAG_NOTE} by {1e3 * delay_s:.2g} ms, less than one sample "
        f"({1e3 * step_s:.3g} ms): when a row is read and when its command was given is the bench's convention, no "
        "physics; see hold in campaign.toml"
    )


def _log_delay(fit: Fit) -> tuple[float, float]:
    """Mean and sd of the logarithm of the delay in s."""
    i = [p.name for p in fit.problem.model.priors.free].index(_PARAMETER)
    return float(fit.q[i]), math.sqrt(max(float(fit.covariance[i, i]), 0.0))

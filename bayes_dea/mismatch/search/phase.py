"""A delay below one sample is when in a sample its reading falls: any part of it is as likely as any other.

The prior of a delay as physics is log-uniform: of what lies below one sample as much is between a hundredth and a
fiftieth of it as between a third and two thirds. Clocks that are not synchronised know no such scale, and are ahead as
often as behind. It matters where a lag or a damper far faster than the sampling does what a hundredth of a sample does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import log_ndtr, ndtr

from ...gauss_newton.refit import Fit
from ...priors import Prior

_PARAMETER = "T_d_s"


@dataclass(frozen=True)
class Below:
    """What a fit says of its delay being shorter than one sample.

    probability: of that, by the prior that was fitted. even: evidence by a prior that is even over one sample either
    way, over the evidence by the one that was fitted; None where that ends within one sample: those that are made for a
    campaign never do, so it is the user's own, which stays.
    """

    probability: float
    even: float | None


def sample_step_s(fit: Fit) -> float:
    """The finest sampling step of the recordings that a delay was seen on."""
    return min((p.prepared.step_s for p in fit.problem.pieces if p.channel == "displacement"), default=0.0)


def delay_of(fit: Fit) -> float | None:
    """The delay (s) at a fit, its median, negative where readings lead; None where it has none that is free."""
    found = _delay(fit)
    if found is None:
        return None
    prior, centre, _ = found
    return math.exp(centre) if prior.is_log else centre


def below_a_sample(fit: Fit) -> Below | None:
    """See `Below`; None of a fit without a delay, or without a sample that it could be below."""
    step, found = sample_step_s(fit), _delay(fit)
    if found is None or step <= 0.0:
        return None
    prior, centre, sd = found
    if not prior.is_log:
        sd = max(sd, 1e-9 * step)
        inside = float(ndtr((step - centre) / sd) - ndtr((-step - centre) / sd))
        wide = prior.family == "uniform" and (prior.a < -step or prior.b > step)
        return Below(inside, inside * (prior.b - prior.a) / (2.0 * step) if wide else None)
    sd = max(sd, 1e-9)
    inside = float(ndtr((math.log(step) - centre) / sd))
    if prior.family != "loguniform" or not prior.a < step < prior.b:
        return Below(inside, None)
    # mean of the delay itself, which is log-normal, over what of it is below a sample: no more than a sample
    log_mean = centre + 0.5 * sd**2 + float(log_ndtr((math.log(step) - centre) / sd - sd))
    mean = min(math.exp(min(log_mean, math.log(step))), step * inside)
    return Below(inside, mean * math.log(prior.b / prior.a) / (2.0 * step))


def _delay(fit: Fit) -> tuple[Prior, float, float] | None:
    """Prior of the delay in s, its mean and sd; of the logarithm where the prior is one of that."""
    free = fit.problem.model.priors.free
    i = next((i for i, p in enumerate(free) if p.name == _PARAMETER), None)
    if i is None:
        return None
    return free[i].prior, float(fit.q[i]), math.sqrt(max(float(fit.covariance[i, i]), 0.0))

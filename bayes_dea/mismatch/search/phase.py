"""A delay below one sample is when in a sample its reading falls: any part of it is as likely as any other.

The prior of a delay as physics is log-uniform: of what lies below one sample as much is between a hundredth and a
fiftieth of it as between a third and two thirds. Clocks that are not synchronised know no such scale. It matters where
a lag or a damper far faster than the sampling does what a hundredth of a sample does.
"""

from __future__ import annotations

import math

from scipy.special import ndtr

from ...gauss_newton.refit import Fit
from ...priors import Prior

_PARAMETER = "T_d_s"


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


def phase_odds(fit: Fit) -> float:
    """By how much a delay is likelier before the recordings are seen than its log-uniform prior has it.

    One above a sample; where the fit has none, or with another prior than that, it is one, too.
    """
    below, odds = _below(fit)
    return below * odds + 1.0 - below


def share_below(fit: Fit) -> float:
    """Probability that the delay of a fit, or what it leads by, is less than one sample."""
    below, odds = _below(fit)
    return min(1.0, below * odds / (below * odds + 1.0 - below))


def _below(fit: Fit) -> tuple[float, float]:
    """That probability by the prior that was fitted, and the odds of being there against it."""
    step, found = sample_step_s(fit), _delay(fit)
    if found is None or step <= 0.0:
        return 0.0, 1.0
    prior, centre, sd = found
    if not prior.is_log:  # of a lead, or even by itself
        return float(ndtr((step - abs(centre)) / max(sd, 1e-9 * step))), 1.0
    below = float(ndtr((math.log(step) - centre) / max(sd, 1e-9)))
    if prior.family != "loguniform" or not prior.a < step < prior.b:
        return below, 1.0
    # what the prior has between its least delay and one sample, spread evenly over the sample
    return below, min(math.exp(centre) / step, 1.0) * math.log(step / prior.a)


def _delay(fit: Fit) -> tuple[Prior, float, float] | None:
    """Prior of the delay in s, its mean and sd; of the logarithm where the prior is one of that."""
    free = fit.problem.model.priors.free
    i = next((i for i, p in enumerate(free) if p.name == _PARAMETER), None)
    if i is None:
        return None
    return free[i].prior, float(fit.q[i]), math.sqrt(max(float(fit.covariance[i, i]), 0.0))

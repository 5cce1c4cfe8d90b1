"""The posterior of one parameter, everything else fitted along with it.

The force of a press is known to a millionth of what it is. The ridge on which a stiffening, the modulus and the slow
modes trade with one another is as narrow, and bends: sensitivities worked out where two modes have met, say, mislead at
the next place, and what `ridge` draws along them comes out far too narrow. One parameter needs no draws: it is held at
a handful of values, the rest is fitted at each from where the last one ended, and a curve through these is the log
density.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ...gauss_newton.descent import Effort, Linearisation, bounds, descend
from ...gauss_newton.refit import Fit
from ..telling import Tell, silence

Array = NDArray[np.float64]

#: first step in sds, by what it changes from step to step, the nats that a step is to cost
_STEP, _GROWS, _COSTS = 0.5, 2.0, 1.0
#: nats below the maximum at which a side ends, steps to a side, steps of a fit
_DEEP, _STEPS, _DESCENT = 7.0, 14, 30
#: values at which the density is read
_READ = 801


def profiled(fit: Fit, own: int, tell: Tell = silence) -> tuple[Array, Array] | None:
    """Values (n, 1) of coordinate `own` and their weights (n,); None where nothing but the maximum has an answer.

    The rest is integrated out by the width that it has at each value (Laplace).
    """
    low, high = bounds(fit.problem)
    sd = float(np.sqrt(fit.covariance[own, own]))
    if not sd > 0.0:
        return None
    top = _held(fit, fit.q, own, float(fit.q[own]), low, high, fit.linearisation)
    if top is None:
        return None
    found = [top[:2]]
    for sign in (-1.0, 1.0):
        q, near, step = top[2], top[3], _STEP * sd
        depth, x = 0.0, float(fit.q[own])
        end = float(low[own] if sign < 0.0 else high[own])
        for k in range(_STEPS):
            tell(len(found), 2 * _STEPS, "")
            if not sign * (end - x) > 1e-9 * max(abs(end), 1.0):
                break
            there = x + sign * min(step, sign * (end - x))
            new = _held(fit, q, own, there, low, high, near)
            if new is None:
                break
            cost = new[1] - found[0][1] - depth
            if cost > 3.0 * _COSTS and k + 1 < _STEPS:
                step /= _GROWS
                continue
            found.append(new[:2])
            x, depth, q, near = there, depth + cost, new[2], new[3]
            if depth > _DEEP:
                break
            step *= _GROWS if cost < 0.3 * _COSTS else 1.0
    if len(found) < 3:
        return None
    at, value = np.array(sorted(found)).T
    read = np.linspace(at[0], at[-1], _READ)
    log_p = -PchipInterpolator(at, value)(read)
    weight = np.exp(log_p - log_p.max())
    return read[:, None], weight / weight.sum()


def _held(
    fit: Fit, q: Array, own: int, value: float, low: Array, high: Array, near: Linearisation
) -> tuple[float, float, Array, Linearisation] | None:
    """(value, minus log density, coordinates, sensitivities) with coordinate `own` held, the rest fitted from q."""
    a, b = low.copy(), high.copy()
    a[own] = b[own] = value
    rest = np.setdiff1d(np.arange(q.size), own)
    end = descend(fit.problem, np.clip(q, a, b), fit.noise, (a, b), Effort(_DESCENT, 0.01), known=near)
    if end is None:
        return None
    H = (end.gram[1:, 1:] + end.prior[2])[np.ix_(rest, rest)]
    sign, logdet = np.linalg.slogdet(H)
    if sign <= 0.0 or not np.isfinite(end.value):
        return None
    return value, end.value + 0.5 * float(logdet), end.q, Linearisation(end.q, end.clean, end.slopes)

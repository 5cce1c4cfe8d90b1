"""The chart that a fit steps in: what adds up in a network moves as itself, not as its logarithm.

Coordinates are logs, as priors are. But of two compliances that readings hardly tell apart (a mode quicker than the
sampling, beside what follows at once) only the sum is known, and along a sum that stays the logs are bent: a descent
would creep. In a linear network readings are linear in its compliances. So a step in logs is taken as a step of the
compliances (or moduli) themselves, but for what gains undo, which stays in logs, where that is straight; one that would
take most of a compliance away takes a share of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .problem import Problem

Array = NDArray[np.float64]
#: share of itself that is taken away as it stands; beyond, logs go on with the slope that they have there
_MOST = 0.5


def moved(problem: Problem, q: Array, step: Array, low: Array, high: Array) -> Array:
    """Coordinates (d,) after a step (d,) from q, between bounds."""
    out = q + step
    index, sign = problem.additive
    if index.size:
        gains = step[problem.dimension - problem.gain_sd.size :]
        undone = sign * (problem.undone_by @ gains)
        out[index] = q[index] - undone + _as_logs(step[index] + undone)
    return np.asarray(np.clip(out, low, high))


def _as_logs(share: Array) -> Array:
    """Changes of logs for changes by a share, straight in logs where most would be taken away."""
    beyond = np.log(1.0 - _MOST) + (share + _MOST) / (1.0 - _MOST)
    return np.where(share > -_MOST, np.log1p(np.maximum(share, -_MOST)), beyond)


def carried(
    problem: Problem,
    slopes: list[Array],
    before: list[Array],
    after: list[Array],
    q: Array,
    there: Array,
    weight: Array,
) -> list[Array]:
    """Sensitivities (n, nb) of each piece carried on from q to another place (d,), where predictions are `after`.

    Those by logs of what adds up grow with it. Then Broyden's update (10.1090/S0025-5718-1965-0198670-6): the least
    change with which they say what the predictions changed by, lengths measured by weight (d,). Coordinates that do not
    move a piece still do not.
    """
    n = len(slopes[0])
    step = (there - q)[:n]
    growth = problem.growth(step, np.arange(n))
    index, _ = problem.additive
    chord = step.copy()
    chord[index] = growth[index] - 1.0
    out = []
    for S, x, y in zip(slopes, before, after, strict=True):
        s = np.where(np.any(S != 0.0, axis=1), step, 0.0)
        along = weight[:n] * s
        length = float(along @ s)
        missed = y - x - chord @ S
        grown = growth[:, None] * S
        out.append(grown if length <= 0.0 else grown + np.outer(along / length, missed))
    return out

"""A curved law with Kelvin-Voigt elements behind it, once they have come to rest: one law, worked out where needed.

Its array of parameters is that of the curved law with two numbers behind it: which law it is, and the compliance of the
elements.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from .static import N_PARAMETERS, law_stress_tangent, law_work

#: stands for such a law where the numbers of a law stand
SERIES = -1
#: where in the parameters the number of the curved law stands, and the compliance (1/Pa)
WHICH, BEHIND = N_PARAMETERS, N_PARAMETERS + 1

_CLOSE = 1e-12
_MAX_ITERATIONS = 100


def series_parameters(law_id: int, law: NDArray[np.float64], compliance: float) -> NDArray[np.float64]:
    """Parameters (N_PARAMETERS + 2,) of a law with elements of so much compliance (1/Pa) behind it."""
    return np.concatenate([law, [float(law_id), compliance]])


@njit(cache=True, error_model="numpy", nogil=True)
def series_at_rest(p, e):  # type: ignore[no-untyped-def]
    """Stress (Pa) at rest at strain e, its tangent, and the work done up to there (J/m^3, as stress over strain).

    nan where the law has no stress for it.
    """
    which, C = int(p[WHICH]), p[BEHIND]
    low, high = min(e, 0.0), max(e, 0.0)  # the spring takes a part of the strain
    x = 0.5 * e
    s = t = math.nan
    for _ in range(_MAX_ITERATIONS):
        s, t = law_stress_tangent(which, p, x)
        off = x + C * s - e
        if off > 0.0 or (math.isnan(off) and e > 0.0):
            high = x
        else:
            low = x
        step = -off / (1.0 + C * t)
        if abs(step) < _CLOSE:
            break
        x += step
        if not low < x < high:
            x = 0.5 * (low + high)
    else:
        return math.nan, math.nan, math.nan
    return s, t / (1.0 + C * t), law_work(which, p, x) + 0.5 * C * s * s

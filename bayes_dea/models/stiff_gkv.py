"""GKV under a ramp of strain, exactly, with the law replaced by its tangent: for springs far stiffer than the branches.

With tau_i e_i' = s/k_i - e_i and s = s_0 + t (e - sum e_i - x_0) the spring couples the branches: their rates are
those of D + t u 1', D = diag(1/tau_i), u_i = 1/(tau_i k_i). Scaled with sqrt(u_i) this is symmetric, a diagonal
matrix and one of rank one (Golub, 10.1137/1015032, section 5), so the rates are real and positive, and under a ramp
the branches move along exponentials and straight lines. A path of the stress that starts with its true slope is
unstable there: its steps must stay below the shortest of the times, which may be microseconds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit

Array = NDArray[np.float64]

#: below this product of rate and time the series is exact to rounding
_SERIES = 1e-3


@njit(cache=True, error_model="numpy")
def coupled_rates(n: int, k: Array, rate: Array, tangent: float) -> tuple[Array, Array]:
    """Rates (n,) in 1/s and vectors (n, n) of the branches behind a spring of that tangent in Pa."""
    m = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            m[i, j] = tangent * math.sqrt(rate[i] / k[i]) * math.sqrt(rate[j] / k[j])
        m[i, i] += rate[i]
    if n == 1:
        return m[0], np.ones((1, 1))
    return np.linalg.eigh(m)


@njit(cache=True, error_model="numpy")
def ramp_step(
    n: int, k: Array, rate: Array, mu: Array, vectors: Array, tangent: float, h: float, speed: float, s: float,
    q: Array, change: Array,
) -> float:
    """Changes (n,) of the branches' strains q (n,) over a step h from the stress s; returns their sum.

    mu, vectors: of `coupled_rates` at `tangent`; speed: of the whole strain, 1/s.
    """
    total = 0.0
    for i in range(n):
        change[i] = 0.0
    for m in range(n):
        a, b = 0.0, 0.0
        for i in range(n):
            root = math.sqrt(rate[i] / k[i])
            a += vectors[i, m] * (s * rate[i] / k[i] - q[i] * rate[i]) / root
            b += vectors[i, m] * root * tangent * speed
        z = mu[m] * h
        if z < _SERIES:
            one = 1.0 - z * (0.5 - z * (1.0 / 6.0 - z / 24.0))
            two = 0.5 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z / 120.0))
        else:
            one = -math.expm1(-z) / z
            two = (1.0 - one) / z
        c = h * (a * one + b * h * two)
        for i in range(n):
            change[i] += math.sqrt(rate[i] / k[i]) * vectors[i, m] * c
    for i in range(n):
        total += change[i]
    return total

"""The strain of a curved spring under many stresses, compiled: by Newton's method, or from a table that it fills.

A recording has tens of thousands of stresses between the same two ends. Strains at a few hundred of them, even apart,
and the compliances there give the others by cubic polynomials; the table is made finer until the law itself finds
nothing wrong in the middle between two of them.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import njit
from .static import law_stress_tangent

_jit = njit(cache=True, error_model="numpy", nogil=True)

#: strain that Newton's method ends at, and that a table may be wrong by
_CLOSE, _WRONG = 1e-10, 1e-10
#: first and largest number of steps of a table, and stresses for each of the first from which one pays
_FIRST, _LARGEST, _PAYS = 128, 4096, 8


@_jit
def _strain(law_id, law, stress, near):
    """Strain at which a law holds a stress (Pa), sought from a strain near it; nan where it cannot carry it."""
    e = near
    for _ in range(60):
        s, t = law_stress_tangent(law_id, law, e)
        step = (stress - s) / t
        step = min(max(step, -0.1), 0.1)
        e = min(e + step, 0.5 * (e + 1.0))
        if abs(step) < _CLOSE:
            return e
    return math.nan


@_jit
def _fill(law_id, law, low, step, strain, compliance):
    """Strain (k,) and compliance (k,) 1/Pa at stresses `step` apart from `low` on; whether the law carries them all."""
    near = 0.0
    for i in range(strain.size):
        near = _strain(law_id, law, low + step * i, near)
        if math.isnan(near):
            return False
        strain[i] = near
        compliance[i] = 1.0 / law_stress_tangent(law_id, law, near)[1]
    return True


@_jit
def _between(strain, compliance, step, i, x):
    """Cubic polynomial between entries i and i + 1, a part x of the way."""
    rise = strain[i + 1] - strain[i]
    a, b = compliance[i] * step - rise, rise - compliance[i + 1] * step
    return strain[i] + x * (rise + (1.0 - x) * (a * (1.0 - x) + b * x))


@_jit
def _is_fine(law_id, law, strain, compliance, low, step):
    """Whether a table agrees with the law in the middle between its entries."""
    for i in range(strain.size - 1):
        e = _between(strain, compliance, step, i, 0.5)
        s, t = law_stress_tangent(law_id, law, e)
        if not abs(low + step * (i + 0.5) - s) < _WRONG * t:
            return False
    return True


@_jit
def add_spring(law_id, law, stress, out):
    """Add the strain of a law under a stress (m,) Pa to out (m,); nan from where the law cannot carry it."""
    low, high = 0.0, 0.0
    for s in stress:
        low, high = min(low, s), max(high, s)
    n = _FIRST
    while n <= _LARGEST and n * _PAYS <= stress.size and high > low and math.isfinite(high - low):
        strain, compliance, step = np.empty(n + 1), np.empty(n + 1), (high - low) / n
        if not _fill(law_id, law, low, step, strain, compliance):
            break
        if _is_fine(law_id, law, strain, compliance, low, step):
            per = 1.0 / step
            for i in range(stress.size):
                x = (stress[i] - low) * per
                at = min(int(x), n - 1)
                out[i] += _between(strain, compliance, step, at, x - at)
            return
        n *= 2
    e = 0.0
    for i in range(stress.size):
        e = _strain(law_id, law, stress[i], e)
        if math.isnan(e):
            out[i:] = np.nan
            return
        out[i] += e

"""Compiled integrators of the reference actuator: implicit midpoint rule on the strains of the dashpots.

A Maxwell branch of stiffness k and time constant tau carries the stress s = k (e - q), where q is the strain
of its dashpot and q' = (e - q) / tau. Unlike s, q is continuous when the stress jumps, so edges need no
special care and the rule keeps its second order. The rule is A-stable; its sub-steps are a fixed fraction of
the shortest time constant, which bounds the error whatever the sampling.
"""

from __future__ import annotations

import math

import numpy as np

from bayes_dea.compiled import njit

#: sub-step as a fraction of the shortest time constant: the relative error of the rule is its square / 12
SUBSTEP = 0.01


@njit(cache=True)
def strain_under_stress(time_s, stress_Pa, Y_Pa, k_Pa, tau_s, substep):  # type: ignore[no-untyped-def]
    """Strain (n,) under a stress (n,) in Pa that is held over the interval ending at its row.

    The material is at rest before the first row. `k_Pa` and `tau_s` have one entry a branch.
    """
    n = time_s.size
    branches = k_Pa.size
    q = np.zeros(branches)
    keep = np.zeros(branches)
    c = np.zeros(branches)
    total = Y_Pa + k_Pa.sum()
    limit = substep * tau_s.min() if branches > 0 else np.inf
    strain = np.empty(n)
    known_step, steps, slope = -1.0, 1, total
    for i in range(n):
        step = time_s[i] - time_s[i - 1] if i > 0 else 0.0
        if step > 0.0 and branches > 0:
            # stamps such as 0.001, 0.002 differ by rounding only: the coefficients stay valid
            if abs(step - known_step) > 1e-9 * known_step:
                known_step = step
                steps = max(1, math.ceil(step / limit))
                slope = total
                for j in range(branches):
                    c[j] = 0.5 * step / steps / tau_s[j]
                    keep[j] = 1.0 / (1.0 + c[j])
                    slope -= k_Pa[j] * keep[j] * c[j]
            for _ in range(steps):
                load = stress_Pa[i]
                for j in range(branches):
                    load += k_Pa[j] * keep[j] * q[j]
                middle = load / slope
                for j in range(branches):
                    q[j] = 2.0 * keep[j] * (q[j] + c[j] * middle) - q[j]
        load = stress_Pa[i]
        for j in range(branches):
            load += k_Pa[j] * q[j]
        strain[i] = load / total
    return strain


@njit(cache=True)
def stress_between_plates(time_s, imposed, Y_Pa, k_Pa, tau_s, substep):  # type: ignore[no-untyped-def]
    """Strain (n,) and stress (n,) in Pa of a specimen between plates that push but never pull.

    `imposed` (n,) is the strain the plates leave room for, linear between the rows (negative: a gap before
    contact). Where holding the specimen to it would take tension, it recovers freely at zero stress.
    """
    n = time_s.size
    branches = k_Pa.size
    q = np.zeros(branches)
    total = Y_Pa + k_Pa.sum()
    limit = substep * tau_s.min() if branches > 0 else np.inf
    strain = np.zeros(n)
    stress = np.zeros(n)
    e = 0.0
    if n > 0 and imposed[0] > 0.0:
        e = imposed[0]
        strain[0] = e
        stress[0] = total * e
    for i in range(1, n):
        step = time_s[i] - time_s[i - 1]
        steps = max(1, math.ceil(step / limit)) if branches > 0 else 1
        h = step / steps
        sigma = 0.0
        for s in range(1, steps + 1):
            target = imposed[i - 1] + (imposed[i] - imposed[i - 1]) * s / steps
            slope = total
            memory = 0.0
            for j in range(branches):
                c = 0.5 * h / tau_s[j]
                keep = 1.0 / (1.0 + c)
                slope -= k_Pa[j] * keep * c
                memory += k_Pa[j] * ((2.0 * keep - 1.0) * q[j] + keep * c * e)
            new = target
            sigma = slope * target - memory
            if sigma < 0.0:
                new = memory / slope
                sigma = 0.0
            for j in range(branches):
                c = 0.5 * h / tau_s[j]
                q[j] = 2.0 / (1.0 + c) * (q[j] + c * 0.5 * (e + new)) - q[j]
            e = new
        strain[i] = e
        stress[i] = sigma
    return strain, stress

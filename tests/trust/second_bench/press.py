"""A stack between the plates of a press: it is pushed, never pulled."""

import numpy as np
from numba import njit

from .solid import Memory, branch_step, remember, solid_stress

_ITERATIONS = 60
_STRAIN_TOLERANCE = 1e-13


@njit(cache=True)
def pressed(plate_strain, row_s, steps, chain):
    """True stress (n,) Pa, never below zero, and true strain (n,) of a stack under a plate.

    plate_strain (n,): strain at which the stack would touch the plate at each row; rows are row_s apart, each in
    `steps` steps. Where the stack would have to pull, it follows its own balance at no force.
    """
    laws, branch_Pa, branch_s, friction = chain
    n = plate_strain.size
    stress_out = np.zeros(n)
    strain_out = np.zeros(n)
    h = row_s / steps
    step = branch_step(branch_Pa, branch_s, h)
    memory = Memory(np.zeros(branch_Pa.size), np.zeros(friction.yield_strain.size))
    d1 = laws.damper_Pa_s
    d2 = laws.quadratic_damper_Pa_s2
    e = 0.0
    most_work = 0.0
    for row in range(1, n):
        for sub in range(steps):
            e1 = plate_strain[row - 1] + (plate_strain[row] - plate_strain[row - 1]) * (sub + 1) / steps
            stress, _ = solid_stress(e1, e, laws, 1.0, step, friction, memory, most_work)
            speed = (e1 - e) / h
            stress += d1 * speed + d2 * abs(speed) * speed
            if stress < 0.0:
                stress = 0.0
                e1 = e
                for _iteration in range(_ITERATIONS):
                    rest, slope = solid_stress(e1, e, laws, 1.0, step, friction, memory, most_work)
                    speed = (e1 - e) / h
                    rest += d1 * speed + d2 * abs(speed) * speed
                    change = rest / (slope + d1 / h + 2.0 * d2 * abs(speed) / h)
                    e1 -= change
                    if abs(change) < _STRAIN_TOLERANCE:
                        break
            most_work = remember(e1, e, laws, 1.0, step, friction, memory, most_work)
            e = e1
        stress_out[row] = stress
        strain_out[row] = e
    return stress_out, strain_out

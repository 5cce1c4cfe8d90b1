"""The stress of the material: spring, Maxwell branches, friction, and what makes the spring curved."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from .recordings import Array

_ERF_SLOPE = 1.1283791670955126  # 2 / sqrt(pi)


class Step(NamedTuple):
    """How Maxwell branches (b,) go through a step: what is kept of their stress, and their mean stiffness in Pa."""

    kept: Array
    stiffness_Pa: Array


class Memory(NamedTuple):
    """What the material remembers, changed in place: stress (b,) Pa of branches, strain (m,) of sliders."""

    branch_Pa: Array
    slider: Array


@njit(cache=True)
def branch_step(branch_Pa, branch_s, step_s):
    """Exact for a strain that changes evenly in the step; without duration the branches are springs."""
    kept = np.empty(branch_Pa.size)
    stiffness = np.empty(branch_Pa.size)
    for i in range(branch_Pa.size):
        if step_s > 0.0:
            kept[i] = math.exp(-step_s / branch_s[i])
            stiffness[i] = -branch_Pa[i] * math.expm1(-step_s / branch_s[i]) * branch_s[i] / step_s
        else:
            kept[i] = 1.0
            stiffness[i] = branch_Pa[i]
    return Step(kept, stiffness)


@njit(cache=True)
def solid_stress(e, e0, laws, scale, step, friction, memory, most_work):
    """True stress [Pa] at the end of a step from strain e0 to e, and its derivative; no damper, no mass.

    scale: factor on the spring. most_work: largest elastic work [Pa] so far, which Mullins' softening counts by.
    """
    Y = laws.Y_Pa * scale
    if laws.mullins_share > 0.0:
        work = 0.5 * Y * e * e
        most = max(most_work, work)
        width = laws.mullins_Pa + laws.mullins_slope * most
        below = (most - work) / width
        erf = math.erf(below)
        stress = Y * e * (1.0 - laws.mullins_share * erf)
        slope = Y * (1.0 - laws.mullins_share * erf)
        if most > work:
            slope += Y * e * laws.mullins_share * _ERF_SLOPE * math.exp(-below * below) * Y * e / width
    else:
        stress = Y * e
        slope = Y
    if laws.stiffening != 0.0:
        stress += laws.stiffening * laws.Y_Pa * e * e * e
        slope += 3.0 * laws.stiffening * laws.Y_Pa * e * e
    if laws.softening_Pa != 0.0:
        r = 1.0 + abs(e) / laws.softening_strain
        stress += laws.softening_Pa * e / r
        slope += laws.softening_Pa / (r * r)
    de = e - e0
    for i in range(memory.branch_Pa.size):
        stress += memory.branch_Pa[i] * step.kept[i] + step.stiffness_Pa[i] * de
        slope += step.stiffness_Pa[i]
    if memory.slider.size > 0:
        total = 0.0
        sticking = 0
        for j in range(memory.slider.size):
            x = memory.slider[j] + de
            if x > friction.yield_strain[j]:
                x = friction.yield_strain[j]
            elif x < -friction.yield_strain[j]:
                x = -friction.yield_strain[j]
            else:
                sticking += 1
            total += x
        stress += friction.element_Pa * total
        slope += friction.element_Pa * sticking
    return stress, slope


@njit(cache=True)
def remember(e, e0, laws, scale, step, friction, memory, most_work):
    """Take the end of a step into the memory; returns the largest elastic work [Pa] so far."""
    de = e - e0
    for i in range(memory.branch_Pa.size):
        memory.branch_Pa[i] = memory.branch_Pa[i] * step.kept[i] + step.stiffness_Pa[i] * de
    for j in range(memory.slider.size):
        memory.slider[j] = min(friction.yield_strain[j], max(-friction.yield_strain[j], memory.slider[j] + de))
    if laws.mullins_share > 0.0:
        most_work = max(most_work, 0.5 * laws.Y_Pa * scale * e * e)
    return most_work

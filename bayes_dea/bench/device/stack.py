"""The reference actuator carried on from sample to sample: state in, state out.

Same equations and rule as `bench.integrate` (implicit midpoint on the strains of the dashpots), but for a command that
is not known beforehand.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.integrate import SUBSTEP
from bayes_dea.bench.rig import Geometry, Material, Rig
from bayes_dea.compiled import njit

Array = NDArray[np.float64]


@njit(cache=True)
def _advance(stress, dt, factor, Y, k, tau, q, substep, strain):  # type: ignore[no-untyped-def]
    """Strains (n,) under held stresses (n,) Pa, `dt` s each; q (branches,) is carried. factor: on all stiffness."""
    branches = k.size
    c = np.empty(branches)
    keep = np.empty(branches)
    total = Y + k.sum()
    steps = max(1, math.ceil(dt / (substep * tau.min()))) if branches > 0 else 1
    slope = total
    for j in range(branches):
        c[j] = 0.5 * dt / steps / tau[j]
        keep[j] = 1.0 / (1.0 + c[j])
        slope -= k[j] * keep[j] * c[j]
    for i in range(stress.size):
        push = stress[i] / factor
        for _ in range(steps):
            load = push
            for j in range(branches):
                load += k[j] * keep[j] * q[j]
            middle = load / slope
            for j in range(branches):
                q[j] = 2.0 * keep[j] * (q[j] + c[j] * middle) - q[j]
        load = push
        for j in range(branches):
            load += k[j] * q[j]
        strain[i] = load / total


class Stack:
    """One actuator that is never reset. `factor`: what multiplies all of its stiffness from now on."""

    def __init__(self, geometry: Geometry, material: Material) -> None:
        self._rig = Rig(geometry, material)
        self._k, self._tau = np.array(material.k_Pa), np.array(material.tau_s)
        self._q = np.zeros(self._k.size)
        self.factor = 1.0

    def advance(self, voltage_V: Array, dt_s: float) -> Array:
        """True displacements (n,) in m after each of n intervals of `dt_s` in which voltages (n,) were in force."""
        g = self._rig.geometry
        strain = np.empty(voltage_V.size)
        _advance(self._rig.maxwell_stress(voltage_V), dt_s, self.factor, self._rig.material.Y_Pa, self._k, self._tau,
                 self._q, SUBSTEP, strain)
        return strain * (g.layers * g.layer_thickness_m)

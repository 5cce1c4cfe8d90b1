"""A static law joined with a network between plates that impose its strain, compiled: see `mechanics`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from .static import law_stress_tangent
from .stiff_gkv import coupled_rates, ramp_step
from .stress_kernel import (
    END,
    GKM,
    GKV,
    LOSS,
    MAX_TRIES,
    MEAN,
    PATH_TOLERANCE,
    balanced,
    branch_tables,
    creep_gkm,
    creep_gm,
    jump,
    shorter,
)

Array = NDArray[np.float64]

#: a spring this many times faster than a step makes the explicit slope of the path unstable
_STIFF = 4.0

_jit = njit(cache=True, error_model="numpy")
_inline = njit(cache=True, error_model="numpy", inline="always")


@_jit
def _free_flight(law_id: int, p: Array, network: int, n: int, k: Array, rate: Array, K: float, d0: float,
                 h: float, q: Array, regular: Array, work: Array, joint: Array, phi: Array, e: float,
                 ) -> float:
    """The material left alone at zero stress for h; returns its strain, q is moved on.

    Rare, so nothing is reused: the tables of h are built here, in `regular`.
    """
    if h <= 0.0:
        return e
    branch_tables(h, n, k, rate, regular)
    if network == GKV:
        e = 0.0
        for i in range(n):
            q[i] -= q[i] * regular[LOSS, i]
            e += q[i]
        return e
    s_c, t_c = law_stress_tangent(law_id, p, e)
    e_c = e
    if network == GKM and d0 > 0.0:
        e, e_c, s_c, t_c = creep_gkm(law_id, p, n, k, rate, K, d0, h, q, 0.0, regular, work, joint, phi,
                                      e, e_c, s_c, t_c)
    else:
        e, e_c, s_c, t_c = jump(law_id, p, n, k, K, q, 0.0, e, e_c, s_c, t_c)
        e, e_c, s_c, t_c = creep_gm(law_id, p, n, k, rate, K, h, q, 0.0, regular, work, e, e_c, s_c, t_c)
    return e


@_jit
def strain_step_gkv(law_id: int, p: Array, n: int, k: Array, rate: Array, h: float, start: float,
                     end: float, q: Array, new: Array, regular: Array, work: Array) -> float:
    """GKV: the strain goes linearly from start to end in h; fills `new` with the e_i, returns the stress.

    The stress along the step is quadratic with its known slope at the start.
    """
    if n == 0:
        s, t = law_stress_tangent(law_id, p, end)
        return s
    spring = start
    for i in range(n):
        new[i] = q[i]
        spring -= q[i]
    speed = (end - start) / h
    s, t = law_stress_tangent(law_id, p, spring)
    rest, step, tries = h, h, 0
    coupling = 0.0
    for i in range(n):
        coupling += rate[i] / k[i]
    while rest > 0.0:
        if t * coupling * step > _STIFF:
            return _strain_steps_stiff(law_id, p, n, k, rate, rest, end - speed * rest, speed, new)
        table = regular
        if step != h:
            table = work
            branch_tables(step, n, k, rate, table)
        flow, push, mean, last = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            flow += (s / k[i] - new[i]) * rate[i]
            push += (s / k[i] - new[i]) * table[LOSS, i]
            mean += (1.0 - table[MEAN, i]) / k[i]
            last += (1.0 - table[END, i]) / k[i]
        slope = t * (speed - flow) * step
        # y + sum of the changes of e_i = speed step, with y the change of the spring
        P = 1.0 / last
        r = (push + slope * (mean - last) - speed * step) * P
        y, at, s_at, t_at = balanced(law_id, p, spring, s, t, P, r)
        if math.isnan(at):
            s_new, t_new = law_stress_tangent(law_id, p, spring + y)
        else:
            s_new = s_at + t_at * (spring + y - at)
            t_new = t_at
        rise = s_new - s
        error = abs((rise - slope) * (mean - last)) / (1.0 + t * last)
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < MAX_TRIES:
            step = shorter(step, error)
            continue
        if tries >= MAX_TRIES:
            rise = math.nan
            step = rest
        for i in range(n):
            new[i] += ((s / k[i] - new[i]) * table[LOSS, i]
                       + (slope * (1.0 - table[MEAN, i]) + (rise - slope) * (1.0 - table[END, i])) / k[i])
        spring += y
        s, t = s_new, t_new
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, shorter(step, error)))
    # the spring takes what the branches leave, so rounding cannot pile up
    spring = end
    for i in range(n):
        spring -= new[i]
    s, t = law_stress_tangent(law_id, p, spring)
    return s


@_jit
def _lost(new: Array) -> float:
    """No stress, and no strains (n,) that could go on."""
    new[:] = math.nan
    return math.nan


@_jit
def _strain_steps_stiff(law_id: int, p: Array, n: int, k: Array, rate: Array, rest: float, start: float,
                        speed: float, new: Array) -> float:
    """GKV behind a stiff spring: as `strain_step_gkv` for what is left of a step, along the tangent of the law.

    Along it the branches are exact; the law's distance from it at the end is what a step is cut by. Where there is no
    answer `new` is lost, too: what follows would be as long in finding none.
    """
    change = np.empty(n)
    strain, step, tries = start, rest, 0
    end = start + speed * rest
    spring = start
    for i in range(n):
        spring -= new[i]
    s, t = law_stress_tangent(law_id, p, spring)
    if not math.isfinite(t):  # a law that locks
        return _lost(new)
    mu, vectors = coupled_rates(n, k, rate, t)
    while rest > 0.0:
        moved = speed * step - ramp_step(n, k, rate, mu, vectors, t, step, speed, s, new, change)
        s_new, t_new = law_stress_tangent(law_id, p, spring + moved)
        # the law's bend moves the branches by what a stress that grows with the square of time moves them by
        last = 0.0
        for i in range(n):
            x = step * rate[i]
            last += min(x / 3.0, 1.0) / k[i]
        error = abs(s_new - s - t * moved) * last / (1.0 + t * last)
        tries += 1
        # (a nan is no reason to go on)
        if not error <= PATH_TOLERANCE and step > 1e-7 * rest and tries < MAX_TRIES:
            step = shorter(step, error) if math.isfinite(error) else 0.1 * step
            continue
        if tries >= MAX_TRIES:
            return _lost(new)
        for i in range(n):
            new[i] += change[i]
        strain += speed * step
        spring = end if step >= rest else strain
        for i in range(n):
            spring -= new[i]
        s, t_new = law_stress_tangent(law_id, p, spring)
        if step >= rest:
            break
        if not math.isfinite(t_new):
            return _lost(new)
        if t_new != t:
            t = t_new
            mu, vectors = coupled_rates(n, k, rate, t)
        rest -= step
        step = min(rest, max(step, shorter(step, error)))
    return s


@_inline
def _strain_step(law_id: int, p: Array, network: int, n: int, k: Array, rate: Array, d0: float, h: float,
                 start: float, end: float, q: Array, new: Array, table: Array, work: Array) -> float:
    """The strain goes linearly from start to end in h: fills `new` with the branches, returns the stress."""
    if network == GKV:
        return strain_step_gkv(law_id, p, n, k, rate, h, start, end, q, new, table, work)
    s, _ = law_stress_tangent(law_id, p, end)
    change = end - start
    if network == GKM:
        s += d0 * change / h
    for i in range(n):
        new[i] = q[i] * (1.0 - table[LOSS, i]) + k[i] * change * table[MEAN, i]
        s += new[i]
    return s


@_jit
def strain_driven_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: float, h: Array,
                         e: Array, contact: int, state: Array, stress: Array, e_material: Array) -> None:
    """See `strain_driven`; `state` (n + 1) is read and overwritten, stress and e_material (K + 1) filled."""
    n = k.size
    K = 0.0
    for i in range(n):
        K += k[i]
    q = state[1:].copy()
    new = np.empty(n)
    rate = 1.0 / tau
    table, regular, work = np.empty((3, n + 1)), np.empty((3, n + 1)), np.empty((3, n + 1))
    joint, phi = np.zeros((4, n + 2)), np.empty(9)
    last = -1.0

    # the first knot: a jump from the state's strain to the imposed one
    s, _ = law_stress_tangent(law_id, p, e[0] if network != GKV else e[0] - np.sum(q))
    if network != GKV:
        for i in range(n):
            new[i] = q[i] + k[i] * (e[0] - state[0])
            s += new[i]
    touching = not (contact * s < 0.0)
    material = e[0]
    if touching:
        if network != GKV:
            q[:] = new
    else:
        s = 0.0
        material = state[0]
        if network == GKV:
            material = np.sum(q)
        elif not (network == GKM and d0 > 0.0):
            s_c, t_c = law_stress_tangent(law_id, p, material)
            material, _, _, _ = jump(law_id, p, n, k, K, q, 0.0, material, material, s_c, t_c)
    stress[0], e_material[0] = s, material

    for b in range(h.size):
        start, end = e[b], e[b + 1]
        left = h[b]
        met = False
        if not touching:
            new[:] = q
            flown = _free_flight(law_id, p, network, n, k, rate, K, d0, left, new, regular, work, joint, phi,
                                 material)
            if contact * (end - flown) <= 0.0:
                q[:] = new
                material = flown
                stress[b + 1], e_material[b + 1] = 0.0, material
                continue
            # they meet within the step, where the straight paths cross
            gap = contact * (material - start)
            part = gap / (gap + contact * (end - flown)) if gap > 0.0 else 0.0
            flown = _free_flight(law_id, p, network, n, k, rate, K, d0, part * left, q, regular, work, joint,
                                 phi, material)
            start += part * (end - start)
            if network != GKV:
                for i in range(n):
                    q[i] += k[i] * (start - flown)
            left *= 1.0 - part
            touching = True
            met = True
            left = max(left, 1e-12 * h[b])
        if left != last:
            last = left
            branch_tables(left, n, k, rate, table)
        s = _strain_step(law_id, p, network, n, k, rate, d0, left, start, end, q, new, table, work)
        if met and network == GKM:
            # over the interval in which plate and material meet the damper feels the material's mean rate, since the
            # plates were where it ends at rest: of those that come from afar it feels the speed
            since = h[b]
            if contact * e[b] < 0.0 < contact * e[b + 1]:
                since *= e[b + 1] / (e[b + 1] - e[b])
            s += d0 * ((end - material) / since - (end - start) / left)
        if contact * s < 0.0:
            # contact is lost within the step, where the straight line between the end stresses is zero
            before, _ = law_stress_tangent(law_id, p, start if network != GKV else start - np.sum(q))
            if network != GKV:
                before += np.sum(q)
            if network == GKM:
                before += d0 * (end - start) / left
            part = before / (before - s) if contact * before > 0.0 else 0.0
            middle = start + part * (end - start)
            if part > 0.0:
                branch_tables(part * left, n, k, rate, regular)
                _strain_step(law_id, p, network, n, k, rate, d0, part * left, start, middle, q, new,
                             regular, work)
                q[:] = new
            material = _free_flight(law_id, p, network, n, k, rate, K, d0, (1.0 - part) * left, q, regular,
                                    work, joint, phi, middle)
            touching = False
            s = 0.0
        else:
            q[:] = new
            material = end
        stress[b + 1], e_material[b + 1] = s, material
    state[0] = material
    state[1:] = q

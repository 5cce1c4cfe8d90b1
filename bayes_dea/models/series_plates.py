"""The compiled material between plates where a curved law has Kelvin-Voigt elements in series and more acts beside.

While the plates touch, the strain is straight from knot to knot: the network follows as in `strain_kernel`, what is
beside it as in `plate_kernel`. Where the plates would have to pull, the material goes its own way at zero stress, in
steps along each of which its strain is straight; a step is halved until its halves say the same.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import njit
from .material_kernel import P_Y, X_E
from .plate_kernel import P_D0, held, rest, take
from .static import law_stress_tangent
from .strain_kernel import strain_step_gkv
from .stress_kernel import branch_tables

_jit = njit(cache=True, error_model="numpy", nogil=True)

_SAME = 5e-8  # strain by which a step and its halves may differ
_BENDS = 0.1  # part of a change of what it moves in a step that a straight step misses at most
_CLOSE = 1e-11  # strain that a balance of forces is worked out to
_SHORTEST = 1e-6  # part of a step from row to row that is not halved any more
_MOST_STEPS, _MAX_ITERATIONS = 20_000, 100


@_jit
def _stress(w, law_p, which, k, rate, q, new, h, start, end, table, work, trial):
    """Stress at the end of a straight strain from start to end in h; `new` (n,) and `trial` get what goes along.

    h = 0: a jump, which the elements do not feel.
    """
    if h > 0.0:
        s = strain_step_gkv(which, law_p, k.size, k, rate, h, start, end, q, new, table, work)
    else:
        new[:] = q
        s, _ = law_stress_tangent(which, law_p, end - q.sum())
    return s + held(w, law_p, h, start, end, trial) - w[P_Y] * end


@_jit
def _freely(w, law_p, which, k, rate, q, new, h, guess, table, work, trial):
    """Change of the strain in h at zero stress, straight; `new` and `trial` as in `_stress`. nan without a balance."""
    e = w[X_E]
    branch_tables(h, k.size, k, rate, table)
    last, D = 0.0, guess
    f_last = _stress(w, law_p, which, k, rate, q, new, h, e, e, table, work, trial)
    if f_last == 0.0:
        return 0.0
    low, high = (-math.inf, 0.0) if f_last > 0.0 else (0.0, math.inf)
    if not low < D < high:
        D = -math.copysign(max(abs(guess), 1e-6), f_last)
    for _ in range(_MAX_ITERATIONS):
        if not low < D < high:
            D = 0.5 * (low + high) if high - low < math.inf else 4.0 * last
        f = _stress(w, law_p, which, k, rate, q, new, h, e, e + D, table, work, trial)
        if math.isnan(f):
            return math.nan
        if f > 0.0:
            high = min(high, D)
        else:
            low = max(low, D)
        step = -f * (D - last) / (f - f_last) if f != f_last else 0.0
        last, f_last = D, f
        if abs(step) < _CLOSE or high - low < _CLOSE:
            return D
        D += step
    return math.nan


@_jit
def fly(w, law_p, which, k, rate, q, h, speed, on, table, work, trial):
    """Let the material go its own way for h (s): from the state in w and q, which it leaves there; returns its speed.

    speed: about what it moves at; on: whether it went its own way at that speed before. The strain is nan where there
    is no balance of forces.
    """
    first, second = np.empty(k.size), np.empty(k.size)
    before = w.copy()
    done, step = 0.0, h
    for _ in range(_MOST_STEPS):
        whole = _freely(w, law_p, which, k, rate, q, first, step, speed * step, table, work, trial)
        if on and _BENDS * abs(whole - speed * step) < _SAME:
            # it goes on as it did
            take(w, trial)
            q[:] = first
            done += step
            speed = whole / step
            if done >= h * (1.0 - 1e-12):
                return speed
            step = min(2.0 * step, h - done)
            continue
        half = _freely(w, law_p, which, k, rate, q, first, 0.5 * step, 0.5 * whole, table, work, trial)
        before[:] = w
        take(w, trial)
        other = _freely(w, law_p, which, k, rate, first, second, 0.5 * step, half, table, work, trial)
        off = abs(half + other - whole)
        if math.isnan(off):
            w[X_E] = math.nan
            return math.nan
        if off > _SAME and step > _SHORTEST * h:
            w[:] = before
            step *= 0.5
            continue
        take(w, trial)
        q[:] = second
        done += step
        speed, on = 2.0 * other / step, True
        if done >= h * (1.0 - 1e-12):
            return speed
        step = min(step if 4.0 * off > _SAME else 2.0 * step, h - done)
    w[X_E] = math.nan
    return math.nan


@_jit
def drive_series(w, law_p, which, k, tau, h, e, contact, stress, material):
    """Stress and strain of the material (K + 1,) at knots of an imposed strain e (K + 1,), h (K,) s apart; rested.

    which: number of the curved law; k (n,) Pa and tau (n,) s: elements; w: numbers of what is beside the network, as
    `plate_kernel` has them, overwritten. contact: +1 plates that do not pull, -1 a film that does not push, 0 bonded.
    """
    n = k.size
    rate, q, new = 1.0 / tau, np.zeros(n), np.zeros(n)
    table, work = np.empty((3, n + 1)), np.empty((3, n + 1))
    rest(w, law_p)
    trial, kept, kept_q = w.copy(), w.copy(), q.copy()
    s = _stress(w, law_p, which, k, rate, q, new, 0.0, 0.0, e[0], table, work, trial)
    touching = not contact * s < 0.0
    if touching:
        take(w, trial)
    stress[0], material[0] = (s, e[0]) if touching else (0.0, 0.0)
    speed = 0.0
    goes_on, begins = np.bool_(True), np.bool_(False)  # plain ones would each have a copy of `fly` compiled
    for b in range(h.size):
        start, end, left = e[b], e[b + 1], h[b]
        before, met = material[b], False
        if not touching:
            kept[:], kept_q[:] = w, q
            speed = fly(w, law_p, which, k, rate, q, left, speed, goes_on, table, work, trial)
            flown = w[X_E]
            if not contact * (end - flown) > 0.0:
                stress[b + 1], material[b + 1] = 0.0, flown
                continue
            # they meet within the step, where the straight lines cross
            gap = contact * (before - start)
            part = gap / (gap + contact * (end - flown)) if gap > 0.0 else 0.0
            w[:], q[:] = kept, kept_q
            if part > 0.0:
                speed = fly(w, law_p, which, k, rate, q, part * left, speed, goes_on, table, work, trial)
            start += part * (end - start)
            left = max((1.0 - part) * left, 1e-12 * h[b])
            _stress(w, law_p, which, k, rate, q, new, 0.0, w[X_E], start, table, work, trial)
            take(w, trial)
            touching, met = True, True
        branch_tables(left, n, k, rate, table)
        s = _stress(w, law_p, which, k, rate, q, new, left, start, end, table, work, trial)
        if met:
            # over the step in which they meet the damper feels the material's mean rate
            s += w[P_D0] * ((end - before) / h[b] - (end - start) / left)
        if not contact * s < 0.0:
            take(w, trial)
            q[:] = new
            stress[b + 1], material[b + 1] = s, end
            continue
        # contact is lost within the step, where the straight line between the end stresses is zero
        at_start = (_stress(w, law_p, which, k, rate, q, new, 0.0, start, start, table, work, trial)
                    + w[P_D0] * (end - start) / left)
        part = at_start / (at_start - s) if contact * at_start > 0.0 else 0.0
        if part > 0.0:
            branch_tables(part * left, n, k, rate, table)
            _stress(w, law_p, which, k, rate, q, new, part * left, start, start + part * (end - start), table, work,
                    trial)
            take(w, trial)
            q[:] = new
        speed = fly(w, law_p, which, k, rate, q, (1.0 - part) * left, (end - start) / left, begins, table, work, trial)
        touching = False
        stress[b + 1], material[b + 1] = 0.0, w[X_E]

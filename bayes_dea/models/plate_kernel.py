"""The compiled material between plates, with everything that a model may leave out: imposed strain to stress.

While the plates touch, the strain is straight from knot to knot and branches follow exactly. Plates do not pull (a
film does not push): where they would have to, the material goes its own way at zero stress, by `plant_kernel.run`
without voltage, until the plates meet it again. A loss or a gain of contact is placed where straight lines cross.

Numba keeps compiled code by the date of this file alone: after an edit of `plant_kernel.py` or `static.py` touch it.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .plant_kernel import (
    A_A,
    A_G,
    A_Q,
    P_BETA,
    P_D0,
    P_DE,
    P_EC,
    P_LAW,
    P_MB,
    P_MM,
    P_N,
    P_SHARE,
    P_SY,
    P_Y,
    X_E,
    X_F,
    X_H,
    X_Q,
    X_S,
    X_T,
    X_TF,
    X_WM,
    _commit_friction,
    _elastic,
    _fill_table,
    _friction,
    prepare,
    run,
)

_jit = njit(cache=True, error_model="numpy", nogil=True)

#: rows on its own after which a material is followed in steps of one row more, and the longest of these steps
_SLOWS, _LONGEST = 8, 16


@_jit
def _held(w, law_p, h, start, end, trial):
    """Stress at the end of a straight strain from start to end in h; `trial` (SIZE,) gets the state that goes along.

    h = 0: a jump, which the damper does not feel. Nothing has changed until `_take`.
    """
    n = int(w[P_N])
    change = end - start
    if h != w[X_H]:
        _fill_table(w, h)
    Q = 0.0
    for j in range(n):
        new = w[A_Q + j] * w[A_A + j] + w[A_G + j] * change
        Q += new
        trial[A_Q + j] = new
    s, t, W = _elastic(int(w[P_LAW]), law_p, w[P_Y], w[P_BETA], w[P_DE], w[P_EC], w[P_SHARE], w[P_MM], w[P_MB],
                       w[X_WM], end)
    f, tf = 0.0, 0.0
    if w[P_SY] > 0.0:
        f, tf = _friction(w, end)
    trial[X_E], trial[X_S], trial[X_T], trial[X_F], trial[X_TF], trial[X_Q], trial[X_WM] = end, s, t, f, tf, Q, W
    return s + f + Q + (w[P_D0] * change / h if h > 0.0 else 0.0)


@_jit
def _take(w, trial):
    """Make the state that was tried last the present one."""
    for j in range(int(w[P_N])):
        w[A_Q + j] = trial[A_Q + j]
    if w[P_SY] > 0.0:
        _commit_friction(w, trial[X_E], trial[X_F])
    w[X_E], w[X_S], w[X_T] = trial[X_E], trial[X_S], trial[X_T]
    w[X_F], w[X_TF], w[X_Q] = trial[X_F], trial[X_TF], trial[X_Q]
    w[X_WM] = max(w[X_WM], trial[X_WM])


@_jit
def _flown(w, law_p, h, b, rows, e, contact, before, one, none, out):
    """Whether the material (strain `before`) stays off the plates for `rows` rows after row b; they are flown then."""
    highest, one[0] = -np.inf, 0.0
    for i in range(b, b + rows):
        highest = max(highest, contact * e[i + 1])
        one[0] += h[i]
    if highest > contact * before:
        return False
    run(w, law_p, one, none, none, out)
    return not highest > contact * w[X_E]


@_jit
def drive_position(w, law_p, h, e, contact, stress, material):
    """Stress and strain of the material (K + 1,) at knots of an imposed strain e (K + 1,), h (K,) s apart; rested.

    contact: +1 plates that do not pull, -1 a film that does not push, 0 bonded. At the first knot the strain jumps
    to e[0]. w (SIZE,) holds the numbers of the plant without circuit and mass; its state is overwritten.
    """
    prepare(w, law_p)
    one, none, out = np.empty(1), np.zeros(1), np.empty(1)
    kept, trial = w.copy(), w.copy()
    s = _held(w, law_p, 0.0, 0.0, e[0], trial)
    touching = not contact * s < 0.0
    if touching:
        _take(w, trial)
    stress[0], material[0] = (s, e[0]) if touching else (0.0, 0.0)
    b, alone = 0, 0
    while b < h.size:
        start, end, left = e[b], e[b + 1], h[b]
        met = False
        before = material[b]
        if not touching:
            kept[:] = w
            # what goes its own way slows down, and is followed in longer steps while the plates are far
            rows = min(1 + alone // _SLOWS, _LONGEST, h.size - b)
            if rows > 1:
                if _flown(w, law_p, h, b, rows, e, contact, before, one, none, out):
                    after = w[X_E]
                    for i in range(rows):
                        stress[b + 1 + i], material[b + 1 + i] = 0.0, before + (after - before) * (i + 1) / rows
                    b += rows
                    alone += rows
                    continue
                w[:] = kept
            one[0] = left
            run(w, law_p, one, none, none, out)
            flown = w[X_E]
            if not contact * (end - flown) > 0.0:
                stress[b + 1], material[b + 1] = 0.0, flown
                b += 1
                alone += 1
                continue
            # they meet within the step, where the straight lines cross
            gap = contact * (before - start)
            part = gap / (gap + contact * (end - flown)) if gap > 0.0 else 0.0
            w[:] = kept
            if part > 0.0:
                one[0] = part * left
                run(w, law_p, one, none, none, out)
            start += part * (end - start)
            left = max((1.0 - part) * left, 1e-12 * h[b])
            _held(w, law_p, 0.0, w[X_E], start, trial)
            _take(w, trial)
            touching, met = True, True
        s = _held(w, law_p, left, start, end, trial)
        if met:
            # over the step in which they meet the damper feels the material's mean rate
            s += w[P_D0] * ((end - before) / h[b] - (end - start) / left)
        b += 1
        if not contact * s < 0.0:
            _take(w, trial)
            stress[b], material[b] = s, end
            continue
        # contact is lost within the step, where the straight line between the end stresses is zero
        at_start = w[X_S] + w[X_F] + w[X_Q] + w[P_D0] * (end - start) / left
        part = at_start / (at_start - s) if contact * at_start > 0.0 else 0.0
        if part > 0.0:
            _held(w, law_p, part * left, start, start + part * (end - start), trial)
            _take(w, trial)
        one[0] = (1.0 - part) * left
        run(w, law_p, one, none, none, out)
        touching, alone = False, 0
        stress[b], material[b] = 0.0, w[X_E]

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


@_jit
def _held(w, law_p, h, start, end, final):
    """Stress at the end of a straight strain from start to end in h; with `final` the state goes along.

    h = 0: a jump, which the damper does not feel.
    """
    n = int(w[P_N])
    change = end - start
    if h != w[X_H]:
        _fill_table(w, h)
    Q = 0.0
    for j in range(n):
        new = w[A_Q + j] * w[A_A + j] + w[A_G + j] * change
        Q += new
        if final:
            w[A_Q + j] = new
    s, t, W = _elastic(int(w[P_LAW]), law_p, w[P_Y], w[P_BETA], w[P_DE], w[P_EC], w[P_SHARE], w[P_MM], w[P_MB],
                       w[X_WM], end)
    f, tf = 0.0, 0.0
    if w[P_SY] > 0.0:
        f, tf = _friction(w, end)
    if final:
        if w[P_SY] > 0.0:
            _commit_friction(w, end, f)
        w[X_E], w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q] = end, s, t, f, tf, Q
        w[X_WM] = max(w[X_WM], W)
    return s + f + Q + (w[P_D0] * change / h if h > 0.0 else 0.0)


@_jit
def drive_position(w, law_p, h, e, contact, stress, material):
    """Stress and strain of the material (K + 1,) at knots of an imposed strain e (K + 1,), h (K,) s apart; rested.

    contact: +1 plates that do not pull, -1 a film that does not push, 0 bonded. At the first knot the strain jumps
    to e[0]. w (SIZE,) holds the numbers of the plant without circuit and mass; its state is overwritten.
    """
    prepare(w, law_p)
    one, none, out = np.empty(1), np.zeros(1), np.empty(1)
    kept = w.copy()
    s = _held(w, law_p, 0.0, 0.0, e[0], False)
    touching = not contact * s < 0.0
    if touching:
        _held(w, law_p, 0.0, 0.0, e[0], True)
    stress[0], material[0] = (s, e[0]) if touching else (0.0, 0.0)
    for b in range(h.size):
        start, end, left = e[b], e[b + 1], h[b]
        met = False
        before = material[b]
        if not touching:
            kept[:] = w
            one[0] = left
            run(w, law_p, one, none, none, out)
            flown = w[X_E]
            if not contact * (end - flown) > 0.0:
                stress[b + 1], material[b + 1] = 0.0, flown
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
            _held(w, law_p, 0.0, w[X_E], start, True)
            touching, met = True, True
        s = _held(w, law_p, left, start, end, False)
        if met:
            # over the step in which they meet the damper feels the material's mean rate
            s += w[P_D0] * ((end - before) / h[b] - (end - start) / left)
        if not contact * s < 0.0:
            _held(w, law_p, left, start, end, True)
            stress[b + 1], material[b + 1] = s, end
            continue
        # contact is lost within the step, where the straight line between the end stresses is zero
        at_start = w[X_S] + w[X_F] + w[X_Q] + w[P_D0] * (end - start) / left
        part = at_start / (at_start - s) if contact * at_start > 0.0 else 0.0
        if part > 0.0:
            _held(w, law_p, part * left, start, start + part * (end - start), True)
        one[0] = (1.0 - part) * left
        run(w, law_p, one, none, none, out)
        touching = False
        stress[b + 1], material[b + 1] = 0.0, w[X_E]

"""The compiled material between plates, with everything that a model may leave out: imposed strain to stress.

While the plates touch, the strain is straight from knot to knot and branches follow exactly. Plates do not pull (a
film does not push): where they would have to, the material goes its own way at zero stress until the plates meet it
again. A loss or a gain of contact is placed where straight lines cross.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import njit
from .circuit_kernel import fold, phi1
from .material_kernel import (
    BEYOND,
    P_BETA,
    P_DE,
    P_EC,
    P_LAW,
    P_MB,
    P_MM,
    P_SHARE,
    P_SY,
    P_Y,
    X_E,
    X_F,
    X_S,
    X_T,
    X_TF,
    X_WM,
    commit_friction,
    elastic,
    friction,
    rested,
)
from .static import HOOKE
from .step_length import shorter

_jit = njit(cache=True, error_model="numpy", nogil=True)

# ---- numbers of a plant between plates, behind those of the material: damper, branches, sum of their stiffness; then
# sum of the branches' stress, length of step that the coefficients belong to, sum k (1 - a), sum k phi_1
P_D0, P_N, P_K, X_Q, X_H, X_LOSS, X_LAG = range(BEYOND, BEYOND + 7)
#: most branches
BRANCHES = 24
# ---- branches k, tau, stress, exp(-x), k phi_1(x)
A_K, A_TAU, A_Q, A_A, A_G = range(BEYOND + 8, BEYOND + 8 + 5 * BRANCHES, BRANCHES)
SIZE = BEYOND + 8 + 5 * BRANCHES

_TOLERANCE = 4e-6  # a Newton step of this strain is the last: what is left is its square
_CREEP_TOLERANCE = 1e-6  # strain error allowed for taking the creep within a step as straight
_COURSE_TOLERANCE = 1e-7  # the same for the course of a damper, which adds up
_SHORTEST = 5e-4  # part of a step from row to row below which no accuracy is sought any more
_MOST_STEPS, _MAX_ITERATIONS = 20_000, 60
#: rows on its own after which a material is followed in steps of one row more, and the longest of these steps
_SLOWS, _LONGEST = 8, 16


@_jit
def _fill_table(w, h):
    """Coefficients of a step of length h (s)."""
    loss, lag = 0.0, 0.0
    for j in range(int(w[P_N])):
        k = w[A_K + j]
        z = h / w[A_TAU + j]
        m = phi1(z)
        w[A_A + j] = 1.0 - z * m
        w[A_G + j] = k * m
        loss += k * z * m
        lag += k * m
    w[X_LOSS], w[X_LAG], w[X_H] = loss, lag, h


@fold
def _damped(c, F0, F1, G, h):
    """c y' + G y = F0 + F1 t/h from y = 0: its end and its mean over h."""
    z = G * h / c
    if abs(z) < 1e-2:
        p3 = 1.0 / 6.0 - z * (1.0 / 24.0 - z * (1.0 / 120.0 - z / 720.0))
        p2 = 0.5 - z * p3
        p1 = 1.0 - z * p2
    else:
        p1 = (1.0 - math.exp(-z)) / z
        p2 = (1.0 - p1) / z
        p3 = (0.5 - p2) / z
    return h / c * (F0 * p1 + F1 * p2), h / c * (F0 * p2 + F1 * p3)


@_jit
def _fly(w, law_p, h):
    """Let the material go its own way at zero stress for h (s): from the state in w, which it leaves there.

    The strain jumps at the start of a step and then goes straight: branches answer that exactly, and a damper is
    integrated exactly for the secant stiffness of the step. nan where there is no balance of forces.
    """
    n, law_id = int(w[P_N]), int(w[P_LAW])
    Y, beta, dE, ec = w[P_Y], w[P_BETA], w[P_DE], w[P_EC]
    share, mm, mb, sy = w[P_SHARE], w[P_MM], w[P_MB], w[P_SY]
    damp, K = w[P_D0], w[P_K]
    curved = law_id != HOOKE or beta != 0.0 or dE != 0.0 or share != 0.0 or sy > 0.0
    k, q, a, g = w[A_K:A_K + n], w[A_Q:A_Q + n], w[A_A:A_A + n], w[A_G:A_G + n]
    e, Wm, s, t, f, tf, Q = w[X_E], w[X_WM], w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q]
    done, step = 0.0, h
    for _ in range(_MOST_STEPS):
        if step != w[X_H]:
            _fill_table(w, step)
        B, KP = w[X_LOSS], w[X_LAG]
        kept = 0.0
        for j in range(n):
            kept += q[j] * a[j]
        A, Ka = Q - kept, K - B
        good = False
        D = J = y = change = G = 0.0
        s1, t1, f1, tf1, W1 = s, t, f, tf, 0.0
        for it in range(_MAX_ITERATIONS):
            e1 = e + D
            if curved and it > 0:
                s1, t1, W1 = elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, e1)
                if sy > 0.0:
                    f1, tf1 = friction(w, e1)
            if damp > 0.0:
                G = K + Y if not curved else K + t + tf
                if curved and abs(D) > 1e-7:
                    G = K + ((s1 - s) + (f1 - f)) / D
                new, mean = _damped(damp, -s - f - Q, A + B * J + (K - KP) * (D - J), G, step)
                J = 2.0 * mean - new
                change = new - D
                if it > 12:
                    change *= 0.5  # a secant that swings to and fro
                D += change
                good = abs(change) < 2e-9
            else:
                room = 1.0 / (t1 + tf1 + KP + B)
                y = (A + B * D) * room
                if not curved:
                    s1 = Y * e1
                change = -(s1 + f1 + kept + Ka * D + (KP - Ka) * y) / (t1 + tf1 + Ka + (KP - Ka) * B * room)
                if it > 25:
                    change *= 0.5  # to and fro across a corner of friction or softening
                D += change
                if not curved or (abs(change) < _TOLERANCE and it > 0):
                    good = True
                    y += B * room * change
                    W1 += s1 * change
                    s1 += t1 * change
                    f1 += tf1 * change
                if not good and abs(change) > 0.1:
                    D += math.copysign(0.1, change) - change
                J = D - y
            if good or not -5.0 < e + D < 0.95:
                break
        grow = 2.0
        if damp > 0.0 and step > (_SHORTEST if good else 1e-6) * h:
            # along the step the law was its chord, and the branches saw its mean course
            bend = 2.0 * abs(K + t1 + tf1 - G) * (abs(D) + abs(J)) + B * abs(J)
            if not good or 0.1 * bend > _COURSE_TOLERANCE * (t1 + K):
                step *= 0.5
                continue
            if 0.3 * bend > _COURSE_TOLERANCE * (t1 + K):
                grow = 1.0
        if not good or math.isnan(D):
            break
        if n > 0 and 0.003 * (t1 + K) < B and step > 1e-6 * h:
            creep = abs(A + B * J) / (t1 + K + B)
            wrong = 0.1 * creep * B / (t1 + K)
            if wrong > _CREEP_TOLERANCE:
                step *= shorter(_CREEP_TOLERANCE / wrong, 0.5)
                continue
            if 4.0 * wrong > _CREEP_TOLERANCE:
                grow = min(grow, 0.9 * math.sqrt(_CREEP_TOLERANCE / wrong))
        Q = 0.0
        for j in range(n):
            new_q = (q[j] + k[j] * J) * a[j] + g[j] * (D - J)
            q[j] = new_q
            Q += new_q
        e += D
        if sy > 0.0:
            commit_friction(w, e, f1)
        if not curved:
            s1 = Y * e
        s, t, f, tf = s1, t1, f1, tf1
        Wm = max(Wm, W1)
        done += step
        if done >= h * (1.0 - 1e-12):
            break
        step = min(grow * step, h - done)
    w[X_E], w[X_WM], w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q] = e, Wm, s, t, f, tf, Q
    if not done >= h * (1.0 - 1e-12):
        w[X_E] = math.nan


@_jit
def rest(w, law_p):
    """Fill in what follows from the numbers of a plant, and the state of a rested one."""
    rested(w, law_p)
    w[P_K] = 0.0
    for j in range(int(w[P_N])):
        w[P_K] += w[A_K + j]
        w[A_Q + j] = 0.0
    w[X_Q], w[X_H] = 0.0, -1.0


@_jit
def held(w, law_p, h, start, end, trial):
    """Stress at the end of a straight strain from start to end in h; `trial` (SIZE,) gets the state that goes along.

    h = 0: a jump, which the damper does not feel. Nothing has changed until `take`.
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
    s, t, W = elastic(int(w[P_LAW]), law_p, w[P_Y], w[P_BETA], w[P_DE], w[P_EC], w[P_SHARE], w[P_MM], w[P_MB],
                      w[X_WM], end)
    f, tf = 0.0, 0.0
    if w[P_SY] > 0.0:
        f, tf = friction(w, end)
    trial[X_E], trial[X_S], trial[X_T], trial[X_F], trial[X_TF], trial[X_Q], trial[X_WM] = end, s, t, f, tf, Q, W
    return s + f + Q + (w[P_D0] * change / h if h > 0.0 else 0.0)


@_jit
def take(w, trial):
    """Make the state that was tried last the present one."""
    for j in range(int(w[P_N])):
        w[A_Q + j] = trial[A_Q + j]
    if w[P_SY] > 0.0:
        commit_friction(w, trial[X_E], trial[X_F])
    w[X_E], w[X_S], w[X_T] = trial[X_E], trial[X_S], trial[X_T]
    w[X_F], w[X_TF], w[X_Q] = trial[X_F], trial[X_TF], trial[X_Q]
    w[X_WM] = max(w[X_WM], trial[X_WM])


@_jit
def _flown(w, law_p, h, b, rows, e, contact, before):
    """Whether the material (strain `before`) stays off the plates for `rows` rows after row b; they are flown then."""
    highest, long = -np.inf, 0.0
    for i in range(b, b + rows):
        highest = max(highest, contact * e[i + 1])
        long += h[i]
    if highest > contact * before:
        return False
    _fly(w, law_p, long)
    return not highest > contact * w[X_E]


@_jit
def _pressed(w, law_p, h, b, e, contact, new, stress, material):
    """Follow plates that touch from row b on, as long as steps are as long as that of the coefficients in w and contact
    is not lost; returns the row that it has come to.

    The same as `held` and `take` row after row, without a call and a copy of the state in each. new (BRANCHES,) is
    overwritten.
    """
    n, law_id = int(w[P_N]), int(w[P_LAW])
    Y, beta, dE, ec = w[P_Y], w[P_BETA], w[P_DE], w[P_EC]
    share, mm, mb, sy = w[P_SHARE], w[P_MM], w[P_MB], w[P_SY]
    straight = law_id == HOOKE and beta == 0.0 and dE == 0.0 and share == 0.0
    length, damp = w[X_H], w[P_D0]
    q, a, g = w[A_Q:A_Q + n], w[A_A:A_A + n], w[A_G:A_G + n]
    s, t, f, tf, kept, Wm = w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q], w[X_WM]
    first, W = b, 0.0
    while b < h.size and h[b] == length:
        end = e[b + 1]
        change = end - e[b]
        Q = 0.0
        for j in range(n):
            new[j] = q[j] * a[j] + g[j] * change
            Q += new[j]
        s1, t1, f1, tf1 = Y * end, Y, 0.0, 0.0
        if not straight:
            s1, t1, W = elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, end)
        if sy > 0.0:
            f1, tf1 = friction(w, end)
        total = s1 + f1 + Q + damp * change / length
        if contact * total < 0.0:
            break
        for j in range(n):
            q[j] = new[j]
        if sy > 0.0:
            commit_friction(w, end, f1)
        s, t, f, tf, kept, Wm = s1, t1, f1, tf1, Q, max(Wm, W)
        b += 1
        stress[b], material[b] = total, end
    if b > first:
        w[X_E], w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q], w[X_WM] = e[b], s, t, f, tf, kept, Wm
    return b


@_jit
def drive_position(w, law_p, h, e, contact, stress, material):
    """Stress and strain of the material (K + 1,) at knots of an imposed strain e (K + 1,), h (K,) s apart; rested.

    contact: +1 plates that do not pull, -1 a film that does not push, 0 bonded. At the first knot the strain jumps
    to e[0]. w (SIZE,) holds the numbers of the plant without circuit and mass; its state is overwritten.
    """
    rest(w, law_p)
    kept, trial = w.copy(), w.copy()
    s = held(w, law_p, 0.0, 0.0, e[0], trial)
    touching = not contact * s < 0.0
    if touching:
        take(w, trial)
    stress[0], material[0] = (s, e[0]) if touching else (0.0, 0.0)
    b, alone, new = np.int64(0), 0, np.empty(BRANCHES)  # a plain 0 would have its own copy of what follows compiled
    while b < h.size:
        if touching and h[b] == w[X_H]:
            b = _pressed(w, law_p, h, b, e, contact, new, stress, material)
            if b == h.size:
                break
        start, end, left = e[b], e[b + 1], h[b]
        met = False
        before = material[b]
        if not touching:
            kept[:] = w
            # what goes its own way slows down, and is followed in longer steps while the plates are far
            rows = min(1 + alone // _SLOWS, _LONGEST, h.size - b)
            if rows > 1:
                if _flown(w, law_p, h, b, rows, e, contact, before):
                    after = w[X_E]
                    for i in range(rows):
                        stress[b + 1 + i], material[b + 1 + i] = 0.0, before + (after - before) * (i + 1) / rows
                    b += rows
                    alone += rows
                    continue
                w[:] = kept
            _fly(w, law_p, left)
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
                _fly(w, law_p, part * left)
            start += part * (end - start)
            left = max((1.0 - part) * left, 1e-12 * h[b])
            held(w, law_p, 0.0, w[X_E], start, trial)
            take(w, trial)
            touching, met = True, True
        s = held(w, law_p, left, start, end, trial)
        if met:
            # over the step in which they meet the damper feels the material's mean rate
            s += w[P_D0] * ((end - before) / h[b] - (end - start) / left)
        b += 1
        if not contact * s < 0.0:
            take(w, trial)
            stress[b], material[b] = s, end
            continue
        # contact is lost within the step, where the straight line between the end stresses is zero
        at_start = w[X_S] + w[X_F] + w[X_Q] + w[P_D0] * (end - start) / left
        part = at_start / (at_start - s) if contact * at_start > 0.0 else 0.0
        if part > 0.0:
            held(w, law_p, part * left, start, start + part * (end - start), trial)
            take(w, trial)
        _fly(w, law_p, (1.0 - part) * left)
        touching, alone = False, 0
        stress[b], material[b] = 0.0, w[X_E]

"""The compiled chain with everything that a model may leave out: supply voltage to strain, strain to stress.

One step goes from node to node. Voltage on the dielectric, stored charges, stress and strain are solved together at
its end, by Newton's method. What has a memory of its own is integrated with exponentials along the step:

* a jump at the start of the step and then a straight line, for stress as for strain. The jump is placed so that the
  mean over the step is right. For a held command without resistance that is the true course; for a charging curve it
  is exact in mean and end;
* branches, polarisation and stored charge answer that course exactly;
* a damper or a mass is integrated exactly for the secant stiffness of the step (iterated until it is the one of the
  step), so that stiff and oscillating cases need no smaller steps.

A step is cut where branches relax so much within it that the course of their creep is no straight line.

Equations: force balance and circuit as in the reference paper (Eqs. 1-6, Table SII) with the effects of the
catalogue of missing physics; friction after Iwan (10.1115/1.3607751), worked out by Masing's rules (1926) from the
points of reversal instead of element by element, which is the same; softening after Ogden and Roxburgh
(10.1098/rspa.1999.0431).

Numba keeps compiled code by the date of this file alone: after an edit of `static.py` or `circuit_kernel.py` touch
this one.
"""

from __future__ import annotations

import math

from numba import njit

from .circuit_kernel import charge, field, inline, leaking, phi1, shorter, stored, straight
from .static import HOOKE, law_stress_tangent

_jit = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})

# Everything is in one array of floats: a call with a dozen arrays costs more than a step of three branches.
# ---- numbers of a plant
(
    P_LAW, P_Y, P_BETA, P_DE, P_EC, P_SHARE, P_MM, P_MB,  # elastic part
    P_SY, P_EY, P_ELEMENTS, P_SCALE,  # friction; the last: mean of the exponential distribution behind the elements
    P_D0, P_MASS,  # damper with the mass's own one, mass per area and length
    P_FACTOR, P_THICK, P_CEPS, P_CHI, P_TAUD,  # stress
    P_RS, P_RL, P_C0, P_EACT, P_Z0,  # circuit
    P_AQ, P_TAUQ,  # stored charge
    P_N, P_K,  # number of branches, sum of their stiffness
    P_CURVED, P_MOVING, P_STRETCHES, P_CHARGES,  # what is needed at all
) = range(32)

# ---- numbers that go from step to step
(
    X_E, X_VEL, X_V, X_VQ, X_P, X_WM,  # strain, its rate, volts on the dielectric, stored charge, polarisation, W_m
    X_S, X_T, X_F, X_TF,  # elastic stress, its tangent, friction stress, its tangent
    X_Q,  # sum of the branches
    X_TOP, X_DIR,  # reversal points on the stack, direction of travel
    X_FE, X_FF,  # strain and stress of friction at the last step
    X_H,  # length of step that the coefficients belong to
    # coefficients of a step: sum k (1 - a), sum k phi_1; memory and weights of the input's start and end
    X_LOSS, X_LAG, X_PA, X_P0, X_P1, X_QA, X_Q0, X_Q1,
    X_TRIED,  # steps tried since the state was prepared
) = range(32, 57)

#: most branches, reversal points and elements of friction
BRANCHES, STACK, ELEMENTS = 24, 64, 256
# ---- where the arrays begin: branches k, tau, stress, exp(-x), k phi_1(x); reversal points e, f; elements of friction:
# yield strains, sums of stiffness x yield strain up to each
(
    A_K, A_TAU, A_Q, A_A, A_G,
) = range(64, 64 + 5 * BRANCHES, BRANCHES)
A_ER = 64 + 5 * BRANCHES
A_FR = A_ER + STACK + 2
A_Y = A_FR + STACK + 2
A_SUM = A_Y + ELEMENTS + 1
# ---- coefficients of another length of step: X_H to X_Q1, exp(-x), k phi_1(x)
A_OTHER = A_SUM + ELEMENTS + 1
SIZE = A_OTHER + (X_Q1 - X_H + 1) + 2 * BRANCHES

_TOLERANCE = 4e-6  # a Newton step of this strain is the last: what is left is its square
_SMALL = 3e-4  # a longer step (strain) is no smooth motion
_CREEP_TOLERANCE = 1e-6  # strain error allowed for taking the creep within a step as straight
_COURSE_TOLERANCE = 1e-7  # the same for the course of a mass or a damper, which adds up
# share of the voltage by which an activated leak may be linearised beside the middle of a step, and least of it (V)
_CENTRED, _LITTLE_V = 0.01, 0.1
_SHORTEST = 5e-4  # part of a step from node to node below which no accuracy is sought any more
#: steps tried on average for each one asked for; beyond, there is no answer
_TRIES_A_STEP = 30
_MAX_ITERATIONS = 60


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
    if w[P_CHI] != 0.0:
        w[X_PA], w[X_P0], w[X_P1] = straight(h / w[P_TAUD])
    if w[P_AQ] != 0.0:
        w[X_QA], w[X_Q0], w[X_Q1] = straight(h / w[P_TAUQ])


@_jit
def _table(w, h):
    """Coefficients of a step of length h (s), which two lengths in turn need not work out again."""
    many = X_Q1 - X_H + 1
    for i in range(many):
        w[X_H + i], w[A_OTHER + i] = w[A_OTHER + i], w[X_H + i]
    for j in range(int(w[P_N])):
        i = A_OTHER + many + j
        w[A_A + j], w[i] = w[i], w[A_A + j]
        w[A_G + j], w[i + BRANCHES] = w[i + BRANCHES], w[A_G + j]
    if h != w[X_H]:
        _fill_table(w, h)


@inline
def _elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, e):
    """Elastic stress (Pa), its tangent, and the energy that the softening goes by (0 without softening)."""
    if law_id == HOOKE:
        s, t = Y * e, Y
    else:
        s, t = law_stress_tangent(law_id, law_p, e)
    if beta != 0.0:
        b = beta * Y * e * e
        s += b * e
        t += 3.0 * b
    if dE != 0.0:
        d = 1.0 / (1.0 + abs(e) / ec)
        s += dE * e * d
        t += dE * d * d
    W = 0.0
    if share != 0.0:
        if law_id == HOOKE:
            W = 0.5 * Y * e * e
        else:
            for g in range(3):
                at = 0.5 if g == 1 else (0.5 - 0.5 * 0.7745966692414834 if g == 0 else 0.5 + 0.5 * 0.7745966692414834)
                w = 4.0 / 9.0 if g == 1 else 2.5 / 9.0
                W += w * e * law_stress_tangent(law_id, law_p, at * e)[0]
        if beta != 0.0:
            W += 0.25 * beta * Y * e**4
        if dE != 0.0:
            r = abs(e) / ec
            # r - log(1 + r), by its series where it cancels
            W += dE * ec * ec * (r * r * (0.5 - r / 3.0) if r < 1e-4 else r - math.log1p(r))
        if Wm > W:
            room = 1.0 / (mm + mb * Wm)
            a = (Wm - W) * room
            soft = 1.0 - share * math.erf(a)
            t = t * soft + s * s * share * 1.1283791670955126 * math.exp(-a * a) * room
            s *= soft
    return s, t, W


@inline
def _backbone(w, x):
    """Stress and tangent of friction for a first loading to the strain x >= 0.

    n elements: yield strains y_j at the quantiles (j + 1/2)/n of the exponential distribution, equal stiffness; 0
    stands for infinitely many.
    """
    sy, ey, n = w[P_SY], w[P_EY], w[P_ELEMENTS]
    if n == 0.0:
        a = math.exp(-x / ey)
        return sy * (1.0 - a), sy / ey * a
    yielded = math.ceil(n * (1.0 - math.exp(-x / w[P_SCALE])) - 0.5)
    # the quantile is a rounded number: one to either side decides
    if yielded < n and w[A_Y + yielded] < x:
        yielded += 1
    elif yielded > 0 and w[A_Y + yielded - 1] >= x:
        yielded -= 1
    slope = (n - yielded) * (sy / (ey * n))
    return w[A_SUM + yielded] + slope * x, slope


@inline
def _friction(w, e):
    """Friction stress and tangent at strain e, coming straight from the last step; nothing is changed.

    Masing's rules: a branch from a reversal point is the first loading doubled in both axes; it ends where it meets
    the reversal point before, and goes on along the branch that was left there.
    """
    e0, direction, m = w[X_FE], w[X_DIR], int(w[X_TOP])
    d = 1.0 if e > e0 else (-1.0 if e < e0 else direction)
    last_e, last_f = e0, w[X_FF]
    turned = direction != 0.0 and d != direction
    if turned and m == 0:
        turned = d * e <= abs(e0)
    elif turned and d * (e - w[A_ER + m - 1]) > 0.0:
        # the loop that this turn opens is closed again: on along the curve that it left
        turned = False
        m -= 1
    if not turned:
        while m >= 2 and d * (e - w[A_ER + m - 2]) > 0.0:
            m -= 2
        if m == 0 or (m == 1 and d * e > abs(w[A_ER])):
            f, t = _backbone(w, abs(e))
            return (f if e >= 0.0 else -f), t
        last_e, last_f = w[A_ER + m - 1], w[A_FR + m - 1]
    f, t = _backbone(w, 0.5 * abs(e - last_e))
    return last_f + d * 2.0 * f, t


@inline
def _commit_friction(w, e, f):
    """Make the step to strain e with friction stress f final in the state of friction."""
    e0 = w[X_FE]
    if e != e0:
        direction, m = w[X_DIR], int(w[X_TOP])
        d = 1.0 if e > e0 else -1.0
        if direction != 0.0 and d != direction:
            if m >= STACK:
                m -= 2  # the innermost loop is forgotten
            w[A_ER + m], w[A_FR + m] = e0, w[X_FF]
            m += 1
        while m >= 2 and d * (e - w[A_ER + m - 2]) > 0.0:
            m -= 2
        if m == 1 and d * e > abs(w[A_ER]):
            m = 0
        w[X_DIR], w[X_TOP], w[X_FE], w[X_FF] = d, float(m), e, f


@inline
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


@inline
def _swinging(m, c, F0, F1, G, h, v0):
    """m y'' + c y' + G y = F0 + F1 t/h from y = 0, y' = v0: end, rate at the end, mean over h."""
    b = F1 / (h * G)
    a = (F0 - c * b) / G
    g = 0.5 * c / m
    square = G / m - g * g
    v = v0 - b
    if square > 1e-8 * g * g:
        om = math.sqrt(square)
        cos, sin = math.cos(om * h), math.sin(om * h)
        decay = math.exp(-g * h)
        side = (v - g * a) / om
        y = decay * (side * sin - a * cos)
        rate = decay * ((g * a + om * side) * cos + (om * a - g * side) * sin)
    else:
        fast = g + math.sqrt(max(-square, 1e-12 * g * g))
        slow = G / m / fast
        c2 = (slow * a - v) / (fast - slow)
        c1 = -a - c2
        d1, d2 = math.exp(-slow * h), math.exp(-fast * h)
        y = c1 * d1 + c2 * d2
        rate = -slow * c1 * d1 - fast * c2 * d2
    y += a + b * h
    rate += b
    return y, rate, (F0 + 0.5 * F1 - (m * (rate - v0) + c * y) / h) / G


@_jit
def run(w, law_p, h, u0, u1, out):
    """Strain (m,) after steps of h (m,) s, the supply straight from u0 to u1 (m,) V within each.

    Goes on from the state in w and leaves it there. nan from where there is no balance of forces.
    """
    n, law_id = int(w[P_N]), int(w[P_LAW])
    Y, beta, dE, ec = w[P_Y], w[P_BETA], w[P_DE], w[P_EC]
    share, mm, mb, sy = w[P_SHARE], w[P_MM], w[P_MB], w[P_SY]
    damp, mass, K = w[P_D0], w[P_MASS], w[P_K]
    factor, thick, c_eps, chi, aq = w[P_FACTOR], w[P_THICK] != 0.0, w[P_CEPS], w[P_CHI], w[P_AQ]
    rs, c0, active = w[P_RS], w[P_C0], w[P_EACT]
    curved, moving = w[P_CURVED] != 0.0, w[P_MOVING] != 0.0
    stretches, stores = w[P_STRETCHES] != 0.0, w[P_CHI] != 0.0 or w[P_AQ] != 0.0
    k, q, a, g = w[A_K:A_K + n], w[A_Q:A_Q + n], w[A_A:A_A + n], w[A_G:A_G + n]
    e, vel, V, vq, P, Wm = w[X_E], w[X_VEL], w[X_V], w[X_VQ], w[X_P], w[X_WM]
    s, t, f, tf, Q = w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q]
    ph, dph = field(thick, c_eps, e)
    known, B, KP = w[X_H], w[X_LOSS], w[X_LAG]
    lag_q, lag_p = w[X_QA:X_QA + 3], w[X_PA:X_PA + 3]
    rl, lift, curve, middle = w[P_RL], 0.0, 0.0, 0.0
    D1, D2, step1 = 0.0, 0.0, -1.0
    spent, budget = 0, _TRIES_A_STEP * h.size + 20_000
    for i in range(h.size):
        whole, done = h[i], 0.0
        step, rise = whole, 0.0
        v_start, v_end = u0[i], u1[i]
        if moving and whole == 0.0:
            if rs == 0.0:
                V = v_end
            out[i] = e
            continue
        while True:
            spent += 1
            if spent > budget:  # a chain too stiff to be worth following
                e = math.nan
                break
            if step != known:
                _table(w, step)
                known, B, KP = step, w[X_LOSS], w[X_LAG]
            if done > 0.0 or step < whole:
                rise = (u1[i] - u0[i]) / whole
                v_start, v_end = u0[i] + rise * done, u0[i] + rise * (done + step)
            kept = 0.0
            for j in range(n):
                kept += q[j] * a[j]
            A, Ka = Q - kept, K - B
            # what a change of V^2 moves at once, and what holds against it
            prompt = 0.0 if moving else factor * ph / (t + tf + K - factor * V * V * dph)
            # smooth motion goes on as it did: then the first correction is the last
            D = 2.0 * D1 - D2 if step == step1 else 0.0
            if abs(D) > _SMALL:
                D = 0.0
            v1, vm, v2, dv = v_end, 0.5 * (v_start + v_end), 0.0, 0.0
            if rs == 0.0:
                v2 = (v_start * v_start + v_start * v_end + v_end * v_end) * (1.0 / 3.0)
            vq1, P1, ss, se, dse = vq, P, 0.0, 0.0, 0.0
            good, centred = False, True
            J, y, change, room, G = 0.0, 0.0, 0.0, 0.0, 0.0
            s1, t1, f1, tf1, ph1, dph1, W1, vel1 = s, t, f, tf, ph, dph, 0.0, vel
            for it in range(_MAX_ITERATIONS):
                e1 = e + D
                if curved and (it > 0 or D != 0.0):
                    s1, t1, W1 = _elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, e1)
                    if sy > 0.0:
                        f1, tf1 = _friction(w, e1)
                    if stretches:
                        ph1, dph1 = field(thick, c_eps, e1)
                if it == 0 or rs > 0.0:
                    if rs > 0.0:
                        if active > 0.0:
                            middle = vm if it > 0 else V + 0.5 * (v_end - v_start)
                            rl, lift, curve = leaking(w[P_RL], active, w[P_Z0], rs, middle)
                        v1, vm, v2, dv, _, _, _, _ = charge(rs, rl, c0, c_eps, prompt, step, e, e1, V, v_start + lift,
                                                            v_end + lift)
                        if active > 0.0:
                            centred = abs(vm - middle) <= _CENTRED * abs(vm) + _LITTLE_V
                    se = factor * v1 * v1
                    ss = 2.0 * factor * v2 - se
                    dse = 2.0 * factor * v1 * dv
                    if stores:
                        vq1, P1, ss, se, dse = stored(lag_q, lag_p, factor, aq, chi, v1, vm, v2, dv, vq,
                                                        P)
                if moving:
                    F0 = ss * ph - s - f - Q
                    if not curved:
                        G = K + Y
                    elif abs(D) > 1e-7:
                        G = K + ((s1 - s) + (f1 - f) - se * (ph1 - ph)) / D
                    else:
                        G = K + t + tf - se * dph
                    F1 = (se - ss) * ph + A + B * J + (K - KP) * (D - J)
                    if mass == 0.0:
                        new, mean = _damped(damp, F0, F1, G, step)
                    else:
                        new, vel1, mean = _swinging(mass, damp, F0, F1, G, step, vel)
                    J = 2.0 * mean - new
                    change = new - D
                    if it > 12:
                        change *= 0.5  # a secant that swings to and fro
                    D += change
                    y = D - J
                    good = abs(change) < 2e-9 and centred
                else:
                    T = t1 + tf1 - se * dph1 - ph1 * dse
                    room = 1.0 / (T + KP + B)
                    y = (A + B * D + (se - ss) * ph1) * room
                    if not curved:
                        s1 = Y * e1
                    change = -(s1 + f1 + kept + Ka * D + (KP - Ka) * y - se * ph1) / (T + Ka + (KP - Ka) * B * room)
                    if it > 25:
                        change *= 0.5  # to and fro across a corner of friction or softening
                    D += change
                    if not curved or (abs(change) < _TOLERANCE and (it > 0 or change != D) and centred):
                        good = True
                        y += B * room * change
                        W1 += s1 * change
                        s1 += t1 * change
                        f1 += tf1 * change
                        ph1 += dph1 * change
                        v1 += dv * change
                if good:
                    break
                if abs(change) > 0.1 and not moving:
                    D += math.copysign(0.1, change) - change
                if not -5.0 < e + D < 0.95:
                    break
            grow = 2.0
            if moving and step > (_SHORTEST if good else 1e-6) * whole:
                # along the step the law was its chord, and the branches saw its mean course
                bend = 2.0 * abs(K + t1 + tf1 - se * dph1 - G) * (abs(D) + abs(J)) + B * abs(J)
                if mass > 0.0 and vel * vel1 < 0.0 and (sy > 0.0 or share > 0.0):
                    # a turn within the step, which friction and softening remember
                    bend += step * min(abs(vel), abs(vel1)) * (t1 + tf1 + K)
                if rs > 0.0 or v_start != v_end:
                    # the same for the stress of a charging dielectric, where the mass or the damper is quick enough
                    swift = step * step * (t1 + K) / mass if mass > 0.0 else step * (t1 + K) / damp
                    x = (V if rs > 0.0 else v_start) - vq
                    bend += 0.3 * abs(ss - factor * (x + P) * x) * min(1.0, 0.25 * swift)
                    if rs > 0.0:
                        bend += 4.0 * abs(se * J)
                if not good or 0.1 * bend > _COURSE_TOLERANCE * (t1 + K):
                    step *= 0.5
                    continue
                if 0.3 * bend > _COURSE_TOLERANCE * (t1 + K):
                    grow = 1.0
            if not good or math.isnan(D):
                e = math.nan
                break
            if rs > 0.0 and abs(D) > _SMALL and step > 1e-6 * whole:
                # a motional current that comes early in the step and is over at its end
                x = step / (rs * c0)
                wrong = 2.0 * abs(D * (e + D)) * x * x / (1.0 + x * x * x)
                # to first order it is known, at an even voltage
                wrong *= min(1.0, 4.0 * abs(v1 - V) / max(abs(v1), abs(V)) + 4.0 * abs(D))
                if wrong > _CREEP_TOLERANCE:
                    # a step of several time constants says nothing about one within the first
                    step = min(0.5 * step, rs * c0) if x > 1.0 else step * shorter(_CREEP_TOLERANCE / wrong, 1.0 / 3.0)
                    continue
                if 8.0 * wrong > _CREEP_TOLERANCE:
                    grow = min(grow, 0.9 * (_CREEP_TOLERANCE / wrong) ** (1.0 / 3.0))
            if active > 0.0 and step > 1e-6 * whole:
                # the tangent at the middle, and the current bent beside it
                far = (v1 - V) / max(abs(v1), abs(V), 1e-9)
                wrong = 0.1 * abs(e + D) * rs / (rs + rl) * curve * far * far * min(1.0, step / (rs * c0))
                if wrong > _CREEP_TOLERANCE:
                    step *= shorter(_CREEP_TOLERANCE / wrong, 0.5)
                    continue
                if 4.0 * wrong > _CREEP_TOLERANCE:
                    grow = min(grow, 0.9 * math.sqrt(_CREEP_TOLERANCE / wrong))
            if n > 0 and 0.003 * (t1 + K) < B and step > 1e-6 * whole:
                creep = abs(A + B * (D - y)) / (t1 + K + B)
                wrong = 0.1 * creep * B / (t1 + K)
                if wrong > _CREEP_TOLERANCE:
                    step *= shorter(_CREEP_TOLERANCE / wrong, 0.5)
                    continue
                if 4.0 * wrong > _CREEP_TOLERANCE:
                    grow = min(grow, 0.9 * math.sqrt(_CREEP_TOLERANCE / wrong))
            J = D - y
            Q = 0.0
            for j in range(n):
                new_q = (q[j] + k[j] * J) * a[j] + g[j] * y
                q[j] = new_q
                Q += new_q
            e += D
            if sy > 0.0:
                _commit_friction(w, e, f1)
            if not curved:
                s1 = Y * e
            s, t, f, tf, ph, dph, vel, V, vq, P = s1, t1, f1, tf1, ph1, dph1, vel1, v1, vq1, P1
            Wm = max(Wm, W1)
            D2, D1, step1 = D1 if step == step1 else D, D, step
            done += step
            if done >= whole * (1.0 - 1e-12):
                break
            step = min(grow * step, whole - done)
        out[i] = e
        if math.isnan(e):
            out[i:] = math.nan
            break
    w[X_E], w[X_VEL], w[X_V], w[X_VQ], w[X_P], w[X_WM] = e, vel, V, vq, P, Wm
    w[X_S], w[X_T], w[X_F], w[X_TF], w[X_Q] = s, t, f, tf, Q
    w[X_TRIED] += spent


@_jit
def prepare(w, law_p):
    """Fill in what follows from the numbers of a plant, and the state of a rested one."""
    w[P_K] = 0.0
    for j in range(int(w[P_N])):
        w[P_K] += w[A_K + j]
        w[A_Q + j] = 0.0
    w[X_E:X_TRIED + 1] = 0.0
    w[X_H] = w[A_OTHER] = -1.0
    w[X_S], w[X_T], _ = _elastic(int(w[P_LAW]), law_p, w[P_Y], w[P_BETA], w[P_DE], w[P_EC], 0.0, 1.0, 0.0, 0.0, 0.0)
    n = int(w[P_ELEMENTS])
    if w[P_SY] > 0.0:
        w[X_TF] = w[P_SY] / w[P_EY]
        mean = 0.0
        for j in range(n):
            w[A_Y + j] = -math.log1p(-(j + 0.5) / n)
            mean += w[A_Y + j] / n
        if n > 0:
            w[P_SCALE] = w[P_EY] / mean
            w[A_SUM] = 0.0
            for j in range(n):
                w[A_Y + j] *= w[P_SCALE]
                w[A_SUM + j + 1] = w[A_SUM + j] + w[P_SY] / (w[P_EY] * n) * w[A_Y + j]
    w[P_MOVING] = w[P_D0] > 0.0 or w[P_MASS] > 0.0
    w[P_STRETCHES] = w[P_THICK] != 0.0 or w[P_CEPS] != 0.0
    w[P_CURVED] = (w[P_LAW] != HOOKE or w[P_BETA] != 0.0 or w[P_DE] != 0.0 or w[P_SHARE] != 0.0 or w[P_SY] > 0.0
                   or w[P_STRETCHES] != 0.0 or w[P_RS] > 0.0)


@_jit
def drive_voltage(w, law_p, h, u0, u1, out):
    """Strain (m,) at nodes after steps h (m,) s, the supply straight from u0 to u1 (m,) V within each; rested.

    w (SIZE,) holds the numbers of the plant; its state is overwritten.
    """
    prepare(w, law_p)
    run(w, law_p, h, u0, u1, out)

"""The compiled material: its elastic stress with softening, and its friction.

Friction after Iwan (10.1115/1.3607751), worked out by Masing's rules (1926) from the points of reversal instead of
element by element, which is the same; softening after Ogden and Roxburgh (10.1098/rspa.1999.0431). Compiled into
`plant_kernel` (under voltage) and `plate_kernel` (between plates), which add what is viscoelastic.
"""

from __future__ import annotations

import math

from ..compiled import njit
from .circuit_kernel import inline
from .series_law import SERIES, series_at_rest
from .static import HOOKE, law_stress_tangent, law_work

# Everything is in one array of floats: a call with a dozen arrays costs more than a step of three branches.
# ---- numbers of a material, and what goes from step to step
(
    P_LAW, P_Y, P_BETA, P_DE, P_EC, P_SHARE, P_MM, P_MB,  # elastic part
    P_SY, P_EY, P_ELEMENTS, P_SCALE,  # friction; the last: mean of the exponential distribution behind the elements
    X_E, X_WM,  # strain, W_m
    X_S, X_T, X_F, X_TF,  # elastic stress, its tangent, friction stress, its tangent
    X_TOP, X_DIR,  # reversal points on the stack, direction of travel
    X_FE, X_FF,  # strain and stress of friction at the last step
) = range(22)

#: most reversal points and elements of friction
STACK, ELEMENTS = 64, 256
# ---- where the arrays begin: reversal points e, f; yield strains of friction's elements, sums of stiffness x yield
# strain up to each
A_ER = 24
A_FR = A_ER + STACK + 2
A_Y = A_FR + STACK + 2
A_SUM = A_Y + ELEMENTS + 1
#: from here on the numbers belong to the kernel that the material is in
BEYOND = A_SUM + ELEMENTS + 1


@inline
def elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, e):
    """Elastic stress (Pa), its tangent, and the energy that the softening goes by (0 without softening).

    Of a law in series with elements (SERIES) the stress is that of a linear spring with what is beside the network.
    """
    if law_id in (HOOKE, SERIES):
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
        beside, beside_t = 0.0, 0.0
        if law_id == HOOKE:
            W = 0.5 * Y * e * e
        elif law_id == SERIES:
            # what softens is what the network holds at rest, which is not part of the stress here
            at_rest, slope, W = series_at_rest(law_p, e)
            beside, beside_t = at_rest - Y * e, slope - Y
        else:
            W = law_work(law_id, law_p, e)
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
            full, lost = s + beside, 1.0 - soft
            t += full * full * share * 1.1283791670955126 * math.exp(-a * a) * room - (t + beside_t) * lost
            s -= full * lost
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
def friction(w, e):
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
def commit_friction(w, e, f):
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


@njit(cache=True, error_model="numpy", nogil=True)
def beyond_spring(w, law_p, Wm, e):
    """Stress (Pa) at strain e beyond that of the linear spring, and its slope; Wm: energy reached before."""
    Y = w[P_Y]
    s, t, _ = elastic(int(w[P_LAW]), law_p, Y, w[P_BETA], w[P_DE], w[P_EC], w[P_SHARE], w[P_MM], w[P_MB], Wm, e)
    f, tf = 0.0, 0.0
    if w[P_SY] > 0.0:
        f, tf = friction(w, e)
    return s + f - Y * e, t + tf - Y


@njit(cache=True, error_model="numpy", nogil=True)
def rested(w, law_p):
    """Fill in what follows from the numbers of a material, and the state of a rested one."""
    w[X_E:X_FF + 1] = 0.0
    w[X_S], w[X_T], _ = elastic(int(w[P_LAW]), law_p, w[P_Y], w[P_BETA], w[P_DE], w[P_EC], 0.0, 1.0, 0.0, 0.0, 0.0)
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

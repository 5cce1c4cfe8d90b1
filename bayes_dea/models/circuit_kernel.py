"""The dielectric's circuit along one step: charging through a resistance, stored charge, Maxwell stress.

The supply is straight within a step. Compiled into the kernels that call it (`plant_kernel`, `supply_kernel`).
"""

from __future__ import annotations

import math

from ..compiled import njit

#: for what takes arrays: handing one on costs more than a whole step, because its references are counted
inline = njit(cache=True, error_model="numpy", nogil=True, inline="always")
#: for what takes numbers alone: made part of its caller as well, but later, behind what takes the compiler most time
fold = njit(cache=True, error_model="numpy", nogil=True, forceinline=True, fastmath={"contract"})


@fold
def place(h, places):
    """Which of so many places (a power of two) the coefficients of a step of h (s) are kept at.

    Steps of a few lengths, whole rows, follow each other in any order.
    """
    return int(min(h, 1e6) * 1e5 + 0.5) & (places - 1)


@fold
def phi1(x):
    if x < 1e-4:
        return 1.0 - x * (0.5 - x / 6.0)
    return -math.expm1(-x) / x


@fold
def decayed(z):
    """exp(-z) to 2e-15 where |z| < 0.01; z may be complex."""
    return 1.0 - z * (1.0 - z * (0.5 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z / 120.0))))


@fold
def straight(z):
    """A lag under a straight input for z time constants: what stays, weights of the input's start and end."""
    m = phi1(z)
    second = 0.5 - z / 6.0 if z < 1e-4 else (1.0 - m) / z
    return 1.0 - z * m, z * (m - second), z * second


@fold
def charge(charges, leaks, c_eps, prompt, e0, e1, v0, u0, u1):
    """Volts on the dielectric at the end of a step, their mean, the mean of their square, and d(end)/d(e1); then the
    course behind them, the part that dies from the start, c exp(-z t/h), beside a line l: z, c, start and rise of l;
    then exp(-z) and (1 - exp(-z))/z. c = 0 where all is straight. charges: h/(R C0); leaks: 1 + R/R_l.

    V' = (V_s - V)/(R C) - V/(R_l C) - V C'/C with the capacitance C0 (1 - e)^-2 (1 + c e) of the middle strain and
    the supply V_s straight from u0 to u1. What charges within the step moves the film at once by `prompt` (1/V^2) times
    the change of V^2: that motion is early in the step, as exp(-z t/h) and its square. The rest of it is even along the
    step. The current of the first is worked out to first order.
    """
    em = 0.5 * (e0 + e1)
    room = 1.0 - em
    feed = charges * room * room
    slope = 2.0 / room
    if c_eps != 0.0:
        stretched = 1.0 / (1.0 + c_eps * em)
        feed *= stretched
        slope += c_eps * stretched
    x = feed * leaks
    du = u1 - u0
    z = x + slope * (e1 - e0)
    if abs(z) < 0.02 or x < 0.02:
        # nearly straight, and no time to be early in
        p3 = 1.0 / 6.0 - z * (1.0 / 24.0 - z * (1.0 / 120.0 - z / 720.0))
        p2 = 0.5 - z * p3
        p1 = 1.0 - z * p2
        a = 1.0 - z * p1
        end = a * v0 + feed * (u0 * p1 + du * p2)
        mean = p1 * v0 + feed * (u0 * p2 + du * p3)
        square = (v0 * v0 + v0 * end + end * end) / 3.0
        return end, mean, square, -end * p1 * slope, z, 0.0, v0, end - v0, a, p1
    a = math.exp(-x)
    first = second = 0.0
    if prompt > 0.0:
        per_x = 1.0 / x
        l0 = feed * u0 * per_x
        l1 = feed * du * per_x * (1.0 - (1.0 - a) * per_x)
        c = v0 - l0
        first = 2.0 * prompt * (l0 + 0.5 * l1) * c * (a - 1.0)
        second = prompt * c * c * (a * a - 1.0)
        z -= slope * (first + second)
    # next to the one above: no further exponential
    d = x - z
    a *= 1.0 + d * (1.0 + d * (0.5 + d * (1.0 / 6.0 + d / 24.0))) if abs(d) < 1e-3 else math.exp(d)
    per_z = 1.0 / z
    p1 = (1.0 - a) * per_z
    p2 = (1.0 - p1) * per_z
    p3 = (0.5 - p2) * per_z
    end = a * v0 + feed * (u0 * p1 + du * p2)
    mean = p1 * v0 + feed * (u0 * p2 + du * p3)
    # a straight line and a transient; in a short step both are far larger than what they add up to
    rise = feed * du * per_z
    base = (feed * u0 - rise) * per_z
    c = v0 - base
    square = (base * base + base * rise + rise * rise * (1.0 / 3.0)
              + 2.0 * c * (base * p1 + rise * (p1 - a) * per_z) + 0.5 * c * c * (1.0 + a) * p1)
    # what the supply's slope does is even along the step: l0 to l0 + l1; what is left dies from the start
    l0, l1 = feed * u0 * per_z, rise * (1.0 - p1)
    c = v0 - l0
    dv = -end * p1 * slope
    if prompt > 0.0:
        lost, both = 1.0 - a, 1.0 + a
        share = 1.0 / (lost * both)
        less = slope * mean * (first * (p1 - a) * both + second * p1 * lost) * share
        end -= slope * a * (first * mean * z * both * share + second * (2.0 * (l0 + 0.5 * l1) * lost * share + c))
        square -= 2.0 * mean * less
        mean -= less
    return end, mean, square, dv, z, c, l0, l1, a, p1


@fold
def leaking(leak, active, thickness, rs, v):
    """Of a conductance that the field activates (Poole and Frenkel), about v volts: its tangent (1/ohm), what the rest
    of its current is worth at the supply (V), and the bend of the current, v^2/i d2i/dv2."""
    r = math.sqrt(abs(v) / (thickness * active))
    slope = math.exp(r) / leak
    return slope * (1.0 + 0.5 * r), 0.5 * rs * slope * r * v, 0.25 * r * (1.0 + r)


@inline
def stored(lag_q, lag_p, factor, aq, chi, v1, vm, v2, dv, vq, P):
    """Stored charge and polarisation at the end of a step, and the Maxwell stress with them, without stretch (Pa):
    just after a jump at the start that makes the mean right, at the end, and d(end)/d(strain).

    lag_q, lag_p: what stays of either after a step, weights of the input's start and end (`straight`).
    """
    start = 2.0 * vm - v1
    vq1, P1 = vq, P
    if aq != 0.0:
        vq1 = vq * lag_q[0] + aq * (start * lag_q[1] + v1 * lag_q[2])
    if chi != 0.0:
        P1 = P * lag_p[0] + chi * ((start - vq) * lag_p[1] + (v1 - vq1) * lag_p[2])
    x = v1 - vq1
    end = factor * (x + P1) * x
    qm, pm = 0.5 * (vq + vq1), 0.5 * (P + P1)
    mean = factor * (v2 - 2.0 * vm * qm + qm * qm + pm * (vm - qm))
    return vq1, P1, 2.0 * mean - end, end, factor * (2.0 * x + P1) * dv


@fold
def field(thick, c_eps, e):
    """What the stretch makes of the Maxwell stress: factor and derivative."""
    f, d = 1.0 + c_eps * e, c_eps
    if thick:
        i = 1.0 / (1.0 - e)
        d = (d + 2.0 * f * i) * i * i
        f *= i * i
    return f, d

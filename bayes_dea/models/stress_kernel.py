"""A static law joined with a network under a given stress, compiled: see `mechanics`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from .static import HOOKE, law_stress_tangent

Array = NDArray[np.float64]

GM, GKM, GKV = range(3)

#: allowed difference of the quadratic and the linear path at the end of a step, in strain
PATH_TOLERANCE = 5e-9
#: steps tried within one interval before the answer is nan: a law that softens runs away, others need tens
MAX_TRIES = 20_000
#: within this strain of the last evaluation the law is its tangent there: the error is below
#: E'/(2E) 1e-11, which for E'/E = 10 is 0.5 pm of the reference stack
TANGENT_RADIUS = 3e-6
#: the stretch is sought between these strains; a law that finds no balance there gives nan
_E_LOW, _E_HIGH = -20.0, 1.0
#: rows of the table of a step length, see branch_tables
LOSS, MEAN, END = 0, 1, 2
#: h/tau below which a series is used
_SERIES = 0.25

_jit = njit(cache=True, error_model="numpy")
_inline = njit(cache=True, error_model="numpy", inline="always")


@_inline
def branch_tables(h: float, n: int, k: Array, rate: Array, table: Array) -> None:
    """Weights of one step h, table (3, n + 1): 1 - exp(-x), phi_1 = its mean, 2 phi_2, with x = h/tau.

    The last column holds the sums over the branches, the second and third weighted with k.

    A branch driven by e = e0 + v t + c t^2 ends at q (1 - loss) + k (v h phi_1 + c h^2 2 phi_2).
    """
    table[:, n] = 0.0
    for i in range(n):
        x = h * rate[i]
        if x < _SERIES:
            # phi_2 by its series (the closed form cancels), the others from it
            f = 1.0 / 479001600.0
            f = 1.0 / 39916800.0 - x * f
            f = 1.0 / 3628800.0 - x * f
            f = 1.0 / 362880.0 - x * f
            f = 1.0 / 40320.0 - x * f
            f = 1.0 / 5040.0 - x * f
            f = 1.0 / 720.0 - x * f
            f = 1.0 / 120.0 - x * f
            f = 1.0 / 24.0 - x * f
            f = 1.0 / 6.0 - x * f
            f = 0.5 - x * f
            mean = 1.0 - x * f
            table[LOSS, i] = x * mean
        else:
            loss = 1.0 - math.exp(-x)
            mean = loss / x
            f = (1.0 - mean) / x
            table[LOSS, i] = loss
        table[MEAN, i] = mean
        table[END, i] = 2.0 * f
        table[MEAN, n] += k[i] * mean
        table[END, n] += 2.0 * k[i] * f


@_inline
def balanced(law_id: int, p: Array, e0: float, s0: float, tangent0: float, P: float, r: float,
             ) -> tuple[float, float, float, float]:
    """Solve s(e0 + y) - s0 + P y + r = 0 for y; returns y and the last evaluation (e, s, tangent).

    Newton's method between bounds that close in, bisection where it leaves them. nan where no root lies
    in the allowed strains. e is nan where the law was not evaluated.
    """
    y = -r * (1.0 / (tangent0 + P))  # the reciprocal is ready before r is
    if abs(y) <= TANGENT_RADIUS and tangent0 + P > 0.0:
        return y, math.nan, s0, tangent0
    if law_id == HOOKE:
        return y, e0, s0, tangent0
    if math.isnan(r):
        return math.nan, math.nan, s0, tangent0
    low, high = _E_LOW, _E_HIGH
    if r < 0.0:
        low = e0
    else:
        high = e0
    for _ in range(200):
        e = e0 + y
        if not (low < e < high):
            e = 0.5 * (low + high)
            y = e - e0
        s, tangent = law_stress_tangent(law_id, p, e)
        f = s - s0 + P * y + r
        if f > 0.0 or (math.isnan(f) and e > 0.0):
            high = e
        else:
            low = e
        step = -f / (tangent + P)
        if abs(step) <= TANGENT_RADIUS and tangent + P > 0.0:
            return y + step, e, s, tangent
        if high - low < 1e-15:
            # a wall such as Gent's locking stretch; at the edges of the allowed strains there is no root
            if low > _E_LOW + 1e-9 and high < _E_HIGH - 1e-9 and math.isfinite(s):
                return y, e, s, tangent
            break
        y = y + step if math.isfinite(step) else math.inf
    return math.nan, math.nan, math.nan, math.nan


@_inline
def _law_near(law_id: int, p: Array, e: float, e_c: float, s_c: float, t_c: float,
              ) -> tuple[float, float, float]:
    """Centre, stress and tangent of the law's expansion, moved to e where e has left the old one."""
    if abs(e - e_c) > TANGENT_RADIUS:
        s, t = law_stress_tangent(law_id, p, e)
        return e, s, t
    return e_c, s_c, t_c


@_jit
def shorter(h: float, error: float) -> float:
    """Next step length for an error that grows with the third power of the step."""
    if error <= 1e-3 * PATH_TOLERANCE:
        return 8.0 * h
    return h * max(0.1, 0.8 * (PATH_TOLERANCE / error) ** (1.0 / 3.0))


@_inline
def jump(law_id: int, p: Array, n: int, k: Array, K: float, q: Array, sigma: float,
          e: float, e_c: float, s_c: float, t_c: float) -> tuple[float, float, float, float]:
    """GM: the strain jumps until the balance holds; the branches answer as springs."""
    e_c, s_c, t_c = _law_near(law_id, p, e, e_c, s_c, t_c)
    s = s_c + t_c * (e - e_c)
    r = s - sigma
    for i in range(n):
        r += q[i]
    y, at, s_at, t_at = balanced(law_id, p, e, s, t_c, K, r)
    if not math.isnan(at):
        e_c, s_c, t_c = at, s_at, t_at
    for i in range(n):
        q[i] += k[i] * y
    return e + y, e_c, s_c, t_c


@_inline
def creep_gm(law_id: int, p: Array, n: int, k: Array, rate: Array, K: float, h: float, q: Array,
              sigma: float, regular: Array, work: Array, e: float, e_c: float, s_c: float, t_c: float,
              ) -> tuple[float, float, float, float]:
    """GM under constant stress for h, starting in balance. `regular` holds the tables of h itself."""
    rest, step, tries = h, h, 0
    while rest > 0.0:
        table = regular
        if step != h:
            table = work
            branch_tables(step, n, k, rate, table)
        e_c, s_c, t_c = _law_near(law_id, p, e, e_c, s_c, t_c)
        s = s_c + t_c * (e - e_c)
        mean, end = table[MEAN, n], table[END, n]
        pull, balance = 0.0, s - sigma
        for i in range(n):
            pull += q[i] * rate[i]
            balance += q[i] - q[i] * table[LOSS, i]
        straight = pull * step * (1.0 / (t_c + K))
        y, at, s_at, t_at = balanced(law_id, p, e, s, t_c, end, balance + straight * (mean - end))
        error = abs((straight - y) * (mean - end) * (1.0 / (t_c + end)))
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < MAX_TRIES:
            step = shorter(step, error)
            continue
        if tries >= MAX_TRIES:
            y = math.nan
            step = rest
        if not math.isnan(at):
            e_c, s_c, t_c = at, s_at, t_at
        for i in range(n):
            q[i] += (k[i] * (straight * table[MEAN, i] + (y - straight) * table[END, i])
                     - q[i] * table[LOSS, i])
        e += y
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, shorter(step, error)))
    return e, e_c, s_c, t_c


@_inline
def _phi(z: float, phi: Array) -> None:
    """phi[j] = int_0^1 (1-u)^(j-1)/(j-1)! exp(-z u) du for j = 1..8, phi[0] = exp(-z)."""
    if z < 1.0:
        term, total = 1.0 / 40320.0, 0.0
        for j in range(9, 25):
            total += term
            term *= -z / j
        phi[8] = total
        factorial = 5040.0
        for j in range(7, 0, -1):
            phi[j] = 1.0 / factorial - z * phi[j + 1]
            factorial /= j
        phi[0] = 1.0 - z * phi[1]
    else:
        phi[0] = math.exp(-z)
        inverse, factorial = 1.0 / z, 1.0
        for j in range(8):
            phi[j + 1] = (1.0 / factorial - phi[j]) * inverse
            factorial *= j + 1


@_inline
def _joint_weights(x: float, z: float, phi: Array) -> tuple[float, float, float]:
    """Memory exp(-x(1-u)) over [0, 1] of the rates exp(-zu), u phi_1(zu), u^2 phi_2(zu).

    These are the divided differences of exp at (-x, -z), (-x, -z, 0), (-x, -z, 0, 0).
    """
    if x < 0.1:
        m0 = phi[1] - x * (phi[2] - x * (phi[3] - x * (phi[4] - x * (phi[5] - x * phi[6]))))
        m1 = phi[2] - x * (phi[3] - x * (phi[4] - x * (phi[5] - x * (phi[6] - x * phi[7]))))
        m2 = phi[3] - x * (phi[4] - x * (phi[5] - x * (phi[6] - x * (phi[7] - x * phi[8]))))
        return m0, m1, m2
    d = x - z
    if d == 0.0:
        m0 = phi[0]
    elif abs(d) < 1.0:
        m0 = -phi[0] * math.expm1(-d) / d
    else:
        m0 = (phi[0] - math.exp(-x)) / d
    if x >= z:
        m1 = (phi[1] - m0) / x
        return m0, m1, (phi[2] - m1) / x
    f1 = -math.expm1(-x) / x
    m1 = (f1 - m0) / z
    return m0, m1, ((1.0 - f1) / x - m1) / z


@_inline
def creep_gkm(law_id: int, p: Array, n: int, k: Array, rate: Array, K: float, d0: float, h: float, q: Array,
               sigma: float, regular: Array, work: Array, joint: Array, phi: Array,
               e: float, e_c: float, s_c: float, t_c: float) -> tuple[float, float, float, float]:
    """GKM under constant stress for h: d0 e' = sigma - s_static(e) - Q, Q = sum q.

    With G = E + K at the start, v = e'(0) and y = e - e(0) this is d0 y' = d0 v - G y + N(t): N holds the
    relaxation of the branches (its slope at 0 is S = sum q/tau) and the curvature of the law. N is taken as
    S t + c t^2 with its end value solved for; how y and the branches answer is exact, for h >> d0/G too.
    """
    rest, step, tries = h, h, 0
    while rest > 0.0:
        table = regular
        if step != h:
            table = work
            branch_tables(step, n, k, rate, table)
        e_c, s_c, t_c = _law_near(law_id, p, e, e_c, s_c, t_c)
        s = s_c + t_c * (e - e_c)
        G = t_c + K
        z = G / d0 * step
        if z != joint[3, 0] or step != joint[3, 1]:
            joint[3, 0], joint[3, 1] = z, step
            _phi(z, phi)
            joint[:3, n] = 0.0
            for i in range(n):
                m0, m1, m2 = _joint_weights(step * rate[i], z, phi)
                joint[0, i], joint[1, i], joint[2, i] = m0, m1, m2
                joint[0, n] += k[i] * m0
                joint[1, n] += k[i] * m1
                joint[2, n] += k[i] * m2
        w0, w1, w2 = joint[0, n], joint[1, n], joint[2, n]
        slack = K - table[MEAN, n]
        pull, total, kept = 0.0, 0.0, 0.0
        for i in range(n):
            pull += q[i] * rate[i]
            total += q[i]
            kept -= q[i] * table[LOSS, i]
        start = (sigma - s - total) / d0 * step  # v h
        linear = pull * step  # N(h) as far as its slope at 0 goes
        unit = step / d0
        y_unit = 2.0 * phi[3] * unit
        y_start = phi[1] * start + (phi[2] - 2.0 * phi[3]) * unit * linear
        q_unit = 2.0 * w2 * unit
        q_start = kept + w0 * start + (w1 - 2.0 * w2) * unit * linear
        # the end value N is (y - y_start) / y_unit; inserted in d0 y'(h) + s(e+y) + Q(h) = sigma
        P = (1.0 + q_unit) / y_unit - G
        r = q_start - (1.0 + q_unit) * y_start / y_unit
        y, at, s_at, t_at = balanced(law_id, p, e, s, t_c, P, r)
        beyond = (y - y_start) / y_unit - linear
        error = abs(beyond) * (unit * (phi[2] - 2.0 * phi[3]) + slack / (G * G))
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < MAX_TRIES:
            step = shorter(step, error)
            continue
        if tries >= MAX_TRIES:
            y = math.nan
            step = rest
        if not math.isnan(at):
            e_c, s_c, t_c = at, s_at, t_at
        for i in range(n):
            q[i] += k[i] * (joint[0, i] * start + unit * (joint[1, i] * linear + 2.0 * joint[2, i] * beyond)
                            ) - q[i] * table[LOSS, i]
        e += y
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, shorter(step, error)))
    return e, e_c, s_c, t_c


@_jit
def stress_driven_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: float, h: Array,
                         sigma: Array, state: Array, e_jump: Array, e_end: Array) -> None:
    """See `stress_driven`; `state` (n + 1) is read and overwritten, e_jump and e_end (K) are filled."""
    n = k.size
    K = 0.0
    for i in range(n):
        K += k[i]
    q = state[1:].copy()
    rate = 1.0 / tau
    regular, work, joint, phi = np.empty((3, n + 1)), np.empty((3, n + 1)), np.zeros((4, n + 2)), np.empty(9)
    last = -1.0
    e = state[0]
    if network == GKV:
        spring = e
        for i in range(n):
            spring -= q[i]
        e_c = spring
        s_c, t_c = law_stress_tangent(law_id, p, e_c)
        for b in range(h.size):
            if h[b] != last:
                last = h[b]
                branch_tables(last, n, k, rate, regular)
            e_c, s_c, t_c = _law_near(law_id, p, spring, e_c, s_c, t_c)
            s = s_c + t_c * (spring - e_c)
            y, at, s_at, t_at = balanced(law_id, p, spring, s, t_c, 0.0, s - sigma[b])
            if not math.isnan(at):
                e_c, s_c, t_c = at, s_at, t_at
            spring += y
            before, after = spring, spring
            for i in range(n):
                before += q[i]
                q[i] += regular[LOSS, i] * (sigma[b] / k[i] - q[i])
                after += q[i]
            e_jump[b] = before
            e_end[b] = after
            e = after
    else:
        e_c = e
        s_c, t_c = law_stress_tangent(law_id, p, e_c)
        damped = network == GKM and d0 > 0.0
        for b in range(h.size):
            if h[b] != last:
                last = h[b]
                branch_tables(last, n, k, rate, regular)
            if damped:
                e_jump[b] = e
                e, e_c, s_c, t_c = creep_gkm(law_id, p, n, k, rate, K, d0, h[b], q, sigma[b],
                                              regular, work, joint, phi, e, e_c, s_c, t_c)
            else:
                if b == 0 or sigma[b] != sigma[b - 1]:
                    e, e_c, s_c, t_c = jump(law_id, p, n, k, K, q, sigma[b], e, e_c, s_c, t_c)
                e_jump[b] = e
                e, e_c, s_c, t_c = creep_gm(law_id, p, n, k, rate, K, h[b], q, sigma[b],
                                             regular, work, e, e_c, s_c, t_c)
            e_end[b] = e
    state[0] = e
    state[1:] = q

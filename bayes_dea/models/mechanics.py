"""The compiled mechanical stage: a static law joined with a viscoelastic network, one sample after another.

Strain e and true stress s are positive in compression. The networks, with n branches (k_i, tau_i):

    GM    s = s_static(e) + sum q_i,             q_i' = k_i e' - q_i/tau_i
    GKM   s = s_static(e) + sum q_i + d0 e',     the same branches
    GKV   e = e_s + sum e_i,  s = s_static(e_s), tau_i e_i' = s/k_i - e_i

so the law is the equilibrium spring of GM and GKM and the instantaneous spring of GKV.

What is exact and what is not. The branches are integrated with exponentials along a path that is a
polynomial within a step (for GKM an exponential plus a polynomial), and the force balance is solved at
the end of each step. GKV under stress and GM and GKM under strain are exact. In the other cases the path
is quadratic; its distance from the linear path at the same end is the error estimate of the *linear* one,
of second order, and a step is cut until that is below `PATH_TOLERANCE`. The quadratic result, of third
order, is what is kept. This is the embedded-pair device of adaptive solvers, applied to exponential
integrators (Hochbruck and Ostermann, 10.1017/S0962492910000048).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import ArrayLike, NDArray

from bayes_dea.models.static import HOOKE, N_PARAMETERS, StaticLaw, law_stress_tangent
from bayes_dea.models.static import law as law_by_name
from bayes_dea.models.stiff_gkv import coupled_rates, ramp_step

from ..compiled import njit

Array = NDArray[np.float64]

GM, GKM, GKV = range(3)
#: network numbers by name
NETWORKS = {"gm": GM, "gkm": GKM, "gkv": GKV}

#: allowed difference of the quadratic and the linear path at the end of a step, in strain
PATH_TOLERANCE = 5e-9
#: a spring this many times faster than a step makes the explicit slope of the path unstable
_STIFF = 4.0
#: steps tried within one interval before the answer is nan: a law that softens runs away, others need tens
_MAX_TRIES = 20_000
#: within this strain of the last evaluation the law is its tangent there: the error is below
#: E'/(2E) 1e-11, which for E'/E = 10 is 0.5 pm of the reference stack
TANGENT_RADIUS = 3e-6
#: the stretch is sought between these strains; a law that finds no balance there gives nan
_E_LOW, _E_HIGH = -20.0, 1.0
#: rows of the table of a step length, see _branch_tables
_LOSS, _MEAN, _END = 0, 1, 2
#: h/tau below which a series is used
_SERIES = 0.25

_jit = njit(cache=True, error_model="numpy")
_inline = njit(cache=True, error_model="numpy", inline="always")


@_inline
def _branch_tables(h: float, n: int, k: Array, rate: Array, table: Array) -> None:
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
            table[_LOSS, i] = x * mean
        else:
            loss = 1.0 - math.exp(-x)
            mean = loss / x
            f = (1.0 - mean) / x
            table[_LOSS, i] = loss
        table[_MEAN, i] = mean
        table[_END, i] = 2.0 * f
        table[_MEAN, n] += k[i] * mean
        table[_END, n] += 2.0 * k[i] * f


@_inline
def _balance(law_id: int, p: Array, e0: float, s0: float, tangent0: float, P: float, r: float,
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
def _shorter(h: float, error: float) -> float:
    """Next step length for an error that grows with the third power of the step."""
    if error <= 1e-3 * PATH_TOLERANCE:
        return 8.0 * h
    return h * max(0.1, 0.8 * (PATH_TOLERANCE / error) ** (1.0 / 3.0))


@_inline
def _jump(law_id: int, p: Array, n: int, k: Array, K: float, q: Array, sigma: float,
          e: float, e_c: float, s_c: float, t_c: float) -> tuple[float, float, float, float]:
    """GM: the strain jumps until the balance holds; the branches answer as springs."""
    e_c, s_c, t_c = _law_near(law_id, p, e, e_c, s_c, t_c)
    s = s_c + t_c * (e - e_c)
    r = s - sigma
    for i in range(n):
        r += q[i]
    y, at, s_at, t_at = _balance(law_id, p, e, s, t_c, K, r)
    if not math.isnan(at):
        e_c, s_c, t_c = at, s_at, t_at
    for i in range(n):
        q[i] += k[i] * y
    return e + y, e_c, s_c, t_c


@_inline
def _creep_gm(law_id: int, p: Array, n: int, k: Array, rate: Array, K: float, h: float, q: Array,
              sigma: float, regular: Array, work: Array, e: float, e_c: float, s_c: float, t_c: float,
              ) -> tuple[float, float, float, float]:
    """GM under constant stress for h, starting in balance. `regular` holds the tables of h itself."""
    rest, step, tries = h, h, 0
    while rest > 0.0:
        table = regular
        if step != h:
            table = work
            _branch_tables(step, n, k, rate, table)
        e_c, s_c, t_c = _law_near(law_id, p, e, e_c, s_c, t_c)
        s = s_c + t_c * (e - e_c)
        mean, end = table[_MEAN, n], table[_END, n]
        pull, balance = 0.0, s - sigma
        for i in range(n):
            pull += q[i] * rate[i]
            balance += q[i] - q[i] * table[_LOSS, i]
        straight = pull * step * (1.0 / (t_c + K))
        y, at, s_at, t_at = _balance(law_id, p, e, s, t_c, end, balance + straight * (mean - end))
        error = abs((straight - y) * (mean - end) * (1.0 / (t_c + end)))
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < _MAX_TRIES:
            step = _shorter(step, error)
            continue
        if tries >= _MAX_TRIES:
            y = math.nan
            step = rest
        if not math.isnan(at):
            e_c, s_c, t_c = at, s_at, t_at
        for i in range(n):
            q[i] += (k[i] * (straight * table[_MEAN, i] + (y - straight) * table[_END, i])
                     - q[i] * table[_LOSS, i])
        e += y
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, _shorter(step, error)))
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
def _creep_gkm(law_id: int, p: Array, n: int, k: Array, rate: Array, K: float, d0: float, h: float, q: Array,
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
            _branch_tables(step, n, k, rate, table)
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
        slack = K - table[_MEAN, n]
        pull, total, kept = 0.0, 0.0, 0.0
        for i in range(n):
            pull += q[i] * rate[i]
            total += q[i]
            kept -= q[i] * table[_LOSS, i]
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
        y, at, s_at, t_at = _balance(law_id, p, e, s, t_c, P, r)
        beyond = (y - y_start) / y_unit - linear
        error = abs(beyond) * (unit * (phi[2] - 2.0 * phi[3]) + slack / (G * G))
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < _MAX_TRIES:
            step = _shorter(step, error)
            continue
        if tries >= _MAX_TRIES:
            y = math.nan
            step = rest
        if not math.isnan(at):
            e_c, s_c, t_c = at, s_at, t_at
        for i in range(n):
            q[i] += k[i] * (joint[0, i] * start + unit * (joint[1, i] * linear + 2.0 * joint[2, i] * beyond)
                            ) - q[i] * table[_LOSS, i]
        e += y
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, _shorter(step, error)))
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
                _branch_tables(last, n, k, rate, regular)
            e_c, s_c, t_c = _law_near(law_id, p, spring, e_c, s_c, t_c)
            s = s_c + t_c * (spring - e_c)
            y, at, s_at, t_at = _balance(law_id, p, spring, s, t_c, 0.0, s - sigma[b])
            if not math.isnan(at):
                e_c, s_c, t_c = at, s_at, t_at
            spring += y
            before, after = spring, spring
            for i in range(n):
                before += q[i]
                q[i] += regular[_LOSS, i] * (sigma[b] / k[i] - q[i])
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
                _branch_tables(last, n, k, rate, regular)
            if damped:
                e_jump[b] = e
                e, e_c, s_c, t_c = _creep_gkm(law_id, p, n, k, rate, K, d0, h[b], q, sigma[b],
                                              regular, work, joint, phi, e, e_c, s_c, t_c)
            else:
                if b == 0 or sigma[b] != sigma[b - 1]:
                    e, e_c, s_c, t_c = _jump(law_id, p, n, k, K, q, sigma[b], e, e_c, s_c, t_c)
                e_jump[b] = e
                e, e_c, s_c, t_c = _creep_gm(law_id, p, n, k, rate, K, h[b], q, sigma[b],
                                             regular, work, e, e_c, s_c, t_c)
            e_end[b] = e
    state[0] = e
    state[1:] = q


@_jit
def _free_flight(law_id: int, p: Array, network: int, n: int, k: Array, rate: Array, K: float, d0: float,
                 h: float, q: Array, regular: Array, work: Array, joint: Array, phi: Array, e: float,
                 ) -> float:
    """The material left alone at zero stress for h; returns its strain, q is moved on.

    Rare, so nothing is reused: the tables of h are built here, in `regular`.
    """
    if h <= 0.0:
        return e
    _branch_tables(h, n, k, rate, regular)
    if network == GKV:
        e = 0.0
        for i in range(n):
            q[i] -= q[i] * regular[_LOSS, i]
            e += q[i]
        return e
    s_c, t_c = law_stress_tangent(law_id, p, e)
    e_c = e
    if network == GKM and d0 > 0.0:
        e, e_c, s_c, t_c = _creep_gkm(law_id, p, n, k, rate, K, d0, h, q, 0.0, regular, work, joint, phi,
                                      e, e_c, s_c, t_c)
    else:
        e, e_c, s_c, t_c = _jump(law_id, p, n, k, K, q, 0.0, e, e_c, s_c, t_c)
        e, e_c, s_c, t_c = _creep_gm(law_id, p, n, k, rate, K, h, q, 0.0, regular, work, e, e_c, s_c, t_c)
    return e


@_jit
def _strain_step_gkv(law_id: int, p: Array, n: int, k: Array, rate: Array, h: float, start: float,
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
            _branch_tables(step, n, k, rate, table)
        flow, push, mean, last = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            flow += (s / k[i] - new[i]) * rate[i]
            push += (s / k[i] - new[i]) * table[_LOSS, i]
            mean += (1.0 - table[_MEAN, i]) / k[i]
            last += (1.0 - table[_END, i]) / k[i]
        slope = t * (speed - flow) * step
        # y + sum of the changes of e_i = speed step, with y the change of the spring
        P = 1.0 / last
        r = (push + slope * (mean - last) - speed * step) * P
        y, at, s_at, t_at = _balance(law_id, p, spring, s, t, P, r)
        if math.isnan(at):
            s_new, t_new = law_stress_tangent(law_id, p, spring + y)
        else:
            s_new = s_at + t_at * (spring + y - at)
            t_new = t_at
        rise = s_new - s
        error = abs((rise - slope) * (mean - last)) / (1.0 + t * last)
        tries += 1
        if error > PATH_TOLERANCE and step > 1e-7 * h and tries < _MAX_TRIES:
            step = _shorter(step, error)
            continue
        if tries >= _MAX_TRIES:
            rise = math.nan
            step = rest
        for i in range(n):
            new[i] += ((s / k[i] - new[i]) * table[_LOSS, i]
                       + (slope * (1.0 - table[_MEAN, i]) + (rise - slope) * (1.0 - table[_END, i])) / k[i])
        spring += y
        s, t = s_new, t_new
        if step >= rest:
            break
        rest -= step
        step = min(rest, max(step, _shorter(step, error)))
    # the spring takes what the branches leave, so rounding cannot pile up
    spring = end
    for i in range(n):
        spring -= new[i]
    s, t = law_stress_tangent(law_id, p, spring)
    return s


@_jit
def _strain_steps_stiff(law_id: int, p: Array, n: int, k: Array, rate: Array, rest: float, start: float,
                        speed: float, new: Array) -> float:
    """GKV behind a stiff spring: as `_strain_step_gkv` for what is left of a step, along the tangent of the law.

    Along it the branches are exact; the law's distance from it at the end is what a step is cut by.
    """
    change = np.empty(n)
    strain, step, tries = start, rest, 0
    end = start + speed * rest
    spring = start
    for i in range(n):
        spring -= new[i]
    s, t = law_stress_tangent(law_id, p, spring)
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
        if not error <= PATH_TOLERANCE and step > 1e-7 * rest and tries < _MAX_TRIES:
            step = _shorter(step, error) if math.isfinite(error) else 0.1 * step
            continue
        if tries >= _MAX_TRIES:
            return math.nan
        for i in range(n):
            new[i] += change[i]
        strain += speed * step
        spring = end if step >= rest else strain
        for i in range(n):
            spring -= new[i]
        s, t_new = law_stress_tangent(law_id, p, spring)
        if step >= rest:
            break
        if t_new != t:
            t = t_new
            mu, vectors = coupled_rates(n, k, rate, t)
        rest -= step
        step = min(rest, max(step, _shorter(step, error)))
    return s


@_inline
def _strain_step(law_id: int, p: Array, network: int, n: int, k: Array, rate: Array, d0: float, h: float,
                 start: float, end: float, q: Array, new: Array, table: Array, work: Array) -> float:
    """The strain goes linearly from start to end in h: fills `new` with the branches, returns the stress."""
    if network == GKV:
        return _strain_step_gkv(law_id, p, n, k, rate, h, start, end, q, new, table, work)
    s, _ = law_stress_tangent(law_id, p, end)
    change = end - start
    if network == GKM:
        s += d0 * change / h
    for i in range(n):
        new[i] = q[i] * (1.0 - table[_LOSS, i]) + k[i] * change * table[_MEAN, i]
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
            material, _, _, _ = _jump(law_id, p, n, k, K, q, 0.0, material, material, s_c, t_c)
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
            _branch_tables(left, n, k, rate, table)
        s = _strain_step(law_id, p, network, n, k, rate, d0, left, start, end, q, new, table, work)
        if met and network == GKM:
            # over the interval in which plate and material meet the damper feels the material's mean rate
            s += d0 * ((end - material) / h[b] - (end - start) / left)
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
                _branch_tables(part * left, n, k, rate, regular)
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


@njit(cache=True)
def stress_batch_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                        sigma: Array, state: Array, e_jump: Array, e_end: Array) -> None:
    """`stress_driven_kernel` for B parameter vectors; every array but h and sigma has a leading axis B."""
    for j in range(p.shape[0]):
        stress_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, sigma, state[j], e_jump[j],
                             e_end[j])


@njit(cache=True)
def strain_batch_kernel(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                        e: Array, contact: int, state: Array, stress: Array, e_material: Array) -> None:
    """`strain_driven_kernel` for B parameter vectors; every array but h and e has a leading axis B."""
    for j in range(p.shape[0]):
        strain_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, e, contact, state[j], stress[j],
                             e_material[j])


# Written out again, because numba's cache does not tell two compilations of one function apart; kept
# optional, because threads inside processes that are many already only slow each other down.
@njit(cache=True, parallel=True)
def stress_batch_threads(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                         sigma: Array, state: Array, e_jump: Array, e_end: Array) -> None:
    """`stress_batch_kernel` with the parameter vectors spread over several cores."""
    for j in prange(p.shape[0]):
        stress_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, sigma, state[j], e_jump[j],
                             e_end[j])


@njit(cache=True, parallel=True)
def strain_batch_threads(law_id: int, p: Array, network: int, k: Array, tau: Array, d0: Array, h: Array,
                         e: Array, contact: int, state: Array, stress: Array, e_material: Array) -> None:
    """`strain_batch_kernel` with the parameter vectors spread over several cores."""
    for j in prange(p.shape[0]):
        strain_driven_kernel(law_id, p[j], network, k[j], tau[j], d0[j], h, e, contact, state[j], stress[j],
                             e_material[j])


class StressDriven(NamedTuple):
    """Answer to a stress history; the arrays have a leading axis B when the parameters had one."""

    e_after_jump: Array  #: (K,) strain at the start of each interval, after the jump
    e_end: Array  #: (K,) strain at the end of each interval
    state: Array  #: (n + 1,) total strain, then q_i in Pa (GM, GKM) or e_i (GKV): where to go on from


class StrainDriven(NamedTuple):
    """Answer to a strain history; the arrays have a leading axis B when the parameters had one."""

    stress: Array  #: (K + 1,) true stress in Pa at the knots
    e_material: Array  #: (K + 1,) strain of the material; another than the imposed one where contact is lost
    state: Array  #: (n + 1,) as in StressDriven


class _Material(NamedTuple):
    law_id: int
    p: Array  # (B, N_PARAMETERS)
    network: int
    k: Array  # (B, n)
    tau: Array  # (B, n)
    d0: Array  # (B,)
    state: Array  # (B, n + 1)
    batched: bool


def _material(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
              d0: ArrayLike, state: ArrayLike | None) -> _Material:
    which = law_by_name(law) if isinstance(law, str) else law
    number = NETWORKS[network.lower()] if isinstance(network, str) else int(network)
    given = np.asarray(p, dtype=np.float64)
    batched = given.ndim == 2
    given = np.atleast_2d(given)
    count = given.shape[0]
    if not len(which.parameters) <= given.shape[1] <= N_PARAMETERS:
        raise ValueError(f"static law {which.name} takes {len(which.parameters)} parameters, "
                         f"{given.shape[1]} given")
    packed = np.zeros((count, N_PARAMETERS))
    packed[:, : given.shape[1]] = given
    stiffness, times = np.atleast_1d(np.asarray(k, float)), np.atleast_1d(np.asarray(tau, float))
    n = stiffness.shape[-1]
    if times.shape[-1] != n:
        raise ValueError(f"{n} branch stiffnesses but {times.shape[-1]} time constants")
    stiffness = np.ascontiguousarray(np.broadcast_to(stiffness, (count, n)))
    times = np.ascontiguousarray(np.broadcast_to(times, (count, n)))
    damper = np.ascontiguousarray(np.broadcast_to(np.asarray(d0, float), (count,)))
    if number not in (GM, GKM, GKV):
        raise ValueError(f"network {network!r} is unknown; choose one of {', '.join(NETWORKS)}")
    if not np.all(times > 0.0):
        raise ValueError("time constants must be positive")
    if number == GKV and not np.all(stiffness > 0.0):
        raise ValueError("the stiffness of a Kelvin-Voigt element must be positive")
    if number == GKM and not np.all(damper >= 0.0):
        raise ValueError("d0 must not be negative")
    begin = np.zeros((count, n + 1))
    if state is not None:
        begin[:] = np.asarray(state, float)
    return _Material(which.law_id, packed, number, stiffness, times, damper, begin, batched)


def _intervals(h: ArrayLike, drive: ArrayLike, extra: int, what: str) -> tuple[Array, Array]:
    steps = np.ascontiguousarray(h, dtype=np.float64)
    values = np.ascontiguousarray(drive, dtype=np.float64)
    if steps.ndim != 1 or values.shape != (steps.size + extra,):
        raise ValueError(f"{steps.size} intervals need {steps.size + extra} values of {what}, "
                         f"got shape {values.shape}")
    if not np.all(steps > 0.0):
        raise ValueError(f"interval {int(np.argmin(steps > 0.0))} is not longer than zero")
    return steps, values


def stress_driven(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
                  d0: ArrayLike, h: ArrayLike, sigma: ArrayLike, state: ArrayLike | None = None,
                  *, threads: bool = False) -> StressDriven:
    """Strain under stress that is constant within each interval.

    h (K,) s, durations of any size; sigma (K,) Pa true stress, compression positive. The law's parameters p
    in the order of `StaticLaw.parameters`; k (n,) Pa; tau (n,) s; d0 in Pa s, used by GKM alone. With p of
    shape (B, ...) a whole batch runs in one call: k, tau (B, n) or shared, d0 (B,) or one number, `threads`
    over several cores. A rested material (state None) starts from zero. At the start of an interval the
    strain jumps until the balance holds, except with d0 > 0. Where the law cannot carry the stress the
    answer is nan from there on. Raises ValueError for shapes that do not fit.
    """
    m = _material(law, p, network, k, tau, d0, state)
    steps, stress = _intervals(h, sigma, 0, "sigma")
    jump, end = np.empty((2, m.p.shape[0], steps.size))
    if m.batched:
        run = stress_batch_threads if threads else stress_batch_kernel
        run(m.law_id, m.p, m.network, m.k, m.tau, m.d0, steps, stress, m.state, jump, end)
        return StressDriven(jump, end, m.state)
    stress_driven_kernel(m.law_id, m.p[0], m.network, m.k[0], m.tau[0], m.d0[0], steps, stress, m.state[0],
                         jump[0], end[0])
    return StressDriven(jump[0], end[0], m.state[0])


def strain_driven(law: StaticLaw | str, p: ArrayLike, network: str | int, k: ArrayLike, tau: ArrayLike,
                  d0: ArrayLike, h: ArrayLike, e: ArrayLike, contact: int = 0, state: ArrayLike | None = None,
                  *, threads: bool = False) -> StrainDriven:
    """Stress at the knots of an imposed strain that is linear between them.

    h (K,) s; e (K + 1,) imposed strain, compression positive; the rest as in `stress_driven`. At the first
    knot the strain jumps from that of `state` to e[0] (the damper d0 does not feel this jump). At the other
    knots the damper adds d0 times the slope of the interval that ends there.

    contact: +1 plates that push and do not pull (stress never negative), -1 a film that pulls and does not
    push (never positive), 0 bonded. Where the stress would have the wrong sign the material follows its own
    balance at zero stress until the imposed strain meets it again; the branches see the material's strain,
    and a loss or a gain of contact is placed within its interval. One change of contact an interval.
    """
    m = _material(law, p, network, k, tau, d0, state)
    steps, strain = _intervals(h, e, 1, "e")
    if contact not in (-1, 0, 1):
        raise ValueError("contact is +1 (plates), -1 (film) or 0 (bonded)")
    stress, material = np.empty((2, m.p.shape[0], strain.size))
    if m.batched:
        run = strain_batch_threads if threads else strain_batch_kernel
        run(m.law_id, m.p, m.network, m.k, m.tau, m.d0, steps, strain, contact, m.state, stress, material)
        return StrainDriven(stress, material, m.state)
    strain_driven_kernel(m.law_id, m.p[0], m.network, m.k[0], m.tau[0], m.d0[0], steps, strain, contact,
                         m.state[0], stress[0], material[0])
    return StrainDriven(stress[0], material[0], m.state[0])


def force(stress: ArrayLike, e: ArrayLike, area: float) -> Array:
    """Force in N of a true stress on an incompressible block: s A / (1 - e), A the area at rest in m^2."""
    return np.asarray(np.asarray(stress, float) * area / (1.0 - np.asarray(e, float)))

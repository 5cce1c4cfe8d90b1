"""Linear viscoelastic networks as modes: exact conversions between their forms.

Every linear network answers a stress s(t) with the strain

    e(t) = D s(t) + sum_j c_j f(T_j; t),     T_j f' = s - f,                                   (modes)

D and c_j in 1/Pa, T_j in s. Generalised Kelvin-Voigt (GKV) is that form itself: D = 1/Y, c_j = 1/k_j, T_j = tau_j.
Generalised Maxwell (GM) has the modulus E(p) = Y + sum k_i tau_i p/(1 + tau_i p) (p: Laplace variable), the
generalised Kelvin-Maxwell (GKM) adds d0 p; their compliance 1/E(p) is again of the form above, with retardation
times T_j that interlace with the relaxation times: T_1 > tau_1 > T_2 > tau_2 ... (Tschoegl 1989,
doi 10.1007/978-3-642-73602-5, ch. 4). GM(n) with a spring and GKV(n) with a spring are therefore one and the same
function of the data. The Jacobian between log(Y, k, tau) and log(D, c, T) is +-1, so that log-normal densities
carry over without a correction (tested).

All arrays are (batch, n); orders fall: tau_1 > tau_2 > ...
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit

# division by zero, where absurd parameters coincide, gives inf or nan: the caller turns both into -inf
_jit = njit(cache=True, error_model="numpy")


@_jit
def _root(poles, weights, right, left, constant):
    """Root of h(x) = constant - sum w_i/(x - p_i) between the poles `left` and `right`, and h' there.

    Poles fall, weights are positive, so that h rises from -inf to +inf; right = -1: to the right of all poles
    (constant > 0). The poles on either side are replaced by one at the end of the interval with the same value and
    slope, and the quadratic that remains is solved ("middle way", Li 1993, LAPACK Working Note 89): three to six
    iterations whatever the weights. The unknown is the distance to the nearer pole, which keeps its digits when the
    two nearly coincide.
    """
    n = poles.size
    origin = left
    if right >= 0:
        width = poles[right] - poles[left]
        u = 0.5 * width
        h = constant
        for i in range(n):
            h -= weights[i] / (poles[left] - poles[i] + u)
        low, high = 0.0, width
        if h < 0:
            origin = right
            u, low, high = -0.5 * width, -width, 0.0
    else:
        width = 0.0
        low, high = 0.0, 0.0
        for i in range(n):
            high += weights[i]
        # with all weight on the nearest pole h is zero here, with it further off positive
        high = high / constant * 1.0000001
        u = high
    p0 = poles[origin]
    slope = np.nan
    for _ in range(100):
        value, slope_left, slope_right, size = constant, 0.0, 0.0, abs(constant)
        for i in range(n):
            q = 1.0 / (p0 - poles[i] + u)
            term = weights[i] * q
            value -= term
            size += abs(term)
            if i >= left:
                slope_left += term * q
            else:
                slope_right += term * q
        slope = slope_left + slope_right
        if value > 0:
            high = u
        else:
            low = u
        if abs(value) <= 2e-16 * size:
            break
        from_left = p0 - poles[left] + u if origin != left else u
        if right >= 0:
            from_right = u if origin == right else u - width
            c0 = value + slope_left * from_left + slope_right * from_right
            s_left, s_right = slope_left * from_left * from_left, slope_right * from_right * from_right
            if origin == left:
                b = c0 * width + s_left + s_right
                d = np.sqrt(max(b * b - 4.0 * c0 * s_left * width, 0.0))
                new = 2.0 * s_left * width / (b + d) if b > 0 else (b - d) / (2.0 * c0)
            else:
                b = s_left + s_right - c0 * width
                d = np.sqrt(max(b * b + 4.0 * c0 * s_right * width, 0.0))
                new = -2.0 * s_right * width / (b + d) if b > 0 else (d - b) / (2.0 * c0)
        else:
            c0 = value + slope_left * from_left
            new = slope_left * from_left * from_left / c0
        if not low < new < high:
            # bisect: in the logarithm of the distance, as it may span decades
            new = np.sqrt(low * high) if low * high > 0 else 0.5 * (low + high)
            new = -new if high <= 0 and new > 0 else new
        if abs(new - u) <= 2e-16 * abs(u):
            break
        u = new
    return p0 + u, slope


@_jit
def maxwell_to_modes(Y, k, tau, d0):
    """GM (d0 = 0) or GKM (d0 > 0) to modes. Y (B,) Pa, k (B, n) Pa, tau (B, n) s falling, d0 (B,) Pa s.

    Returns D (B,) 1/Pa, c (B, m) 1/Pa and T (B, m) s with m = n, or n + 1 when any d0 > 0 (then D = 0).
    """
    B, n = k.shape
    kelvin = d0[0] > 0
    m = n + 1 if kelvin else n
    D = np.zeros(B)
    c = np.empty((B, m))
    T = np.empty((B, m))
    poles = np.zeros(m)
    weights = np.empty(m)
    for b in range(B):
        # E(-1/T) = Y - sum k_i tau_i/(T - tau_i) - d0/T vanishes at the retardation times
        total = Y[b]
        for i in range(n):
            poles[i] = tau[b, i]
            weights[i] = k[b, i] * tau[b, i]
            total += k[b, i]
        if kelvin:
            weights[n] = d0[b]
        else:
            D[b] = 1.0 / total
        for j in range(m):
            T[b, j], slope = _root(poles, weights, j - 1, j, Y[b])
            c[b, j] = 1.0 / (T[b, j] * slope)
    return D, c, T


@_jit
def modes_to_maxwell(D, c, T):
    """Modes to GM (D > 0) or GKM (D = 0): the inverse of `maxwell_to_modes`.

    Returns Y (B,), k (B, n), tau (B, n), d0 (B,), with n = m, or m - 1 when D = 0.
    """
    B, m = c.shape
    kelvin = D[0] == 0.0
    n = m - 1 if kelvin else m
    Y = np.empty(B)
    d0 = np.zeros(B)
    k = np.empty((B, n))
    tau = np.empty((B, n))
    poles = np.zeros(n + 1)
    weights = np.empty(n + 1)
    for b in range(B):
        # the compliance D + sum c_j x/(x - T_j), divided by -x, rises between the T_j and, with D at pole 0, below
        total = D[b]
        rate = 0.0
        for j in range(m):
            poles[j] = T[b, j]
            weights[j] = c[b, j]
            total += c[b, j]
            rate += c[b, j] / T[b, j]
        if kelvin:
            d0[b] = 1.0 / rate
        else:
            weights[n] = D[b]
        Y[b] = 1.0 / total
        for i in range(n):
            tau[b, i], slope = _root(poles, weights, i, i + 1, 0.0)
            k[b, i] = 1.0 / (tau[b, i] * tau[b, i] * slope)
    return Y, k, tau, d0


@_jit
def seen_to_maxwell(v, kelvin):
    """Rows (B, d) of log D, log c_1/T_1, log c_2 .. c_n, log T_1 .. T_n to log Y, log k_1 .. k_n, log tau_1 .. tau_n.

    kelvin: GKM, without log D and with n + 1 modes; log d0 comes last. nan for modes that are unordered or absurd.
    """
    first = 0 if kelvin else 1
    m = (v.shape[1] - first) // 2
    out = np.empty(v.shape)
    D, c, T = np.zeros(1), np.empty((1, m)), np.empty((1, m))
    for b in range(v.shape[0]):
        good = True
        for i in range(v.shape[1]):
            out[b, i] = np.nan
            good = good and abs(v[b, i]) < 200.0  # not where nan, either
        for j in range(1, m):
            good = good and v[b, first + m + j] < v[b, first + m + j - 1] - 1e-9
        if not good:
            continue
        if not kelvin:
            D[0] = np.exp(v[b, 0])
        for j in range(m):
            log_T = v[b, first + m + j]
            T[0, j] = np.exp(log_T)
            c[0, j] = np.exp(v[b, first + j] + (log_T if j == 0 else 0.0))
        Y, k, tau, d0 = modes_to_maxwell(D, c, T)
        n = k.shape[1]
        out[b, 0] = np.log(Y[0])
        for i in range(n):
            out[b, 1 + i] = np.log(k[0, i])
            out[b, 1 + n + i] = np.log(tau[0, i])
        if kelvin:
            out[b, 1 + 2 * n] = np.log(d0[0])
    return out


@_jit
def process_to_modes(Kp, Tz, Tp):
    """PZ3 (Eq. 13 of the reference paper): Kp (1 + Tz p)/prod(1 + Tp_i p) to c (B, 3), T (B, 3), dimensionless c."""
    B, m = Tp.shape
    c = np.empty((B, m))
    for b in range(B):
        for j in range(m):
            r = Kp[b] * (1.0 - Tz[b] / Tp[b, j])
            for i in range(m):
                if i != j:
                    r /= 1.0 - Tp[b, i] / Tp[b, j]
            c[b, j] = r
    return c, Tp


def gm_to_gkv(Y: float, k: NDArray, tau: NDArray) -> tuple[float, NDArray, NDArray]:
    """GM(n) with spring to the GKV(n) with spring that is the same function: (Y0, k_i, tau_i) -> (k_0, k_i, tau_i).

    Units Pa and s; returns the instantaneous spring, the Kelvin-Voigt springs and retardation times, longest first.
    """
    D, c, T = maxwell_to_modes(np.array([float(Y)]), np.atleast_2d(np.asarray(k, float)),
                               np.atleast_2d(np.asarray(tau, float)), np.zeros(1))
    return 1.0 / D[0], 1.0 / c[0], T[0]


def gkv_to_gm(Y: float, k: NDArray, tau: NDArray) -> tuple[float, NDArray, NDArray]:
    """GKV(n) with spring to the GM(n) with spring that is the same function: the inverse of `gm_to_gkv`."""
    Y_inf, k_gm, tau_gm, _ = modes_to_maxwell(np.array([1.0 / float(Y)]), 1.0 / np.atleast_2d(np.asarray(k, float)),
                                              np.atleast_2d(np.asarray(tau, float)))
    return Y_inf[0], k_gm[0], tau_gm[0]

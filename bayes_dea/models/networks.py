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

import numba as nb
import numpy as np
from numpy.typing import NDArray


# division by zero, where absurd parameters coincide, gives inf or nan: the caller turns both into -inf
_jit = nb.njit(cache=True, error_model="numpy")


@_jit
def _root(low, high, weights, poles, constant, over_t, sign):
    """Root of constant - over_t/T - sum w_i/(T - p_i) on (low, high), where it rises with T for sign = +1."""
    a, b = low, high
    x = np.sqrt(a * b) if a > 0 else 0.5 * b
    for _ in range(200):
        g = constant - over_t / x
        dg = over_t / (x * x)
        for i in range(poles.size):
            q = weights[i] / (x - poles[i])
            g -= q
            dg += q / (x - poles[i])
        if sign * g > 0:
            b = x
        else:
            a = x
        step = x - g / dg
        x_new = step if a < step < b else 0.5 * (a + b)
        if abs(x_new - x) <= 1e-15 * x or b - a <= 1e-15 * b:
            return x_new
        x = x_new
    return x


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
    for b in range(B):
        w = k[b] * tau[b]
        total = Y[b] + k[b].sum()
        if not kelvin:
            D[b] = 1.0 / total
        for j in range(m):
            low = tau[b, j] if j < n else 0.0
            if j == 0:
                # beyond this T every term is smaller than its share of Y
                high = tau[b, 0] + (w.sum() + d0[b]) / Y[b] * 1.0000001 if n > 0 else d0[b] / Y[b] * 1.0000001
            else:
                high = tau[b, j - 1]
            T[b, j] = _root(low, high, w, tau[b], Y[b], d0[b], 1.0)
            slope = d0[b] / (T[b, j] * T[b, j])
            for i in range(n):
                slope += w[i] / (T[b, j] - tau[b, i]) ** 2
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
    for b in range(B):
        w = c[b] * T[b]
        total = D[b] + c[b].sum()
        Y[b] = 1.0 / total
        if kelvin:
            d0[b] = 1.0 / (c[b] / T[b]).sum()
        for i in range(n):
            # D + sum c_j x/(x - T_j) = total + sum c_j T_j/(x - T_j) falls from +inf to -inf between the T_j
            low = T[b, i + 1] if i + 1 < m else 0.0
            tau[b, i] = _root(low, T[b, i], -w, T[b], total, 0.0, -1.0)
            s = 0.0
            for j in range(m):
                s += w[j] / (tau[b, i] - T[b, j]) ** 2
            k[b, i] = 1.0 / (tau[b, i] * s)
    return Y, k, tau, d0


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

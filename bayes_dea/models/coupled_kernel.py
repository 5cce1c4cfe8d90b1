"""A linear network behind a resistance: strain under a stress that the strain's own current changes.

The network's modes answer the stress exactly, however quick they are. Within a step the dielectric charges like a line
and exp(-z t/h), its stress like a line, that and its square; a mode that is slow beside the step sees no more of this
than the mean and the end. What the strain does to the circuit (`circuit_kernel`) is weak, strains being a few per cent,
so that Newton's method on the strain at the end of the step needs an evaluation or two.

Numba keeps compiled code by the date of this file alone: after an edit of `circuit_kernel.py` touch this one.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .circuit_kernel import charge, inline, leaking, shorter, stored, straight

_jit = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})

#: a Newton step of this strain is the last: what is left is about a hundredth of it
_TOLERANCE = 1e-5
_SMALL = 3e-4  # a longer step (strain) is no smooth motion
_CIRCUIT_TOLERANCE = 1e-6  # strain error allowed for the current of a motion within a step
_QUICK = 0.03  # a step of so many time constants of a mode is more to it than a mean and an end
# share of the voltage by which an activated leak may be linearised beside the middle of a step, and least of it (V)
_CENTRED, _LITTLE_V = 0.01, 0.1
_MAX_ITERATIONS = 40
#: steps tried on average for each one asked for; beyond, there is no answer
_TRIES_A_STEP = 30


@_jit
def _coefficients(h, c, T, keep, w0, w1):
    """What stays of each mode after a step of h (s), weights of the stress's start and end; sums of the weights."""
    s0 = s1 = 0.0
    for j in range(T.size):
        z = h / T[j]
        small = z < 1e-4
        m = 1.0 - z * (0.5 - z / 6.0) if small else -math.expm1(-z) / z
        keep[j] = 1.0 - z * m
        w1[j] = c[j] * z * (0.5 - z / 6.0) if small else c[j] * (1.0 - m)
        w0[j] = c[j] * z * m - w1[j]
        s0 += w0[j]
        s1 += w1[j]
    return s0, s1


@inline
def _dying(z, keep, x, left):
    """What a mode of z time constants in a step has at its end of exp(-x t/h), which has `left` left there then."""
    d = z - x
    if abs(d) < 1e-3:
        return left * z * (1.0 - d * (0.5 - d / 6.0))
    return z * (left - keep) / d


@_jit
def coupled(h, u0, u1, D, c, T, factor, chi, tau_d, rs, leak, c0, active, thickness, aq, tau_q, out):
    """Strain (m,) after steps of h (m,) s, the supply straight from u0 to u1 (m,) V within each; rested before.

    D 1/Pa, c, T (K,): modes of the network (1/Pa, s); factor Pa/V^2, chi and tau_d (s) of the
    polarisation; rs, leak ohm, c0 F, active V/m, thickness m; aq, tau_q (s) of the stored charge. Returns the number of
    steps tried. nan from where there is no balance of forces.
    """
    K = T.size
    f, new = np.zeros(K), np.zeros(K)
    # coefficients of two lengths of step, which often take turns
    keep, w0, w1 = np.empty((2, K)), np.empty((2, K)), np.empty((2, K))
    known, sums = np.full(2, -1.0), np.zeros((2, 2))
    lag_q, lag_p = np.zeros((2, 3)), np.zeros((2, 3))
    now, quick = 0, 0
    # slow modes first
    order = np.argsort(-T)
    c, T = c[order], T[order]
    e, V, vq, P = 0.0, 0.0, 0.0, 0.0
    stores = chi != 0.0 or aq != 0.0
    D1, D2, step1 = 0.0, 0.0, -1.0
    rl, lift, bend, middle = leak, 0.0, 0.0, 0.0
    tried, budget = 0, _TRIES_A_STEP * h.size + 20_000
    for i in range(h.size):
        whole, done = h[i], 0.0
        step = whole
        v_start, v_end = u0[i], u1[i]
        while True:
            tried += 1
            if tried > budget:  # too stiff to be worth following
                e = math.nan
                break
            if step != known[now]:
                now = 1 - now
                if step != known[now]:
                    known[now] = step
                    sums[now, 0], sums[now, 1] = _coefficients(step, c, T, keep[now], w0[now], w1[now])
                    if stores:
                        lag_q[now] = straight(step / tau_q)
                        lag_p[now] = straight(step / tau_d)
                quick = K
                while quick > 0 and step > _QUICK * T[quick - 1]:
                    quick -= 1
            if done > 0.0 or step < whole:
                rise = (u1[i] - u0[i]) / whole
                v_start, v_end = u0[i] + rise * done, u0[i] + rise * (done + step)
            kept = 0.0
            for j in range(K):
                kept += keep[now, j] * f[j]
            W1 = D + sums[now, 1]
            # smooth motion goes on as it did
            change = 2.0 * D1 - D2 if step == step1 else 0.0
            e1 = e + (change if abs(change) < _SMALL else 0.0)
            v1, vm, vq1, P1 = V, V + 0.5 * (v_end - v_start), vq, P
            good, centred = False, True
            for _ in range(_MAX_ITERATIONS):
                if active > 0.0:
                    middle = vm
                    rl, lift, bend = leaking(leak, active, thickness, rs, middle)
                v1, vm, v2, dv, z, transient, l0, l1 = charge(rs, rl, c0, 0.0, factor * W1, step, e, e1, V,
                                                              v_start + lift, v_end + lift)
                if active > 0.0:
                    centred = abs(vm - middle) <= _CENTRED * abs(vm) + _LITTLE_V
                if stores:
                    vq1, P1, ss, se, dse = stored(lag_q[now], lag_p[now], factor, aq, chi, v1, vm, v2, dv, vq, P)
                else:
                    se = factor * v1 * v1
                    ss = 2.0 * factor * v2 - se
                    dse = 2.0 * factor * v1 * dv
                found = kept + D * se
                # the dying part, and the line beside it
                a = first = second = line0 = line1 = 0.0
                if quick < K and transient != 0.0:
                    a = math.exp(-z)
                    p1 = (1.0 - a) / z
                    level = l0 + l1 * (p1 - a) / (z * p1) - 0.5 * (vq + vq1)
                    first = factor * (2.0 * level + 0.5 * (P + P1)) * transient
                    second = factor * transient * transient
                    line1 = se - first * a - second * a * a
                    line0 = ss + se - 2.0 * first * p1 - second * p1 * (1.0 + a) - line1
                for j in range(K):
                    if j < quick or a == 0.0:
                        new[j] = w0[now, j] * ss + w1[now, j] * se
                    else:
                        y, stays = step / T[j], keep[now, j]
                        new[j] = (w0[now, j] * line0 + w1[now, j] * line1
                                  + c[j] * (first * _dying(y, stays, z, a) + second * _dying(y, stays, 2.0 * z, a * a)))
                    found += new[j]
                change = (found - e1) / (1.0 - W1 * dse)
                e1 += change
                if abs(change) < _TOLERANCE and centred:
                    good = True
                    v1 += dv * change
                    break
                if not -5.0 < e1 < 0.95:
                    break
            if not good or math.isnan(e1):
                e = math.nan
                break
            moved, grow = e1 - e, 2.0
            if abs(moved) > _SMALL and step > 1e-6 * whole:
                # what moves early in the step was taken to first order, at an even voltage
                x = step / (rs * c0)
                wrong = 2.0 * abs(moved * e1) * x * max(x, 1.0) / (1.0 + x * x * x)
                wrong *= min(1.0, 4.0 * abs(v1 - V) / max(abs(v1), abs(V)) + 4.0 * abs(moved))
                if wrong > _CIRCUIT_TOLERANCE:
                    # a step of several time constants says nothing about one within the first
                    third = 1.0 / 3.0
                    step = min(0.5 * step, rs * c0) if x > 1.0 else step * shorter(_CIRCUIT_TOLERANCE / wrong, third)
                    continue
                if 8.0 * wrong > _CIRCUIT_TOLERANCE:
                    grow = min(grow, 0.9 * (_CIRCUIT_TOLERANCE / wrong) ** (1.0 / 3.0))
            if active > 0.0 and step > 1e-6 * whole:
                # the tangent at the middle, and the current bent beside it
                x = step / (rs * c0)
                far = (v1 - V) / max(abs(v1), abs(V), 1e-9)
                wrong = 0.1 * abs(e1) * rs / (rs + rl) * bend * far * far * min(1.0, x)
                if wrong > _CIRCUIT_TOLERANCE:
                    step *= shorter(_CIRCUIT_TOLERANCE / wrong, 0.5)
                    continue
                if 4.0 * wrong > _CIRCUIT_TOLERANCE:
                    grow = min(grow, 0.9 * math.sqrt(_CIRCUIT_TOLERANCE / wrong))
            for j in range(K):
                f[j] = keep[now, j] * f[j] + new[j]
            e, V, vq, P = e1, v1, vq1, P1
            D2, D1, step1 = D1 if step == step1 else moved, moved, step
            done += step
            if done >= whole * (1.0 - 1e-12):
                break
            step = min(grow * step, whole - done)
        out[i] = e
        if math.isnan(e):
            out[i:] = math.nan
            break
    return tried

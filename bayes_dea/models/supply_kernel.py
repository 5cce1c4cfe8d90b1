"""What a supply makes of a command, and what a sensor makes of a displacement: compiled, node after node."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

#: a ramp is cut into lines of at most so many volts, because the stress along it is the square
_RAMP_V = 100.0

_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def _limited(v, dead, top):
    size = min(max(abs(v) - dead, 0.0), top)
    return size if v >= 0.0 else -size


@_jit
def supply(h, volts, linear, dead, top, slew, tau_fall, H, u0, u1, last):
    """Supply voltage (V) as straight lines u0 -> u1 of duration H (s); returns how many there are.

    Dead zone and saturation act on the command, then the slew rate limits every change and the fall time constant
    those towards smaller magnitude. volts (m,): held during the step h (m,) s that ends at a node, or straight between
    nodes. last (m,): the line that ends at each node. A ramp that ends within a step, or a fall that is curved there,
    is cut; each line has its end and its mean right. With arrays of size 0 the lines are only counted.
    """
    v = 0.0
    slew = min(slew, 1e15)  # infinity times no time is no number
    count = 0
    write = H.size > 0
    for i in range(h.size):
        goal = _limited(volts[i], dead, top)
        start = _limited(volts[i - 1], dead, top) if linear and i > 0 else goal
        if slew >= 1e15 and tau_fall == 0.0:
            if write:
                H[count], u0[count], u1[count] = h[i], start, goal
            count += 1
            v = goal
        elif linear and tau_fall == 0.0:
            end = goal if slew * h[i] >= abs(goal - v) else v + math.copysign(slew * h[i], goal - v)
            if write:
                H[count], u0[count], u1[count] = h[i], v, end
            count += 1
            v = end
        else:
            # a straight command is taken as held at its middle
            aim, left = 0.5 * (start + goal), h[i]
            least = 1e-7 * h[i]  # what is shorter than this happens at once
            while True:
                gap = aim - v
                falling = tau_fall > 0.0 and abs(aim) < abs(v) and aim * v >= 0.0
                rest = abs(gap) - slew * tau_fall if falling else abs(gap)
                if rest > slew * least:
                    # as fast as the current lets it
                    time = rest / slew
                    step = min(left, time, _RAMP_V / slew)
                    change = math.copysign(rest if step == time else slew * step, gap)
                    end, mean = v + change, v + 0.5 * change
                elif falling:
                    step = left
                    if abs(gap) > 0.3 and abs(gap) * (left / tau_fall) ** 2 > 8.0:
                        # a straight line would miss the course by more than a volt
                        step = min(left, 0.25 * tau_fall)
                    z = step / tau_fall
                    end = aim - gap * math.exp(-z)
                    mean = aim - gap * (1.0 - 0.5 * z if z < 1e-6 else -math.expm1(-z) / z)
                else:
                    step, end, mean = left, aim, aim
                if write:
                    H[count], u0[count], u1[count] = step, 2.0 * mean - end, end
                count += 1
                v = end
                left -= step
                if left <= least:
                    break
        if write:
            last[i] = count - 1
    return count


@_jit
def drive_lags(h, factor, rs, leak, c0, active, thickness, aq, tau_q, chi, tau_d, u0, u1, start, end):
    """Maxwell stress of each step as a straight line start -> end (Pa), without any stretch in it.

    The circuit has the constant capacitance c0: for models that know no strain.
    """
    v, vq, p = 0.0, 0.0, 0.0
    if rs == 0.0 and aq == 0.0 and chi == 0.0:
        for i in range(h.size):
            end[i] = factor * u1[i] * u1[i]
            start[i] = 2.0 / 3.0 * factor * (u0[i] * (u0[i] + u1[i]) + u1[i] * u1[i]) - end[i]
        return
    for i in range(h.size):
        a0, a1 = u0[i], u1[i]
        if rs > 0.0:
            rl = leak
            if active > 0.0:
                rl *= math.exp(-math.sqrt(abs(v) / thickness / active))
            feed = h[i] / (rs * c0)
            z = feed + h[i] / (rl * c0)
            if z < 1e-3:
                p1 = 1.0 - z * (0.5 - z / 6.0)
                p2 = 0.5 - z * (1.0 / 6.0 - z / 24.0)
                p3 = 1.0 / 6.0 - z / 24.0
            else:
                p1 = -math.expm1(-z) / z
                p2 = (1.0 - p1) / z
                p3 = (0.5 - p2) / z
            new = (1.0 - z * p1) * v + feed * (a0 * p1 + (a1 - a0) * p2)
            mean = p1 * v + feed * (a0 * p2 + (a1 - a0) * p3)
            a0, a1 = 2.0 * mean - new, new
        v = a1
        q0, p0 = vq, p
        if aq != 0.0:
            vq = _answer(h[i] / tau_q, vq, aq * a0, aq * a1)
        if chi != 0.0:
            p = _answer(h[i] / tau_d, p, chi * (a0 - q0), chi * (a1 - vq))
        w0, w1 = a0 - q0, a1 - vq
        end[i] = factor * (w1 + p) * w1
        mean2 = factor * ((w0 * w0 + w0 * w1 + w1 * w1) / 3.0 + 0.25 * (p0 + p) * (w0 + w1))
        start[i] = 2.0 * mean2 - end[i]


@_jit
def _answer(z, y, x0, x1):
    """First-order lag after a step of z time constants with a straight input."""
    if z < 1e-4:
        return y + z * (0.5 * (x0 + x1) - y)
    a = math.exp(-z)
    m = (1.0 - a) / z
    return a * y + (m - a) * x0 + (1.0 - m) * x1


@_jit
def network(h, start, end, D, c, T, out):
    """Strain (m,) of a network in modes under the stress start -> end (m,) Pa of each step; at rest before.

    D 1/Pa, c (K,) 1/Pa, T (K,) s, as in `networks`. Exact for a stress that is straight within each step.
    """
    K = T.size
    f, keep, w0, w1 = np.zeros(K), np.zeros(K), np.zeros(K), np.zeros(K)
    known = -1.0
    for i in range(h.size):
        if h[i] != known:
            known = h[i]
            for j in range(K):
                z = known / T[j]
                m = 1.0 - z * (0.5 - z / 6.0) if z < 1e-4 else -math.expm1(-z) / z
                keep[j] = 1.0 - z * m
                # states carry their coefficient, so that one sum is left
                w1[j] = c[j] * (1.0 - m) if z >= 1e-4 else c[j] * z * (0.5 - z / 6.0)
                w0[j] = c[j] * z * m - w1[j]
        s0, s1 = start[i], end[i]
        e = D * s1
        for j in range(K):
            x = keep[j] * f[j] + (w0[j] * s0 + w1[j] * s1)
            f[j] = x
            e += x
        out[i] = e


@_jit
def swinging(h, start, end, c, T, out):
    """Strain (m,) of a mass on a network in modes c (K,) 1/Pa, T (K,) s, complex in pairs; otherwise as `network`."""
    K = T.size
    f, keep = np.zeros(K, dtype=np.complex128), np.zeros(K, dtype=np.complex128)
    w0, w1 = np.zeros(K, dtype=np.complex128), np.zeros(K, dtype=np.complex128)
    known = -1.0
    for i in range(h.size):
        if h[i] != known:
            known = h[i]
            for j in range(K):
                z = known / T[j]
                small = abs(z) < 1e-4
                m = 1.0 - z * (0.5 - z / 6.0) if small else (1.0 - np.exp(-z)) / z
                keep[j] = 1.0 - z * m
                w1[j] = c[j] * z * (0.5 - z / 6.0) if small else c[j] * (1.0 - m)
                w0[j] = c[j] * z * m - w1[j]
        e = 0.0
        for j in range(K):
            x = keep[j] * f[j] + (w0[j] * start[i] + w1[j] * end[i])
            f[j] = x
            e += x.real
        out[i] = e


@_jit
def delayed(time, y, delay, out):
    """y (m,) shifted by `delay` (s), straight between nodes; the first value stands for what was before."""
    k = 0
    m = time.size
    for i in range(m):
        t = time[i] - delay
        if t <= time[0]:
            out[i] = y[0]
            continue
        while k + 1 < m and time[k + 1] < t:
            k += 1
        out[i] = y[k] + (y[k + 1] - y[k]) * (t - time[k]) / (time[k + 1] - time[k])


@_jit
def lagged(h, rows, y, tau, out):
    """First-order lag of an input that is held from row to row (each at the value of the row that ends it).

    rows (m,): rows from node to node; between nodes the rows lie on a straight line.
    """
    v = y[0]
    out[0] = v
    known, n0 = -1.0, -1
    a = an = ramp = 0.0
    for i in range(1, h.size):
        n = rows[i]
        if h[i] != known or n != n0:
            known, n0 = h[i], n
            a = math.exp(-h[i] / n / tau)
            an = math.exp(-h[i] / tau)
            ramp = n + a * math.expm1(-h[i] / tau) / -math.expm1(-h[i] / n / tau)
        slope = (y[i] - y[i - 1]) / n
        v = an * v + (1.0 - an) * y[i - 1] + slope * ramp
        out[i] = v

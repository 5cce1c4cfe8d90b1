"""What a supply makes of a command, and what a sensor makes of a displacement: compiled, node after node."""

from __future__ import annotations

import math

import numpy as np

from ..compiled import njit
from .circuit_kernel import decayed, inline, leaking, place

#: a ramp is cut into lines of at most so many volts, because the stress along it is the square
_RAMP_V = 100.0
#: by how much one line may miss a ramp that is over soon, and a fall that goes on
_MISSED_V, _CURVED_V = 1.0, 0.25

#: pieces of a step in which an activated leak charges, and share of the voltage by which it then changes
_PIECES, _FAR = 24, 0.05

#: lengths of steps of which coefficients are kept; a power of two
_KEPT = 64

#: difference of two lengths, in time constants, up to which the decay over one follows from that over the other
_NEARLY = 1e-2

_jit = njit(cache=True, error_model="numpy", nogil=True)


@inline
def _limited(v, dead, top):
    size = min(max(abs(v) - dead, 0.0), top)
    return size if v >= 0.0 else -size


# What is called within a step takes numbers and gives numbers: handing on an array costs more than a whole step,
# because its references are counted.


@_jit
def supply(h, c0, c1, rows, dead, top, slew, tau_fall, H, u0, u1, last, before=0.0):
    """Supply voltage (V) as straight lines u0 -> u1 of duration H (s); returns how many there are.

    Dead zone and saturation act on the command, then the slew rate limits every change and the fall time constant
    those towards smaller magnitude. The command is straight from c0 to c1 (m,) during the step h (m,) s that ends at a
    node; where it is not followed smoothly it is taken as held at the middle of each of the step's rows (m,). last
    (m,): the line that ends at each node. What is quicker than a step, or curved in it, is cut; each line has its end
    and its mean right (but for a straight command that the slew rate holds up, which is caught up with along a line).
    Where H, u0 and u1 are too short nothing but the number is right: call again with as many. before: its voltage (V)
    at the start.
    """
    v = 1.0 * before
    slew = min(slew, 1e15)  # infinity times no time is no number
    instant = slew >= 1e15 and tau_fall == 0.0
    room, count = H.size, 0
    for i in range(h.size):
        a, b = c0[i], c1[i]
        share = 0.0
        while share < 1.0:
            # to where a limit begins or ends, straight parts of what these leave of a straight command
            until = _next_kink(a, b, dead, top, share)
            part = (until - share) * h[i]
            start = _limited(a + share * (b - a), dead, top)
            goal = _limited(a + until * (b - a), dead, top)
            smooth = instant or (a == b and v == goal)
            if smooth:
                begin, end = start, goal
            elif a != b:
                smooth, begin, end = _followed(part, v, start, goal, slew, tau_fall)
            if smooth:
                if count < room:
                    H[count], u0[count], u1[count] = part, begin, end
                count += 1
                v = end
            else:
                few = 1 if a == b else max(1, round((until - share) * rows[i]))
                each = part / few
                least = 1e-7 * each  # what is shorter than this happens at once
                for k in range(few):
                    aim = start + (k + 0.5) / few * (goal - start)
                    left = each
                    while True:
                        step, begin, end = _held(left, least, v, aim, slew, tau_fall)
                        if count < room:
                            H[count], u0[count], u1[count] = step, begin, end
                        count += 1
                        v = end
                        left -= step
                        if left <= least:
                            break
            share = until
        last[i] = count - 1
    return count


@inline
def _next_kink(a, b, dead, top, share):
    """Share of a line from a to b (V) at which the next limit begins or ends; 1 where none does."""
    until = 1.0
    if a != b:
        low, high, up = min(a, b), max(a, b), (1.0 if b > a else -1.0)
        for level in (-dead - top, -dead, dead, dead + top):
            if low < level < high and (dead > 0.0 or level != 0.0):
                at = up * (level - a) / (high - low)
                if share < at < until:
                    until = at
    return until


@inline
def _held(left, least, v, aim, slew, tau_fall):
    """The next line from v towards a goal that is held for as long as is `left` (s): its length, start and end."""
    gap = aim - v
    falling = tau_fall > 0.0 and abs(aim) < abs(v) and aim * v >= 0.0
    rest = abs(gap) - slew * tau_fall if falling else abs(gap)
    if rest > slew * least:
        # as fast as the current lets it
        time = rest / slew
        if not falling and time <= left and rest * time < _MISSED_V * left:
            # a ramp that is over soon: by its mean
            return left, aim - gap * time / left, aim
        step = min(left, time, _RAMP_V / slew)
        change = math.copysign(rest if step == time else slew * step, gap)
        end, mean = v + change, v + 0.5 * change
    elif falling:
        step = left
        if abs(gap) * min(left / tau_fall, 1.0) ** 2 > 8.0 * _CURVED_V:
            # what is behind a resistance sees the slope of the course
            step = min(left, tau_fall * math.sqrt(8.0 * _CURVED_V / abs(gap)))
        z = step / tau_fall
        end = aim - gap * math.exp(-z)
        mean = aim - gap * (1.0 - 0.5 * z if z < 1e-6 else -math.expm1(-z) / z)
    else:
        step, end, mean = left, aim, aim
    return step, 2.0 * mean - end, end


@inline
def _followed(h, v, start, goal, slew, tau_fall):
    """From v along a goal that goes straight from `start` to `goal` in h (s): whether one line does it, its start and
    its end."""
    gap, rise = start - v, (goal - start) / h
    if tau_fall > 0.0 and goal * v >= 0.0 and abs(goal) < abs(v) and abs(goal) <= abs(start) <= abs(v):
        z = h / tau_fall
        # the part of the gap that dies out; the rest goes along
        dying = gap - rise * tau_fall
        if abs(gap) <= slew * tau_fall and abs(rise) <= slew and abs(dying) * min(z * z, 1.0) <= 8.0 * _CURVED_V:
            decay = math.expm1(-z)
            end = goal - rise * tau_fall - dying * (1.0 + decay)
            mean = 0.5 * (start + goal) - rise * tau_fall + dying * (decay / z if z > 1e-6 else 0.5 * z - 1.0)
            return True, 2.0 * mean - end, end
    elif tau_fall == 0.0 or (abs(goal) >= abs(start) >= abs(v) and goal * start >= 0.0 and start * v >= 0.0):
        if abs(goal - v) > slew * h:
            return True, v, v + math.copysign(slew * h, goal - v)
        lost = gap * min(abs(gap) / slew, h) / h
        # what is caught up soon is known by its mean
        return True, (start - lost if abs(lost) < _MISSED_V else v), goal
    return False, v, v


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
            # an activated leak is followed in pieces while it charges
            pieces = _PIECES if active > 0.0 and abs(a1 - v) > _FAR * abs(a1) else 1
            total, h1 = 0.0, h[i] / pieces
            for k in range(pieces):
                b0, b1 = a0 + (a1 - a0) * k / pieces, a0 + (a1 - a0) * (k + 1) / pieces
                new, mean = _charged(h1, rs, leak, c0, active, thickness, b0, b1, v)
                total += mean / pieces
                v = new
            a0, a1 = 2.0 * total - v, v
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


@inline
def _charged(h, rs, leak, c0, active, thickness, u0, u1, v):
    """Volts on a constant capacitance after h (s) under a supply straight from u0 to u1 (V), and their mean."""
    conducts, lift, middle = 1.0 / leak, 0.0, v + 0.5 * (u1 - u0)
    new = mean = v
    for _ in range(3 if active > 0.0 else 1):
        if active > 0.0:
            conducts, lift, _bend = leaking(leak, active, thickness, rs, middle)
        feed = h / (rs * c0)
        z = feed + h * conducts / c0
        if z < 1e-3:
            p1 = 1.0 - z * (0.5 - z / 6.0)
            p2 = 0.5 - z * (1.0 / 6.0 - z / 24.0)
            p3 = 1.0 / 6.0 - z / 24.0
        else:
            p1 = -math.expm1(-z) / z
            p2 = (1.0 - p1) / z
            p3 = (0.5 - p2) / z
        new = (1.0 - z * p1) * v + feed * ((u0 + lift) * p1 + (u1 - u0) * p2)
        mean = p1 * v + feed * ((u0 + lift) * p2 + (u1 - u0) * p3)
        middle = mean
    return new, mean


@inline
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
    length, kept = np.full(_KEPT, -1.0), np.empty((_KEPT, 3, K))
    known = -1.0
    for i in range(h.size):
        if h[i] != known:
            known = h[i]
            k = place(known, _KEPT)
            if length[k] != known:
                length[k] = known
                for j in range(K):
                    z = known / T[j]
                    m = 1.0 - z * (0.5 - z / 6.0) if z < 1e-4 else -math.expm1(-z) / z
                    kept[k, 0, j] = 1.0 - z * m
                    # states carry their coefficient, so that one sum is left
                    kept[k, 2, j] = c[j] * (1.0 - m) if z >= 1e-4 else c[j] * z * (0.5 - z / 6.0)
                    kept[k, 1, j] = c[j] * z * m - kept[k, 2, j]
            for j in range(K):
                keep[j], w0[j], w1[j] = kept[k, 0, j], kept[k, 1, j], kept[k, 2, j]
        s0, s1 = start[i], end[i]
        e = D * s1
        for j in range(K):
            x = keep[j] * f[j] + (w0[j] * s0 + w1[j] * s1)
            f[j] = x
            e += x
        out[i] = e


@_jit
def swinging(h, start, end, c, T, out):
    """Strain (m,) of a mass on a network in modes c (K,) 1/Pa, T (K,) s, complex in pairs; otherwise as `network`.

    Of a pair one is followed. Where stamps tremble every step is of another length: what stays of a mode after it is
    worked out from what stays after one that is nearly as long.
    """
    K = 0
    tau, weight, f = np.empty_like(T), np.empty_like(T), np.zeros_like(T)
    rate, size = np.empty_like(T), np.empty(T.size)
    for j in range(T.size):
        if not T[j].imag < 0.0:  # what is no number stays in
            tau[K], rate[K], size[K] = T[j], 1.0 / T[j], 1.0 / abs(T[j])
            weight[K] = 2.0 * c[j] if T[j].imag > 0.0 else c[j]
            K += 1
    length, kept = np.full(_KEPT, -1.0), np.empty((_KEPT, 3, K), dtype=np.complex128)
    known, k = -1.0, 0
    for i in range(h.size):
        if h[i] != known:
            known = h[i]
            k = place(known, _KEPT)
            if length[k] != known:
                per = 1.0 / known
                longer = known - length[k] if length[k] > 0.0 else math.inf
                length[k] = known
                for j in range(K):
                    z = known * rate[j]
                    if known * size[j] < 1e-4:
                        m, rest = 1.0 - z * (0.5 - z / 6.0), z * (0.5 - z / 6.0)
                        kept[k, 0, j] = 1.0 - z * m
                    else:
                        if abs(longer) * size[j] < _NEARLY:
                            kept[k, 0, j] *= decayed(longer * rate[j])
                        else:
                            kept[k, 0, j] = np.exp(-z)
                        m = (1.0 - kept[k, 0, j]) * tau[j] * per
                        rest = 1.0 - m
                    kept[k, 2, j] = weight[j] * rest
                    kept[k, 1, j] = weight[j] * (m - kept[k, 0, j])
        e = 0.0
        for j in range(K):
            x = kept[k, 0, j] * f[j] + (kept[k, 1, j] * start[i] + kept[k, 2, j] * end[i])
            f[j] = x
            e += x.real
        out[i] = e


@_jit
def delayed(time, y, delay, out):
    """y (m,) shifted by `delay` (s), straight between nodes; negative: what comes is read early.

    The first value stands for what was before, the last one for what comes after.
    """
    k = 0
    m = time.size
    for i in range(m):
        t = time[i] - delay
        if t <= time[0]:
            out[i] = y[0]
            continue
        if t >= time[m - 1]:
            out[i] = y[m - 1]
            continue
        while k + 1 < m and time[k + 1] < t:
            k += 1
        out[i] = y[k] + (y[k + 1] - y[k]) * (t - time[k]) / (time[k + 1] - time[k])


@_jit
def played(y, half, start, out):
    """What follows y (m,) with a play of `half` either way, from `start` on."""
    shown = start
    for i in range(y.size):
        shown = min(y[i] + half, max(y[i] - half, shown))
        out[i] = shown


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

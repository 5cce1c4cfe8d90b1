"""The command for a wanted stroke, row after row, within the limits of the actuator.

A row's input is found from what it must add to the memory of the rows before: one division for a linear network, one
scalar equation for another law. Where the limits forbid it the nearest allowed input is taken and the memory goes on
from what that really does. Inputs are squared voltages V^2 >= 0: the actuator pushes only one way.

Limits: 0 <= V <= largest; the steepest slope is that of a sine of full range at the highest frequency, pi f V_max; and
the command turns round (by more than half a per cent of the range) only once every 1/(2 f). Bounds on V, slope and
turns are causal: a row knows the rows before it only.

A network without an instantaneous part and two poles more than zeros (pz3, ss3) cannot be inverted at every row
without ringing: its sampled form has a zero near -1 (Astrom, Hagander, Sternby 1984, doi
10.1016/0005-1098(84)90062-1). There `follow` finds the smoothest command; where the wish is out of reach for long, it
is passed backwards through the fastest lag first and followed row after row, approximately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from ..models.chain import Material
from ..models.lags import Drive, _weights
from ..models.stress_kernel import stress_driven_kernel

Array = NDArray[np.float64]
#: why a row is not what was asked for
MET, ABOVE, NEGATIVE, FAST = range(4)
#: turns smaller than this share of the range are no turns
_TURN = 0.005


@dataclass(frozen=True)
class Limits:
    """Largest voltage (V) and highest frequency (Hz; 0: none stated)."""

    voltage_V: float
    frequency_Hz: float


@dataclass(frozen=True)
class Inverted:
    """voltage (n,) V in force at each row; flag (n,) MET, ABOVE, NEGATIVE or FAST."""

    voltage: Array
    flag: NDArray[np.int8]


@njit(cache=True, nogil=True)
def _allowed(v, t, step, top, frequency, memory):
    """The nearest allowed voltage and whether speed forbade `v`. memory: last V, direction, extreme, time of turn."""
    fast = False
    out = min(max(v, 0.0), top)
    if frequency > 0.0:
        most = np.pi * frequency * top * step
        low, high = memory[0] - most, memory[0] + most
        band = _TURN * top
        if t - memory[3] < 0.5 / frequency - 1.001 * step:
            # too early for another turn
            if memory[1] > 0.0:
                low = max(low, memory[2] - 0.999 * band)
            elif memory[1] < 0.0:
                high = min(high, memory[2] + 0.999 * band)
        bounded = min(max(out, low), high)
        fast = abs(bounded - out) > 1e-9 * top
        out = min(max(bounded, 0.0), top)
        if memory[1] == 0.0:
            if abs(out - memory[2]) > band:
                memory[1] = 1.0 if out > memory[2] else -1.0
                memory[2] = out
        elif (memory[2] - out) * memory[1] > band:
            memory[1], memory[2], memory[3] = -memory[1], out, t
        elif (out - memory[2]) * memory[1] > 0.0:
            memory[2] = out
    memory[0] = out
    return out, fast


@njit(cache=True, nogil=True)
def _flag(v, out, fast, top):
    if fast:
        return FAST
    if v > top * (1 + 1e-9):
        return ABOVE
    if v < 0.0:
        return NEGATIVE
    return MET


@njit(cache=True, nogil=True)
def _linear(
    time_s, dt, hold, factor, D, c, T, wish, top, frequency, c_slow, T_slow, T_fast, ahead, calm, voltage, flag
):
    """D 1/Pa, c and T (m,): the network that is to follow the strain `wish` (n,). With T_fast > 0 the network
    c_slow, T_slow, whose output that lag takes to the strain, follows the wish passed back through the lag: so that it
    is met at the row itself; or, where that would make the command leap, so that it is met over a while, `calm` being
    the lag's decay over that while and `ahead` (n,) the wish a little later.
    """
    m, slow = T.size, T_slow.size
    f, g = np.zeros(m), np.zeros(slow)
    a, w0, w1, w2 = np.empty(m), np.zeros(m), np.zeros(m), np.zeros(m)
    a_slow = np.empty(slow)
    a_fast = 0.0
    memory = np.array([0.0, 0.0, 0.0, -np.inf])
    last, before, strain = -1.0, 0.0, 0.0
    usual = np.median(dt[1:])
    for i in range(time_s.size):
        step = dt[i]
        if step != last:
            last = step
            for j in range(m):
                a[j] = np.exp(-step / T[j])
                w2[j] = -np.expm1(-step / T[j])
                if hold == 2 and step > 0.0:
                    a[j], w0[j], w1[j], w2[j] = _weights(step, T[j])
            for j in range(slow):
                a_slow[j] = np.exp(-step / T_slow[j])
            a_fast = np.exp(-step / T_fast) if T_fast > 0.0 else 0.0
        target = wish[i]
        free = 0.0
        if T_fast > 0.0 and step > 0.0:
            # what the slow part must put out so that the fast lag arrives at the wish
            gain = 0.0
            for j in range(slow):
                free += c_slow[j] * a_slow[j] * g[j]
                gain += c_slow[j] * (1.0 - a_slow[j])
            target = (wish[i] - a_fast * strain) / (1.0 - a_fast)
            calmly = (ahead[i] - calm * strain) / (1.0 - calm)
            here = np.sqrt(max((target - free) / (factor * gain), 0.0))
            later = np.sqrt(max((calmly - free) / (factor * gain), 0.0))
            if abs(here - later) > 0.5 * _TURN * top:
                target = calmly
            A, B, C = gain, 0.0, free
        else:
            start, middle, end = 0.0, 0.0, D
            for j in range(m):
                free += c[j] * a[j] * f[j]
                start += c[j] * w0[j]
                middle += c[j] * w1[j]
                end += c[j] * w2[j]
            # strain = end V^2 + middle ((V + V before)/2)^2 + start V before^2 + free
            A = end + 0.25 * middle
            B = 0.5 * middle * before
            C = free + factor * (start + 0.25 * middle) * before * before
        need = (target - C) / factor
        if A <= 0.0:
            v = 0.0 if need <= 1e-30 else 2.0 * top  # nothing that happens in no time can help
        elif B == 0.0:
            v = np.sqrt(need / A) if need >= 0.0 else -1.0
        else:
            inside = 0.25 * B * B + A * need
            v = (np.sqrt(inside) - 0.5 * B) / A if inside >= 0.0 else -1.0
        out, fast = _allowed(v, time_s[i], step if step > 0.0 else usual, top, frequency, memory)
        if A <= 0.0:
            out = 0.0
            memory[0] = 0.0
        flag[i] = _flag(v, out, fast, top)
        s, s_before, s_middle = factor * out * out, factor * before * before, factor * (0.5 * (out + before)) ** 2
        strain = D * s
        for j in range(m):
            f[j] = a[j] * f[j] + w0[j] * s_before + w1[j] * s_middle + w2[j] * s
            strain += c[j] * f[j]
        for j in range(slow):
            g[j] = a_slow[j] * g[j] + (1.0 - a_slow[j]) * s
        voltage[i] = out
        before = out


_LOW, _HIGH, _SEARCH, _COMMIT = range(4)


@njit(cache=True, nogil=True)
def _material(
    time_s, h, dt, factor, law_id, p, network, k, tau, d0, wish, share, top, frequency, voltage, flag
):
    """As `_linear` for any law: Illinois' method on the strain as a function of the stress of the row.

    One loop with one call of the kernel: each further place where it is called costs a minute of compilation.
    """
    state, trial = np.zeros(k.size + 1), np.zeros(k.size + 1)
    one, stress, jump, end = np.empty(1), np.empty(1), np.empty(1), np.empty(1)
    memory = np.array([0.0, 0.0, 0.0, -np.inf])
    usual = np.median(dt[1:])
    highest = factor * top * top
    guess = 0.0
    for i in range(time_s.size):
        one[0] = h[i]
        low, high, f_low, f_high = 0.0, highest, 0.0, 1.0
        phase, s, v, out, side, trips = _LOW, 0.0, 0.0, 0.0, 0, 0
        while True:
            trial[:] = state
            stress[0] = s
            stress_driven_kernel(law_id, p, network, k, tau, d0, one, stress, trial, jump, end)
            value = jump[0] + share * (end[0] - jump[0]) - wish[i]
            if phase == _COMMIT:
                state[:] = trial
                break
            found = False
            if phase == _LOW:
                f_low = value
                phase, s = _HIGH, high
                if value > 1e-12:
                    v, found = -1.0, True
            elif phase == _HIGH:
                f_high = value
                phase, s = _SEARCH, min(max(guess, low), high)
                if value < 0.0:
                    v, found = 2.0 * top, True
            elif abs(value) < 1e-12 or high - low < 1e-13 * highest or trips > 100:
                v, found = np.sqrt(s / factor), True
            else:
                if value > 0.0 or not np.isfinite(value):
                    high, f_high = s, value if np.isfinite(value) else 1.0
                    if side == 1:
                        f_low *= 0.5
                    side = 1
                else:
                    low, f_low = s, value
                    if side == -1:
                        f_high *= 0.5
                    side = -1
                trips += 1
                s = 0.5 * (low + high)
                if trips < 40 and f_high > f_low:
                    s = (low * f_high - high * f_low) / (f_high - f_low)
            if found:
                out, fast = _allowed(v, time_s[i], dt[i] if dt[i] > 0.0 else usual, top, frequency, memory)
                flag[i] = _flag(v, out, fast, top)
                phase, s = _COMMIT, factor * out * out
                guess = s
        voltage[i] = out


def invert_linear(
    time_s: Array,
    drive: Drive,
    factor: float,
    modes: tuple[float, Array, Array],
    wish: Array,
    limits: Limits,
    behind: tuple[Array, Array, float] | None = None,
) -> Inverted:
    """Voltages (n,) with which the network `modes` (D, c, T) follows the strain `wish` (n,).

    drive: steps and hold of the rows. factor: Pa per V^2. behind: (c, T) of the part before the fastest lag, and that
    lag's time constant, where the network rings otherwise.
    """
    voltage, flag = np.empty(wish.size), np.empty(wish.size, np.int8)
    c_slow, T_slow, T_fast = (np.empty(0), np.empty(0), 0.0) if behind is None else behind
    D, c, T = modes
    calm, ahead = 0.0, wish
    if T_fast > 0:
        # over a whole period of the highest frequency; the strain then follows what is wished `delay` later
        while_s = max(1.0 / limits.frequency_Hz if limits.frequency_Hz else 0.0, 5 * float(np.median(drive.dt[1:])))
        calm = float(np.exp(-while_s / T_fast))
        delay = T_fast * (1.0 - calm)
        ahead = np.interp(time_s - drive.dt + delay, time_s, wish)
    _linear(
        time_s, drive.dt, drive.hold, factor, D, c, T, wish, limits.voltage_V, limits.frequency_Hz, c_slow, T_slow,
        T_fast, ahead, calm, voltage, flag,
    )  # fmt: skip
    return Inverted(voltage, flag)


def invert_material(
    time_s: Array, drive: Drive, h: Array, factor: float, material: Material, wish: Array, limits: Limits
) -> Inverted:
    """As `invert_linear` for one draw of any law; h (n,) s: how long the stress of each row acts."""
    voltage, flag = np.empty(wish.size), np.empty(wish.size, np.int8)
    _material(
        time_s, h, drive.dt, factor, material.law_id, material.law[0], material.network, material.k[0],
        material.tau[0], float(material.d0[0]), wish, 0.5 if drive.hold == 2 else 1.0, limits.voltage_V,
        limits.frequency_Hz, voltage, flag,
    )  # fmt: skip
    return Inverted(voltage, flag)

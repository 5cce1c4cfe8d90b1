"""Small laws in discrete time: each takes a series (n,), rows step_s apart, and gives one."""

import math

import numpy as np
from numba import njit


@njit(cache=True)
def lag(x, step_s, up_s, down_s):
    """First-order lag that begins settled; time constants [s] on the way up and down."""
    y = np.empty(x.size)
    y[0] = x[0]
    up = math.exp(-step_s / up_s)
    down = math.exp(-step_s / down_s)
    for i in range(1, x.size):
        kept = up if x[i] > y[i - 1] else down
        y[i] = x[i] + (y[i - 1] - x[i]) * kept
    return y


@njit(cache=True)
def low_pass(x, step_s, up_s, down_s, start):
    """First-order lag that begins at `start` and moves with the first row already."""
    y = np.empty(x.size)
    state = start
    up = -math.expm1(-step_s / up_s)
    down = -math.expm1(-step_s / down_s)
    for i in range(x.size):
        state += (x[i] - state) * (up if x[i] > state else down)
        y[i] = state
    return y


@njit(cache=True)
def play(x, half_width):
    """Backlash, in the unit of x."""
    y = np.empty(x.size)
    y[0] = x[0]
    for i in range(1, x.size):
        y[i] = min(max(y[i - 1], x[i] - half_width), x[i] + half_width)
    return y


@njit(cache=True)
def slew(x, most):
    """No more change a row than `most`, in the unit of x."""
    y = np.empty(x.size)
    y[0] = x[0]
    for i in range(1, x.size):
        y[i] = y[i - 1] + min(max(x[i] - y[i - 1], -most), most)
    return y


@njit(cache=True)
def stick_slip(x, thresholds, share):
    """A mount that follows share * x in jumps: it sticks until what strains it exceeds the next threshold."""
    mount = 0.0
    slips = 0
    y = np.empty(x.size)
    for i in range(x.size):
        ahead = share * x[i] - mount
        if abs(ahead) > thresholds[slips % thresholds.size]:
            mount += 0.8 * ahead
            slips += 1
        y[i] = mount
    return y


@njit(cache=True)
def snap(voltage_V, on_V, off_V, step_s, tau_s):
    """From 0 to 1 above one voltage, back below another, smoothed over tau_s."""
    y = np.empty(voltage_V.size)
    target = 0.0
    state = 0.0
    gain = -math.expm1(-step_s / tau_s)
    for i in range(voltage_V.size):
        if voltage_V[i] > on_V:
            target = 1.0
        elif voltage_V[i] < off_V:
            target = 0.0
        state += (target - state) * gain
        y[i] = state
    return y


@njit(cache=True)
def second_order(frequency_Hz, zeta, step_s):
    """Transition (a11, a12, a21, a22) of the deviation of a damped mode from its target, and of its rate."""
    w = 2.0 * math.pi * frequency_Hz
    wd = w * math.sqrt(1.0 - zeta * zeta)
    decay = math.exp(-zeta * w * step_s)
    c = math.cos(wd * step_s)
    s = math.sin(wd * step_s)
    return (
        decay * (c + zeta * w / wd * s),
        decay * s / wd,
        -decay * w * w / wd * s,
        decay * (c - zeta * w / wd * s),
    )


@njit(cache=True)
def mode(x, step_s, frequency_Hz, zeta):
    """A second-order mode of gain one, exact for an input that is held."""
    a11, a12, a21, a22 = second_order(frequency_Hz, zeta, step_s)
    y = np.empty(x.size)
    state = 0.0
    rate = 0.0
    for i in range(x.size):
        off = state - x[i]
        state, rate = x[i] + a11 * off + a12 * rate, a21 * off + a22 * rate
        y[i] = state
    return y


@njit(cache=True)
def ornstein_uhlenbeck(white, step_s, tau_s):
    """White noise (n,) of unit variance made noise of the same variance that remembers for tau_s."""
    y = np.empty(white.size)
    kept = math.exp(-step_s / tau_s)
    fresh = math.sqrt(1 - kept * kept)
    state = white[0]
    for i in range(white.size):
        state = kept * state + fresh * white[i]
        y[i] = state
    return y

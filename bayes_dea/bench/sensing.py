"""What lies between the moving stack and the reading: expansion, linkage, delay, lag, distortion, drift.

Order: thermal expansion, linkage (contact, play, holder), delay, lag, distortion of the scale, drift and crosstalk.
Gain, offset, mains and noise are added afterwards (`nuisance`), clipping last of all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.effects import Effects
from bayes_dea.compiled import njit, read_only

Array = NDArray[np.float64]


@njit(cache=True)
def first_order(time_s, x, tau_s, start):  # type: ignore[no-untyped-def]
    """tau y' = x - y with x (n,) held over the interval ending at its row, exactly; y begins at `start`."""
    y = np.empty(x.size)
    state = start
    known, gain = -1.0, 0.0
    for i in range(x.size):
        step = time_s[i] - time_s[i - 1] if i > 0 else 0.0
        if step != known:
            known, gain = step, -np.expm1(-step / tau_s)
        state += (x[i] - state) * gain
        y[i] = state
    return y


@njit(cache=True)
def _high_pass(time_s, x, tau_s):  # type: ignore[no-untyped-def]
    """w' = x' - w / tau of a command x (n,) that jumps at the start of each interval."""
    w = np.empty(x.size)
    state = 0.0
    for i in range(x.size):
        step = time_s[i] - time_s[i - 1] if i > 0 else 0.0
        state = (state + (x[i] - x[i - 1] if i > 0 else 0.0)) * np.exp(-step / tau_s)
        w[i] = state
    return w


@njit(cache=True)
def _resonance(time_s, x, omega, zeta):  # type: ignore[no-untyped-def]
    """r = z - x of a mass z on a spring that x moves: z'' = -omega^2 (z - x) - 2 zeta omega (z' - x').

    x is linear between rows; classical Runge-Kutta with substeps of at most 0.05 / omega.
    """
    r = np.zeros(x.size)
    a, b = 0.0, 0.0  # z - x and its rate
    last = 0.0
    for i in range(1, x.size):
        step = time_s[i] - time_s[i - 1]
        speed = (x[i] - x[i - 1]) / step
        b -= speed - last  # the rate of x jumps, that of the mass does not
        last = speed
        steps = max(1, int(np.ceil(step * omega / 0.05)))
        h = step / steps
        for _ in range(steps):
            k1a, k1b = b, -omega * omega * a - 2.0 * zeta * omega * b
            k2a = b + 0.5 * h * k1b
            k2b = -omega * omega * (a + 0.5 * h * k1a) - 2.0 * zeta * omega * k2a
            k3a = b + 0.5 * h * k2b
            k3b = -omega * omega * (a + 0.5 * h * k2a) - 2.0 * zeta * omega * k3a
            k4a = b + h * k3b
            k4b = -omega * omega * (a + h * k3a) - 2.0 * zeta * omega * k4a
            a += h / 6.0 * (k1a + 2.0 * k2a + 2.0 * k3a + k4a)
            b += h / 6.0 * (k1b + 2.0 * k2b + 2.0 * k3b + k4b)
        r[i] = a
    return r


@njit(cache=True)
def _play(x, width):  # type: ignore[no-untyped-def]
    y = np.empty(x.size)
    state = 0.0
    for i in range(x.size):
        state = min(x[i] + 0.5 * width, max(x[i] - 0.5 * width, state))
        y[i] = state
    return y


def _slipped(time_s: Array, x: Array, slip_s: float, every_s: float, rng: np.random.Generator) -> Array:
    """Stretches of exponential length arrive late by `slip_s`, in turn with stretches in time."""
    span = float(time_s[-1] - time_s[0])
    edges = time_s[0] + np.cumsum(rng.exponential(every_s, int(3 * span / every_s) + 20))
    late = np.searchsorted(edges, time_s, side="right") % 2 == 1
    return np.where(late, np.interp(time_s - slip_s, time_s, x), x)


def distort(time_s: Array, true_m: Array, command_V: Array, temperature_C: Array | None, effects: Effects,
            rng: np.random.Generator, late_s: float = 0.0) -> Array:
    """What the sensor is given to read (n,) in m of the true displacement (n,), with the sensor's effects.

    `effects` as `checked` returns them; those of other stages are passed over. `temperature_C` (n,) is needed by
    thermal expansion alone. late_s: by how long it is read late, early below zero; at the place of a delay in the
    chain, since a sensor is as curved between two rows as at them. Clipping and mains are not in here.
    """
    y = true_m
    if "thermal_expansion" in effects and temperature_C is not None:
        y = y - effects["thermal_expansion"]["alpha_T_m_per_K"] * (temperature_C - temperature_C[0])
    if "lost_contact" in effects:
        y = np.maximum(y, effects["lost_contact"]["lift_off_m"])
    if effects.get("output_backlash", {}).get("play_m", 0.0) > 0.0:
        y = _play(y, effects["output_backlash"]["play_m"])
    if "holder_resonance" in effects:
        p = effects["holder_resonance"]
        y = y + p["holder_share"] * _resonance(time_s, y, 2.0 * np.pi * p["holder_Hz"], p["holder_zeta"])
    if "sample_slips" in effects:
        y = _slipped(time_s, y, effects["sample_slips"]["slip_s"], effects["sample_slips"]["every_s"], rng)
    delay = effects.get("acquisition_delay", {}).get("T_d_s", 0.0) + late_s
    if delay != 0.0:
        y = np.interp(time_s - delay, time_s, y)
    lag = effects.get("sensor_lag", {}).get("tau_s_s", 0.0)
    if lag > 0.0:
        y = first_order(read_only(time_s), read_only(y), lag, y[0])
    if "cyclic_error" in effects:
        p = effects["cyclic_error"]
        y = y + p["cyclic_m"] * np.sin(2.0 * np.pi * y / p["cyclic_period_m"])
    if "soft_knee" in effects:
        p = effects["soft_knee"]
        y = y - 0.5 * p["knee_m"] * (1.0 + np.tanh((y - p["knee_at_m"]) / p["knee_width_m"]))
    if "sensor_nonlinearity" in effects:
        y = y + effects["sensor_nonlinearity"]["q_2_per_m"] * y**2
    if "sensor_drift" in effects:
        y = y + effects["sensor_drift"]["drift_m_per_s"] * time_s
    if "edge_crosstalk" in effects:
        p = effects["edge_crosstalk"]
        y = y + p["crosstalk_m_per_V"] * _high_pass(time_s, command_V, p["tau_crosstalk_s"])
    if "sensor_random_walk" in effects:
        steps = np.sqrt(np.diff(time_s, prepend=time_s[0])) * rng.standard_normal(time_s.size)
        y = y + effects["sensor_random_walk"]["walk_m_per_sqrt_s"] * np.cumsum(steps)
    return y

"""What the sensor and its electronics make of the displacement, noise apart."""

from __future__ import annotations

import numpy as np

from .filters import lag, low_pass, slew
from .on_the_stack import ON_THE_STACK, Law, Seen
from .recordings import Array, Effects


def thermal_expansion(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """Counts from the temperature at the first row."""
    temperature_C = seen.recording.temperature_C
    return np.asarray(y + q["m_per_K"] * (temperature_C - temperature_C[0]))


def acquisition_delay(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """Linear between samples."""
    t = seen.recording.time_s
    return np.interp(t - q["T_d_s"], t, y)


def voltage_dependent_delay(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """The later, the higher the voltage."""
    t = seen.recording.time_s
    return np.interp(t - q["s_at_1kV"] * np.abs(seen.recording.voltage_V) / 1000, t, y)


def clock_skew(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """The sensor's clock goes slow."""
    t = seen.recording.time_s
    return np.interp(t * (1 - q["rel"]), t, y)


def sensor_lag(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """First order."""
    return np.asarray(lag(y, seen.recording.step_s, q["tau_s"], q["tau_s"]))


def asymmetric_sensor_lag(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """First order, faster on one way than on the other."""
    return np.asarray(lag(y, seen.recording.step_s, q["tau_up_s"], q["tau_dn_s"]))


def sensor_slew(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A sensor that follows no faster than this."""
    return np.asarray(slew(y, q["m_per_s"] * seen.recording.step_s))


def edge_crosstalk(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """The command, high-passed, in the reading."""
    rec = seen.recording
    slow = low_pass(rec.voltage_V, rec.step_s, q["tau_s"], q["tau_s"], rec.voltage_V[0])
    return np.asarray(y + q["m_per_kV"] * (rec.voltage_V - slow) / 1000)


def cyclic_sensor_error(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """An error that repeats along the scale."""
    return np.asarray(y + q["m"] * np.sin(2 * np.pi * y / q["period_m"] + q["phase"]))


def sensor_nonlinearity(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A scale that bends."""
    return np.asarray(y + q["g2_per_m"] * y * y)


def sensor_drift(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """The same slope in every recording."""
    return np.asarray(y + q["m_per_s"] * seen.recording.time_s)


def telegraph_zero(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A zero that jumps to and fro."""
    t = seen.recording.time_s
    rng = np.random.default_rng(int(q["seed"]) + seen.recording.index)
    jumps = rng.poisson(t[-1] / q["dwell_s"] + 1)
    changes = np.zeros(t.size)
    for i in rng.integers(1, t.size, jumps):
        changes[i] += 1
    return np.asarray(y + q["m"] * (np.cumsum(changes) % 2))


def mains_pickup(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A line whose phase differs from recording to recording."""
    phase = np.random.default_rng(int(q["seed"]) + seen.recording.index).uniform(0, 2 * np.pi)
    return np.asarray(y + q["m"] * np.sin(2 * np.pi * q["f_Hz"] * seen.recording.time_s + phase))


def sensor_clipping(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A limit of what is measured, or of what is recorded."""
    limit = q["max_m"]
    if seen.clip_last:
        limit = (limit - seen.recording.offset_m) / seen.recording.gain
    return np.minimum(y, limit)


#: in the order in which they act, after those on the stack
SENSOR: dict[str, Law] = {
    law.__name__: law
    for law in (
        thermal_expansion,
        acquisition_delay,
        voltage_dependent_delay,
        clock_skew,
        sensor_lag,
        asymmetric_sensor_lag,
        sensor_slew,
        edge_crosstalk,
        cyclic_sensor_error,
        sensor_nonlinearity,
        sensor_drift,
        telegraph_zero,
        mains_pickup,
        sensor_clipping,
    )
}


def sensed(seen: Seen, effects: Effects) -> Array:
    """Displacement (n,) m as a sensor without noise, gain error and offset reads it."""
    y = seen.moved_m
    for name, law in {**ON_THE_STACK, **SENSOR}.items():
        if name in effects:
            y = law(y, seen, effects[name])
    return y

"""Disturbances of the stack and its mount that reach the sensor beside the strain; all are on no list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .filters import low_pass, mode, play, snap, stick_slip
from .recordings import Array, VoltageRecording

_SNAP_S = 0.004
_THRESHOLDS = 997


@dataclass(frozen=True, eq=False)
class Seen:
    """What a law may look at: the recording, the true strain (n,) and the displacement (n,) m that belongs to it."""

    recording: VoltageRecording
    strain: Array
    moved_m: Array
    #: the sensor's limit cuts what is recorded, gain and offset included
    clip_last: bool = False


#: displacement (n,) m so far, what may be looked at, parameters -> displacement (n,) m
Law = Callable[[Array, Seen, dict[str, float]], Array]


def self_heating(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """Expansion by what holds and charging dissipate."""
    rec = seen.recording
    change = np.diff(rec.voltage_V, prepend=rec.voltage_V[0])
    power = q["w_hold"] * (rec.voltage_V / 1000) ** 2 + q["w_cycle"] * (np.abs(change) / 1000) ** 2 / rec.step_s * 0.1
    return np.asarray(y - q["m"] * low_pass(power, rec.step_s, q["tau_s"], q["tau_s"], 0.0))


def barrel_history(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A stack that bulges with the square of its strain, and comes back more slowly."""
    bulge = low_pass((seen.strain / 0.02) ** 2, seen.recording.step_s, q["tau_up_s"], q["tau_dn_s"], 0.0)
    return np.asarray(y - q["m"] * bulge)


def humidity_swelling(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """Swelling that follows whether a voltage is on."""
    on = (seen.recording.voltage_V > 100).astype(float)
    return np.asarray(y - q["m"] * low_pass(on, seen.recording.step_s, q["tau_on_s"], q["tau_off_s"], 0.0))


def debonded_layer_snap(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A layer that closes above one voltage and opens below another."""
    rec = seen.recording
    return np.asarray(y + q["m"] * snap(rec.voltage_V, q["V_on"], q["V_off"], rec.step_s, _SNAP_S))


def mount_stickslip(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A mount that gives way in jumps, at thresholds of its own."""
    thresholds = q["thr_m"] * np.random.default_rng(int(q["seed"])).uniform(0.5, 1.5, _THRESHOLDS)
    return np.asarray(y - stick_slip(seen.moved_m, thresholds, q["frac"]))


def stand_mode(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """A share of the displacement goes through a mode of the stand."""
    return np.asarray(y + q["frac"] * (mode(y, seen.recording.step_s, q["f_Hz"], q["zeta"]) - y))


def output_backlash(y: Array, seen: Seen, q: dict[str, float]) -> Array:
    """Play of the linkage."""
    return np.asarray(play(y, q["m"]))


#: in the order in which they act
ON_THE_STACK: dict[str, Law] = {
    law.__name__: law
    for law in (
        self_heating,
        barrel_history,
        humidity_swelling,
        debonded_layer_snap,
        mount_stickslip,
        stand_mode,
        output_backlash,
    )
}

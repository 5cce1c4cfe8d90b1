"""From the command to the voltage that the supply gives: ripple, sag, ringing, a slow fall, a limited slope."""

import math
from typing import NamedTuple

from numba import njit

from .filters import second_order


class SupplyState(NamedTuple):
    """Voltage given [V], ringing voltage [V] and its rate [V/s], voltage that the sag follows [V]."""

    out_V: float
    ringing_V: float
    ringing_rate: float
    sag_V: float


class SupplyStep(NamedTuple):
    """How the supply goes through a step: transition of the ringing, what is kept of a fall and of the sag."""

    a11: float
    a12: float
    a21: float
    a22: float
    fall: float
    sag: float


@njit(cache=True)
def supply_step(laws, step_s):
    """Exact for a command that is held."""
    a11, a12, a21, a22 = 1.0, 0.0, 0.0, 1.0
    if laws.ringing_Hz > 0.0:
        a11, a12, a21, a22 = second_order(laws.ringing_Hz, laws.ringing_zeta, step_s)
    fall = math.exp(-step_s / laws.fall_tau_s) if laws.fall_tau_s > 0.0 else 0.0
    sag = math.exp(-step_s / laws.sag_tau_s) if laws.sag_per_kV != 0.0 else 0.0
    return SupplyStep(a11, a12, a21, a22, fall, sag)


@njit(cache=True)
def limited(laws, command_V, wander_V):
    """What the supply aims at: dead zone, wander, saturation."""
    wanted = command_V
    if laws.dead_V > 0.0:
        wanted = max(0.0, command_V - laws.dead_V)
    wanted += wander_V
    if laws.saturation_V > 0.0 and wanted > laws.saturation_V:
        wanted = laws.saturation_V
    return wanted


@njit(cache=True)
def supplied(laws, step, state, wanted_V, command_V, time_s, step_s):
    """State at the end of a step of step_s; without duration, what follows a new command at once."""
    at_once = step_s == 0.0
    target = wanted_V
    sag = state.sag_V
    ringing = state.ringing_V
    rate = state.ringing_rate
    if laws.ripple != 0.0:
        target += laws.ripple * command_V * math.sin(2.0 * math.pi * laws.ripple_Hz * time_s)
    if laws.sag_per_kV != 0.0:
        if not at_once:
            sag = command_V + (sag - command_V) * step.sag
        target *= 1.0 - laws.sag_per_kV * sag / 1000.0
    if laws.ringing_Hz > 0.0:
        if not at_once:
            off = ringing - target
            ringing, rate = target + step.a11 * off + step.a12 * rate, step.a21 * off + step.a22 * rate
        target = ringing
    out = target
    if laws.fall_tau_s > 0.0 and target < state.out_V:
        out = state.out_V if at_once else target + (state.out_V - target) * step.fall
    if laws.slew_V_per_s > 0.0:
        most = laws.slew_V_per_s * step_s
        if out > state.out_V + most:
            out = state.out_V + most
        elif out < state.out_V - most:
            out = state.out_V - most
    return SupplyState(out, ringing, rate, sag)

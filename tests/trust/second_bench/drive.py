"""A stack under a voltage: supply, charge and force balance, solved at every internal step."""

import math

import numpy as np
from numba import njit

from .dielectric import charged, maxwell_stress
from .solid import Memory, branch_step, remember, solid_stress
from .supply import SupplyState, limited, supplied, supply_step

_ITERATIONS = 40
_STRAIN_TOLERANCE = 1e-13


@njit(cache=True)
def driven(command_V, row_s, steps, chain, scale, wander_V):
    """True strain (n,) at each row of a held command (n,) V; rows are row_s apart, each in `steps` steps.

    A new command is followed by a step of no duration: springs and branches answer to it at once, a damper or a mass
    does not. scale (n,): factor on the spring. wander_V (n,): what the supply adds of its own. A mass is stepped by
    the trapezoidal rule (Newmark), a damper too; a quadratic damper needs a step that damps, which is Euler's.
    """
    laws, branch_Pa, branch_s, friction = chain
    n = command_V.size
    out = np.zeros(n)
    h = row_s / steps
    over = branch_step(branch_Pa, branch_s, h)
    at_once = branch_step(branch_Pa, branch_s, 0.0)
    supply_over = supply_step(laws, h)
    memory = Memory(np.zeros(branch_Pa.size), np.zeros(friction.yield_strain.size))
    supply = SupplyState(0.0, 0.0, 0.0, 0.0)
    e = 0.0
    speed = 0.0
    acceleration = 0.0
    most_work = 0.0
    charge = 0.0
    voltage = 0.0  # on the dielectric
    absorbed = 0.0
    retained = 0.0
    resistive = laws.series_ohm > 0.0 or laws.strain_ohm_per_pct > 0.0
    massive = laws.mass_Pa_s2 > 0.0
    damped = (not massive) and (laws.damper_Pa_s > 0.0 or laws.quadratic_damper_Pa_s2 > 0.0)
    stepwise = not resistive and laws.slew_V_per_s <= 0.0 and laws.fall_tau_s <= 0.0 and laws.ringing_Hz <= 0.0
    absorbed_kept = math.exp(-h / laws.absorbed_tau_s) if laws.absorbed != 0.0 else 0.0
    retained_kept = math.exp(-h / laws.retained_tau_s) if laws.retained != 0.0 else 0.0
    for row in range(1, n):
        command = command_V[row]
        changed = command != command_V[row - 1] or row == 1
        wanted = limited(laws, command, wander_V[row])
        for sub in range(-1 if changed else 0, steps):
            instant = sub < 0
            time_s = (row - 1) * row_s + (sub + 1) * h
            supply = supplied(laws, supply_over, supply, wanted, command, time_s, 0.0 if instant else h)
            before = voltage
            if not resistive:
                voltage = supply.out_V
            elif not instant:
                charge, c = charged(laws, e, charge, voltage, supply.out_V, h)
                voltage = charge / c
            if not instant:
                if laws.absorbed != 0.0:
                    absorbed = laws.absorbed * voltage + (absorbed - laws.absorbed * voltage) * absorbed_kept
                if laws.retained != 0.0:
                    retained = laws.retained * voltage + (retained - laws.retained * voltage) * retained_kept
            acting = voltage - retained
            if instant and (massive or damped):
                if massive:
                    stress, _ = solid_stress(e, e, laws, scale[row], at_once, friction, memory, most_work)
                    drive, _ = maxwell_stress(e, laws, acting, absorbed)
                    drag = laws.mass_damper_Pa_s + laws.damper_Pa_s + laws.quadratic_damper_Pa_s2 * abs(speed)
                    acceleration = (drive - stress - drag * speed) / laws.mass_Pa_s2
                continue
            step = at_once if instant else over
            unbalanced = 0.0  # at the start of the step
            if damped:
                stress, _ = solid_stress(e, e, laws, scale[row], at_once, friction, memory, most_work)
                drive, _ = maxwell_stress(e, laws, (voltage if stepwise else before) - retained, absorbed)
                unbalanced = stress - drive
            e1 = e
            for _iteration in range(_ITERATIONS):
                stress, slope = solid_stress(e1, e, laws, scale[row], step, friction, memory, most_work)
                drive, drive_slope = maxwell_stress(e1, laws, acting, absorbed)
                rest = stress - drive
                rest_slope = slope - drive_slope
                if massive:
                    speed1 = 2.0 * (e1 - e) / h - speed
                    acceleration1 = 4.0 * (e1 - e) / (h * h) - 4.0 * speed / h - acceleration
                    drag = laws.mass_damper_Pa_s + laws.damper_Pa_s
                    d2 = laws.quadratic_damper_Pa_s2
                    rest += laws.mass_Pa_s2 * acceleration1 + drag * speed1 + d2 * abs(speed1) * speed1
                    rest_slope += 4.0 * laws.mass_Pa_s2 / (h * h) + 2.0 * drag / h + 4.0 * d2 * abs(speed1) / h
                elif damped:
                    mean_speed = (e1 - e) / h
                    d2 = laws.quadratic_damper_Pa_s2
                    if d2 == 0.0:
                        rest = 0.5 * (rest + unbalanced)
                        rest_slope = 0.5 * rest_slope
                    rest += laws.damper_Pa_s * mean_speed + d2 * abs(mean_speed) * mean_speed
                    rest_slope += laws.damper_Pa_s / h + 2.0 * d2 * abs(mean_speed) / h
                change = rest / rest_slope
                e1 -= change
                if abs(change) < _STRAIN_TOLERANCE:
                    break
            if massive:
                speed1 = 2.0 * (e1 - e) / h - speed
                acceleration = 4.0 * (e1 - e) / (h * h) - 4.0 * speed / h - acceleration
                speed = speed1
            most_work = remember(e1, e, laws, scale[row], step, friction, memory, most_work)
            e = e1
        out[row] = e
    return out

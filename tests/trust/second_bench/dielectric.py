"""Charge on the dielectric behind a resistance, and the electrostatic stress."""

import math

from numba import njit


@njit(cache=True)
def capacitance(laws, e):
    """Capacitance [F] at strain e."""
    c = laws.capacitance_F / ((1.0 - e) * (1.0 - e))
    if laws.permittivity_per_strain != 0.0:
        c *= 1.0 + laws.permittivity_per_strain * e
    return c


@njit(cache=True)
def charged(laws, e, charge_C, voltage_V, supply_V, step_s):
    """Charge [C] after a step, and capacitance [F]; resistance and leak are those at the start of the step."""
    c = capacitance(laws, e)
    ohm = laws.series_ohm
    if laws.strain_ohm_per_pct > 0.0:
        ohm += laws.strain_ohm_per_pct * max(0.0, e) / 0.01 + 1.0
    siemens = 1.0 / ohm
    if laws.leak_ohm > 0.0:
        leak = 1.0 / laws.leak_ohm
        if laws.leak_field_V_per_m > 0.0:
            leak *= math.exp(math.sqrt(abs(voltage_V) / laws.layer_m / laws.leak_field_V_per_m))
        siemens += leak
    settled = supply_V / ohm / siemens * c
    return settled + (charge_C - settled) * math.exp(-step_s * siemens / c), c


@njit(cache=True)
def maxwell_stress(e, laws, voltage_V, absorbed_V):
    """Electrostatic stress [Pa] at strain e, (D + P) V / z0 over the whole area, and its derivative."""
    stress = laws.maxwell_Pa_per_V2 * voltage_V * (voltage_V + absorbed_V)
    slope = 0.0
    if laws.feedback != 0.0:
        stretch = 1.0 - e
        stress = stress * stretch ** (-laws.feedback)
        slope = laws.feedback * stress / stretch
    if laws.permittivity_per_strain != 0.0:
        slope = slope * (1.0 + laws.permittivity_per_strain * e) + stress * laws.permittivity_per_strain
        stress = stress * (1.0 + laws.permittivity_per_strain * e)
    return stress, slope

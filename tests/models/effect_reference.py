"""A slow, tight solution of the chain with everything that a model may leave out, for a command held at levels.

Written from the equations alone: charge, retained charge, polarisation and viscous strains are integrated by a
general-purpose solver, the balance of forces is solved by bisection at every call. Dictionary `p` holds the
parameters by the names of the effects; what is not in it is off.
"""

import math

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayes_dea.campaign import Actuator, recording_from_arrays

EPS0 = 8.8541878128e-12
ACTUATOR = Actuator(layers=399, layer_thickness_m=25e-6, relative_permittivity=2.8,
                    electrode_area_m2=7.5602e-5, total_area_m2=1.1450e-4, stack_height_m=10.261e-3)
Z0, STROKE = 25e-6, 399 * 25e-6
FACTOR = EPS0 * 2.8 / Z0**2 * 7.5602e-5 / 1.1450e-4
C0 = 399 * EPS0 * 2.8 * 7.5602e-5 / Z0
BASE = {"Y_Pa": 1.2e6, "k_1_Pa": 70e3, "k_2_Pa": 50e3, "k_3_Pa": 60e3, "tau_1_s": 200.0, "tau_2_s": 20.0,
        "tau_3_s": 1.0}
#: (duration in s, V) of the standard test: two steps up, one down in between, back to zero
LEVELS = ((0.01, 0.0), (0.06, 800.0), (0.04, 300.0), (0.06, 1000.0), (0.05, 0.0))


def held(levels=LEVELS, step=1e-3, hold="end", **columns):
    """A recording of the levels, rows `step` apart, each level in force until its last row."""
    volts = np.concatenate([[levels[0][1]], *[np.full(round(d / step), v) for d, v in levels]])
    time = np.arange(volts.size) * step
    more = {name: f(time) for name, f in columns.items()}
    return recording_from_arrays("held.csv", "voltage", {"time_s": time, "voltage_V": volts,
                                                         "displacement_m": np.zeros_like(time), **more},
                                 "identify", ACTUATOR, hold=hold)


def branches_of(p):
    out = [(p[f"k_{i}_Pa"], p[f"tau_{i}_s"]) for i in range(1, 7) if f"k_{i}_Pa" in p]
    if "k_x_Pa" in p:
        out.append((p["k_x_Pa"], p["tau_x_s"]))
    if "k_f_Pa" in p:
        out += [(p["k_f_Pa"] * t ** -p["alpha_f"], t) for t in 10.0 ** np.arange(-3, 5)]
    return np.array(out).reshape(-1, 2)


def energy(p, e):
    r = abs(e) / p.get("e_c", 1.0)
    return (0.5 * p["Y_Pa"] * e**2 + 0.25 * p.get("beta", 0.0) * p["Y_Pa"] * e**4
            + p.get("dE_Pa", 0.0) * p.get("e_c", 1.0) ** 2 * (r - math.log1p(r)))


def elastic(p, e, w_max):
    s = p["Y_Pa"] * e * (1 + p.get("beta", 0.0) * e**2)
    s += p.get("dE_Pa", 0.0) * e / (1 + abs(e) / p.get("e_c", 1.0))
    if "mullins_share" in p:
        W = energy(p, e)
        top = max(w_max, W)
        s *= 1 - p["mullins_share"] * math.erf((top - W) / (p["mullins_m_Pa"] + p["mullins_b"] * top))
    return s


def reference(p, levels=LEVELS, step=1e-3):
    """Displacement (n,) in m at the rows of `held(levels, step)`."""
    k, tau = branches_of(p).T
    n = k.size
    rs, rl, aq, chi = p.get("R_s_ohm", 0.0), p.get("R_leak_ohm", math.inf), p.get("a_q", 0.0), p.get("chi", 0.0)
    c, d0 = p.get("c_eps", 0.0), p.get("d0_Pa_s", 0.0)
    mass = p["Y_Pa"] / (2 * math.pi * p["f_1_Hz"]) ** 2 if "f_1_Hz" in p else 0.0
    damp = d0 + 2 * p.get("zeta", 0.0) * math.sqrt(p["Y_Pa"] * mass)
    moving = damp > 0 or mass > 0

    def voltage(e, x, level):
        return x[0] * (1 - e) ** 2 / (C0 * (1 + c * e)) if rs else level

    def surplus(e, x, level, w_max):
        w = voltage(e, x, level) - x[1]
        push = FACTOR * (w + x[2]) * w * (1 + c * e)
        if p.get("thickness_feedback"):
            push /= (1 - e) ** 2
        return push - elastic(p, e, w_max) - np.sum(k * (e - x[3:3 + n]))

    def strain(x, level, w_max):
        return brentq(surplus, -0.05, 0.2, (x, level, w_max), xtol=1e-15, rtol=1e-14)

    def slope(t, x, level, w_max):
        e = x[3 + n] if moving else strain(x, level, w_max)
        V = voltage(e, x, level)
        dx = np.zeros_like(x)
        if rs:
            field = abs(V) / Z0 / p.get("E_0_V_per_m", math.inf)
            dx[0] = (level - V) / rs - V / rl * math.exp(math.sqrt(field))
        dx[1] = (aq * V - x[1]) / p.get("tau_q_s", 1.0)
        dx[2] = (chi * (V - x[1]) - x[2]) / p.get("tau_d_s", 1.0)
        dx[3:3 + n] = (e - x[3:3 + n]) / tau
        if mass:
            dx[3 + n] = x[4 + n]
            dx[4 + n] = (surplus(e, x, level, w_max) - damp * x[4 + n]) / mass
        elif moving:
            dx[3 + n] = surplus(e, x, level, w_max) / damp
        return dx

    x = np.zeros(5 + n)
    out, w_max = [0.0], 0.0
    for duration, level in levels:
        rows = round(duration / step)
        ends = np.arange(1, rows + 1) * step
        # the course does not depend on where it is read: all rows of a level in one go
        run = solve_ivp(slope, (0.0, ends[-1]), x, "LSODA", ends, args=(level, w_max), rtol=1e-9, atol=1e-13)
        assert run.success
        x = run.y[:, -1]
        for column in run.y.T:
            e = column[3 + n] if moving else strain(column, level, w_max)
            out.append(e)
        w_max = max(w_max, max(energy(p, e) for e in out[-rows:]))
    return STROKE * np.array(out)

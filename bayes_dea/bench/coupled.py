"""Compiled integrators with every effect of the bench in one set of equations: implicit midpoint rule, substeps.

All states are strains, voltages and their like that stay continuous when the command jumps: strain q_i of each
dashpot, charge u / C0 behind the series resistance, retained charge, polarisation; with a damper or a mass the
strain itself. At the middle of each substep they are linear functions of the unknown strain there, so that a step
is one scalar balance of stresses, solved by Newton's method. Friction elements and the softening follow the path of
the strain from one balance to the next.

Substeps are fine after edges and coarse on plateaus: each time constant carries the amplitude (in strain) that is
still moving with it, and the error of the rule, amplitude (h / tau)^2 / 12, is kept below a tolerance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from bayes_dea.compiled import njit

#: error allowed to a substep, in strain (4e-7 is 4 nm of the default stack)
TOLERANCE = 4e-7
#: the same where a mass rings: its phase error is paid for in every row
TOLERANCE_RING = 1e-6
#: time constants after which the charge behind the series resistance has settled (what is left: 6e-6)
_SETTLED = 12.0
#: most substeps between two rows
MOST_SUBSTEPS = 400


class Physics(NamedTuple):
    """Constants of one actuator with its effects, SI units; an effect that is absent has its null value."""

    Y: float
    stress_per_V2: float
    C0: float
    field_per_V: float
    R_s: float = 0.0
    R_leak: float = math.inf
    E_0: float = math.inf
    slew: float = math.inf
    tau_fall: float = 0.0
    a_q: float = 0.0
    tau_q: float = 1.0
    feedback: float = 0.0
    c_eps: float = 0.0
    chi: float = 0.0
    tau_d: float = 1.0
    beta: float = 0.0
    dE: float = 0.0
    e_c: float = 1.0
    slider_k: float = 0.0
    mullins_share: float = 0.0
    mullins_m: float = 1.0
    mullins_b: float = 0.0
    mass: float = 0.0
    mass_damper: float = 0.0
    d0: float = 0.0
    d2: float = 0.0
    heat: float = 0.0
    tau_heat: float = 1.0
    field_rate: float = 0.0
    unload_ratio: float = 1.0
    thixotropy: float = 0.0
    thixotropy_strain: float = 1.0
    tau_thixotropy: float = 1.0
    factor_before: float = 1.0
    factor_after: float = 1.0
    switch_s: float = math.inf


@njit(cache=True)
def _static(e, p, W_most):  # type: ignore[no-untyped-def]
    """Stress and tangent of everything without memory but the softening, and its energy."""
    x = abs(e) / p.e_c
    stress = p.Y * e + p.beta * p.Y * e * e * e + p.dE * e / (1.0 + x)
    tangent = p.Y + 3.0 * p.beta * p.Y * e * e + p.dE / ((1.0 + x) * (1.0 + x))
    W = 0.0
    if p.mullins_share > 0.0:
        W = 0.5 * p.Y * e * e + 0.25 * p.beta * p.Y * e**4 + p.dE * p.e_c * p.e_c * (x - math.log1p(x))
        most = max(W, W_most)
        scale = p.mullins_m + p.mullins_b * most
        z = (most - W) / scale
        eta = 1.0 - p.mullins_share * math.erf(z)
        if most > W:
            slope = p.mullins_share * 2.0 / math.sqrt(math.pi) * math.exp(-z * z) / scale
            tangent = eta * tangent + slope * stress * stress
        stress *= eta
    return stress, tangent, W


@njit(cache=True)
def _towards(x, F, K, low, high):  # type: ignore[no-untyped-def]
    """The next strain after Newton, kept between the strains known to be too small and too large.

    The corner where softened material is stretched beyond what it has seen sends Newton's steps to and fro for ever.
    """
    if F > 0.0:
        low = max(low, x)
    else:
        high = min(high, x)
    new = x + F / K
    if not low < new < high and abs(new - x) > 1e-15 and not math.isinf(low) and not math.isinf(high):
        new = 0.5 * (low + high)
    return new, low, high


@njit(cache=True)
def _sliders(e, e_from, held, p, yields):  # type: ignore[no-untyped-def]
    """Stress and tangent of the friction elements when the strain goes from `e_from` to `e`."""
    stress, tangent = 0.0, 0.0
    for j in range(yields.size):
        s = held[j] + p.slider_k * (e - e_from)
        top = p.slider_k * yields[j]
        if s > top:
            stress += top
        elif s < -top:
            stress -= top
        else:
            stress += s
            tangent += p.slider_k
    return stress, tangent


@njit(cache=True)
def _slide(e, e_from, held, p, yields):  # type: ignore[no-untyped-def]
    for j in range(yields.size):
        top = p.slider_k * yields[j]
        held[j] = min(top, max(-top, held[j] + p.slider_k * (e - e_from)))


@njit(cache=True)
def _on_layers(e, half, supply, u, p):  # type: ignore[no-untyped-def]
    """Voltage on the dielectric and charge / C0 after `half` from charge `u`, at strain e; half < 0: settled."""
    if p.R_s <= 0.0:
        return supply, supply
    c = (1.0 + p.c_eps * e) / ((1.0 - e) * (1.0 - e))
    # c volts + half (volts / R_s + leak) / C0 = u + half supply / (R_s C0), divided by half / (R_s C0) where settled
    weight, held, given = half / (p.R_s * p.C0), c, u
    if half < 0.0:
        weight, held, given = 1.0, 0.0, 0.0
    charge = given + weight * supply
    volts = charge / (held + weight)
    if not math.isinf(p.R_leak):
        leak = weight * p.R_s / p.R_leak
        for _ in range(30):
            root = math.sqrt(abs(volts) * p.field_per_V / p.E_0)  # 0 where the leak is linear
            current = leak * math.exp(root)
            F = volts * (held + weight + current) - charge
            change = F / (held + weight + current * (1.0 + 0.5 * root))
            volts -= change
            if abs(change) < 1e-11:
                break
    out = volts * c
    return volts, out


@njit(cache=True)
def _maxwell(e, feed, supply, u, retained, polarised, p):  # type: ignore[no-untyped-def]
    """Maxwell stress at strain e after `feed`, with the states at the middle: volts, charge, retained, polarised.

    A negative `feed` says that the charge has settled (its absolute value counts for the rest).
    """
    volts, charge = _on_layers(e, feed, supply, u, p)
    half = abs(feed)
    keep = retained
    if p.a_q > 0.0:
        c = half / p.tau_q
        keep = (retained + c * p.a_q * volts) / (1.0 + c)
    acting = volts - keep
    P = polarised
    if p.chi > 0.0:
        c = half / p.tau_d
        P = (polarised + c * p.chi * acting) / (1.0 + c)
    stress = p.stress_per_V2 * (acting + P) * acting * (1.0 + p.c_eps * e)
    if p.feedback > 0.0:
        stress /= (1.0 - e) * (1.0 - e)
    return stress, volts, charge, keep, P


@njit(cache=True)
def drive_coupled(time_s, command_V, p, k_Pa, tau_s, yields, tolerance, tolerance_ring):  # type: ignore[no-untyped-def]
    """Strain (n,) and voltage (n,) on the dielectric under a command (n,) held over the interval ending at its row.

    At rest before the first row. `k_Pa`, `tau_s`: one entry a branch. `yields`: yield strain of each friction
    element, all of stiffness p.slider_k.
    """
    n = time_s.size
    branches = k_Pa.size
    q = np.zeros(branches)
    keep = np.ones(branches)
    c = np.zeros(branches)
    held = np.zeros(yields.size)
    out = np.empty(n)
    layers = np.empty(n)
    rigid = p.Y + p.dE + k_Pa.sum() + p.slider_k * yields.size
    moving = p.mass > 0.0 or p.d0 > 0.0 or p.d2 > 0.0
    varying = p.field_rate != 0.0 or p.unload_ratio != 1.0
    # time constants that decide on the substeps, with the share of a step that moves with each
    modes = branches + 6
    fast = np.full(modes, np.inf)
    share = np.zeros(modes)
    decay = np.full(modes, np.inf)
    amplitude = np.zeros(modes)
    for j in range(branches):
        fast[j] = tau_s[j] * math.exp(-abs(p.field_rate) * 1.5) * min(1.0, p.unload_ratio)
        share[j] = k_Pa[j] / rigid
    if p.R_s > 0.0:
        fast[branches] = p.R_s * p.C0
        share[branches] = 1.0
    if p.chi > 0.0:
        fast[branches + 1] = p.tau_d
        share[branches + 1] = p.chi
    if p.a_q > 0.0:
        fast[branches + 2] = p.tau_q
        share[branches + 2] = 2.0 * p.a_q
    if p.d0 > 0.0:
        fast[branches + 3] = p.d0 / rigid
        share[branches + 3] = 1.0
    if p.d2 > 0.0:
        fast[branches + 4] = math.sqrt(p.d2 * p.stress_per_V2) * 1000.0 / rigid
        share[branches + 4] = 1.0
    for j in range(modes):
        decay[j] = fast[j]
    decay[branches + 4] = 5.0 * fast[branches + 4]  # it comes to rest as 1 / t
    if p.mass > 0.0:
        omega = math.sqrt(rigid / p.mass)
        zeta = max(0.002, 0.5 * (p.mass_damper + p.d0) / math.sqrt(rigid * p.mass))
        fast[branches + 5] = 1.0 / omega
        decay[branches + 5] = 1.0 / (zeta * omega)
        share[branches + 5] = 1.0 / zeta  # the phase error adds up while it rings
    supply, u, retained, polarised, W_most = 0.0, 0.0, 0.0, 0.0, 0.0
    e, velocity, heat, broken = 0.0, 0.0, 0.0, 0.0
    volts, last_command, drift = 0.0, 0.0, 0.0
    known_h = -1.0
    fade = np.zeros(modes)
    known_step = -1.0
    for i in range(n):
        step = time_s[i] - time_s[i - 1] if i > 0 else 0.0
        target = command_V[i]
        factor = p.factor_after if time_s[i] >= p.switch_s else p.factor_before
        if p.heat != 0.0:
            factor *= 1.0 + p.heat * heat
        if p.thixotropy != 0.0:
            factor *= 1.0 - p.thixotropy * broken
        e_row = e
        if step > 0.0:
            jump = abs(target * target - last_command * last_command) + drift
            steps = 1
            # a supply that moves within the row leaves the charge behind all the way
            follows = (p.tau_fall > 0.0 and target < supply) or not math.isinf(p.slew)
            settled = p.R_s > 0.0 and step > _SETTLED * fast[branches] and (supply == target or not follows)
            for j in range(modes):
                amplitude[j] += share[j] * p.stress_per_V2 * jump / rigid
                allowed = tolerance if j < modes - 1 else tolerance_ring
                if amplitude[j] > allowed and not (j == branches and settled):
                    # what has died away when the row is read needs no more than stable substeps
                    x = step / decay[j]
                    left = amplitude[j] * x * math.exp(1.0 - x) if x > 1.0 else amplitude[j]
                    h = fast[j] * min(1.0, math.sqrt(12.0 * allowed / max(left, 1e-300)))
                    if h * MOST_SUBSTEPS < step:
                        steps = MOST_SUBSTEPS
                    elif h < step:
                        steps = max(steps, math.ceil(step / h))
            if abs(step - known_step) > 1e-9 * known_step:
                known_step = step
                for j in range(modes):
                    fade[j] = math.exp(-step / decay[j]) if decay[j] > 0.0 else 0.0
            for j in range(modes):
                amplitude[j] *= fade[j]
            h = step / steps
            half = 0.5 * h
            feed = -half if settled else half
            supply_before = supply
            for _ in range(steps):
                # the supply, exactly, at the middle and at the end of the substep
                middle, end = target, target
                if p.tau_fall > 0.0 and target < supply:
                    middle = target + (supply - target) * math.exp(-half / p.tau_fall)
                    end = target + (supply - target) * math.exp(-h / p.tau_fall)
                if not math.isinf(p.slew):
                    middle = min(supply + p.slew * half, max(supply - p.slew * half, middle))
                    end = min(supply + p.slew * h, max(supply - p.slew * h, end))
                supply = end
                if varying or abs(h - known_h) > 1e-9 * known_h:
                    known_h = h
                    field = volts if p.R_s > 0.0 else middle
                    quicker = math.exp(p.field_rate * (field * 1e-3) * (field * 1e-3))
                    for j in range(branches):
                        rate = quicker / tau_s[j]
                        if p.unload_ratio != 1.0 and e < q[j]:
                            rate /= p.unload_ratio
                        c[j] = half * rate
                        keep[j] = 1.0 / (1.0 + c[j])
                slope, memory = 0.0, 0.0
                for j in range(branches):
                    slope += k_Pa[j] * keep[j]
                    memory += k_Pa[j] * keep[j] * q[j]
                inertial = 4.0 * p.mass / (h * h)
                x = e + half * velocity if p.mass > 0.0 else e
                softer, low, high = 0.0, -math.inf, math.inf
                for trial in range(60):
                    push = _maxwell(x, feed, middle, u, retained, polarised, p)[0]
                    if trial == 0:
                        softer = (_maxwell(x + 1e-6, feed, middle, u, retained, polarised, p)[0] - push) * 1e6
                    static, tangent, _ = _static(x, p, W_most)
                    friction, loose = _sliders(x, e, held, p, yields)
                    F = push - factor * (static + slope * x - memory) - friction
                    K = factor * (tangent + slope) + loose - softer
                    if moving:
                        rate = (x - e) / half
                        F -= (p.d0 + p.mass_damper + p.d2 * abs(rate)) * rate
                        F -= inertial * (x - e) - p.mass * velocity / half
                        K += (p.d0 + p.mass_damper + 2.0 * p.d2 * abs(rate)) / half + inertial
                    x, low, high = _towards(x, F, K, low, high)
                    if abs(F) < 1e-12 * K:
                        break
                _, volts, charge, kept, P = _maxwell(x, feed, middle, u, retained, polarised, p)
                if p.R_s > 0.0:
                    u = charge if settled else 2.0 * charge - u
                retained = 2.0 * kept - retained
                polarised = 2.0 * P - polarised
                for j in range(branches):
                    q[j] = 2.0 * keep[j] * (q[j] + c[j] * x) - q[j]
                if p.slider_k > 0.0:
                    _slide(x, e, held, p, yields)
                if p.mullins_share > 0.0:
                    W_most = max(W_most, _static(x, p, W_most)[2])
                if moving:
                    after = 2.0 * x - e
                    velocity = 2.0 * (x - e) / half - velocity if p.mass > 0.0 else 0.0
                    if p.slider_k > 0.0:
                        _slide(after, x, held, p, yields)
                    if p.mullins_share > 0.0:
                        W_most = max(W_most, _static(after, p, W_most)[2])
                    e = after
                else:
                    e = x
            drift = abs(supply * supply - supply_before * supply_before) if supply != target else 0.0
        elif math.isinf(p.slew) and p.tau_fall <= 0.0:
            supply = target
        last_command = target
        if moving:
            volts = _on_layers(e, 0.0, supply, u, p)[0]
        else:
            slope, memory = 0.0, 0.0
            for j in range(branches):
                slope += k_Pa[j]
                memory += k_Pa[j] * q[j]
            x, low, high = e, -math.inf, math.inf
            for _ in range(60):
                push = _maxwell(x, 0.0, supply, u, retained, polarised, p)[0]
                more = _maxwell(x + 1e-6, 0.0, supply, u, retained, polarised, p)[0]
                static, tangent, _ = _static(x, p, W_most)
                friction, loose = _sliders(x, e, held, p, yields)
                F = push - factor * (static + slope * x - memory) - friction
                K = factor * (tangent + slope) + loose - (more - push) * 1e6
                x, low, high = _towards(x, F, K, low, high)
                if abs(F) < 1e-12 * K:
                    break
            if p.slider_k > 0.0:
                _slide(x, e, held, p, yields)
            if p.mullins_share > 0.0:
                W_most = max(W_most, _static(x, p, W_most)[2])
            volts = _on_layers(x, 0.0, supply, u, p)[0]
            e = x
        if p.heat != 0.0:
            heat += ((volts * 1e-3) * (volts * 1e-3) - heat) * -math.expm1(-step / p.tau_heat)
        if p.thixotropy != 0.0:
            worked = abs(e - e_row) / p.thixotropy_strain
            broken = (broken + worked) / (1.0 + worked) * math.exp(-step / p.tau_thixotropy)
        out[i] = e
        layers[i] = volts
    return out, layers


@njit(cache=True)
def press_coupled(time_s, imposed, p, k_Pa, tau_s, yields, longest_s):  # type: ignore[no-untyped-def]
    """Strain (n,) and stress (n,) between plates that push but never pull; `imposed` (n,) linear between rows.

    Where holding the material to the imposed strain would take tension, it follows its own balance at zero stress.
    Substeps are at most `longest_s`; the rule is the trapezoidal one, as the imposed strain has no jumps.
    """
    n = time_s.size
    branches = k_Pa.size
    q = np.zeros(branches)
    c = np.zeros(branches)
    held = np.zeros(yields.size)
    strain = np.zeros(n)
    stress = np.zeros(n)
    e, W_most, broken = 0.0, 0.0, 0.0
    for i in range(n):
        step = time_s[i] - time_s[i - 1] if i > 0 else 0.0
        steps = max(1, math.ceil(step / longest_s)) if step > 0.0 else 1
        h = step / steps
        factor = p.factor_after if time_s[i] >= p.switch_s else p.factor_before
        if p.thixotropy != 0.0:
            factor *= 1.0 - p.thixotropy * broken
        e_row = e
        sigma = 0.0
        for s in range(1, steps + 1):
            before = imposed[i - 1] if i > 0 else imposed[i]
            goal = before + (imposed[i] - before) * s / steps
            slope, memory = 0.0, 0.0
            for j in range(branches):
                rate = 1.0 / tau_s[j]
                if p.unload_ratio != 1.0 and e < q[j]:
                    rate /= p.unload_ratio
                c[j] = 0.5 * h * rate
                slope += k_Pa[j] / (1.0 + c[j])
                memory += k_Pa[j] * ((1.0 - c[j]) * q[j] + c[j] * e) / (1.0 + c[j])
            x, low, high = goal, -math.inf, math.inf
            for trial in range(60):
                static, tangent, _ = _static(x, p, W_most)
                friction, loose = _sliders(x, e, held, p, yields)
                sigma = factor * (static + slope * x - memory) + friction
                K = factor * (tangent + slope) + loose
                if h > 0.0:
                    rate = (x - e) / h
                    sigma += (p.d0 + p.d2 * abs(rate)) * rate
                    K += (p.d0 + 2.0 * p.d2 * abs(rate)) / h
                if trial == 0 and sigma >= 0.0:
                    break
                if abs(sigma) < 1e-12 * K:
                    sigma = 0.0
                    break
                x, low, high = _towards(x, -sigma, K, low, high)
            for j in range(branches):
                q[j] = ((1.0 - c[j]) * q[j] + c[j] * (e + x)) / (1.0 + c[j])
            if p.slider_k > 0.0:
                _slide(x, e, held, p, yields)
            if p.mullins_share > 0.0:
                W_most = max(W_most, _static(x, p, W_most)[2])
            e = x
        if p.thixotropy != 0.0:
            worked = abs(e - e_row) / p.thixotropy_strain
            broken = (broken + worked) / (1.0 + worked) * math.exp(-step / p.tau_thixotropy)
        strain[i] = e
        stress[i] = sigma
    return strain, stress

"""The compiled chain with everything that a model may leave out: supply voltage to strain.

One step goes from node to node. What is linear, springs, branches, damper and mass, answers in modes, each exactly and
however quick it is, to a stress that is straight within the step: the Maxwell stress less what the material holds
against it beyond the linear spring (a curved law, softening, friction). Volts on the dielectric, stored charges, that
stress and the strain are solved together at the end of the step, by Newton's method. What jumps or charges early within
a step enters as a jump at its start, placed so that the mean over the step is right; modes that are quick beside the
step see the charging itself.

A curved spring in series with elements is part of the network as far as it is straight; what it is beyond that goes, as
a second stress that is straight within the step, to all that stands beside it (`series_modes`).

Nothing is approximate, then, but that what depends on the strain is taken as straight within a step. Its course in the
middle, which the modes know, tells how wrong that is, and the step is cut where it matters.

Equations: force balance and circuit as in the reference paper (Eqs. 1-6, Table SII) with the effects of the catalogue
of missing physics; the material in `material_kernel`, the circuit in `circuit_kernel`.
"""

from __future__ import annotations

import math

import numpy as np

from ..compiled import njit
from . import mode_tables as mt
from .circuit_kernel import charge, field, leaking, stored
from .material_kernel import (
    P_BETA,
    P_DE,
    P_EC,
    P_EY,
    P_LAW,
    P_MB,
    P_MM,
    P_SHARE,
    P_SY,
    P_Y,
    X_E,
    X_F,
    X_S,
    X_T,
    X_TF,
    X_WM,
    beyond_spring,
    commit_friction,
    elastic,
    friction,
    rested,
)
from .plant_layout import (
    A_C,
    A_G,
    A_H,
    A_T,
    A_TABLES,
    A_X,
    MODES,
    P_AQ,
    P_C0,
    P_CEPS,
    P_CHI,
    P_CI,
    P_CR,
    P_D,
    P_EACT,
    P_FACTOR,
    P_GI,
    P_GR,
    P_N,
    P_PAIR,
    P_RL,
    P_RS,
    P_SPRING,
    P_THICK,
    P_TI,
    P_TR,
    P_WHOLE,
    P_YS,
    P_Z0,
    TABLE,
    TABLES,
    X_D1,
    X_D2,
    X_LOAD,
    X_P,
    X_SPRING,
    X_STEP,
    X_TRIED,
    X_V,
    X_VQ,
    X_ZI,
    X_ZR,
)
from .static import HOOKE, law_stress_tangent
from .step_length import bent_leak, early_current, following, halved, judged

_jit = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})

_SPRING_TOLERANCE = 1e-6  # the same of a spring in series
_TOLERANCE = 4e-6  # a Newton step of this strain is the last: what is left is its square
_STRAIGHT_TOLERANCE = 1e-5  # the same where only the circuit bends: about a hundredth is left
_SMALL = 3e-4  # a longer step (strain) is no smooth motion
_CIRCUIT_TOLERANCE = 1e-6  # strain error allowed for the current of a motion within a step
_COURSE_TOLERANCE = 5e-7  # the same for what depends on the strain
_SMOOTH = 0.2  # part of what a law is beside its line in the middle that a parabola leaves, where it has no corner
_QUICK = 0.03  # a step of so many time constants of a mode is more to it than a mean and an end
# share of the voltage by which an activated leak may be linearised beside the middle of a step, and least of it (V)
_CENTRED, _LITTLE_V = 0.01, 0.1
_SHORTEST = 5e-4  # part of a step from node to node below which no accuracy is sought any more
#: steps tried on average for each one asked for; beyond, there is no answer
_TRIES_A_STEP = 30
_MAX_ITERATIONS = 60


@_jit
def _beyond_line(inner, law_p, Ys, spring):
    """Stress (Pa) of a spring in series beyond its modulus at rest, and its slope."""
    s, t = law_stress_tangent(inner, law_p, spring)
    return s - Ys * spring, t - Ys


@_jit
def _in_series(inner, law_p, Ys, near, drive, gives):
    """Strain of a spring, its stress beyond its line and the slope of that, where strain + gives stress = drive.

    near: a strain close by. nan where the law has no stress for it.
    """
    spring, r, rt = near, 0.0, 0.0
    low, high = -math.inf, 1.0
    for it in range(_MAX_ITERATIONS):
        r, rt = _beyond_line(inner, law_p, Ys, spring)
        off = drive - spring - gives * r
        step = off / (1.0 + gives * rt)
        if abs(step) < _SPRING_TOLERANCE:
            return spring + step, r + rt * step, rt
        if off > 0.0:
            low = spring
        else:
            high = spring
        spring += step
        if not low < spring < high:  # a law that locks
            spring = 0.5 * (low + high) if low > -math.inf else 0.5 * (high + min(drive, 0.0)) - 0.1
        if it > 0 and high - low < 1e-14:
            break
    return math.nan, math.nan, math.nan


@_jit
def run(w, law_p, h, u0, u1, out, series):
    """Strain (m,) after steps of h (m,) s, the supply straight from u0 to u1 (m,) V within each.

    series: None but where the plant has a spring in series (`P_SPRING`): the rest is compiled without, a tenth quicker.
    Goes on from the state in w and leaves it there. nan from where there is no balance of forces.
    """
    if series is None and w[P_SPRING] != HOOKE:
        out[:] = math.nan  # rather than the answer without what the spring is beyond its line
        return
    n, law_id, pair = int(w[P_N]), int(w[P_LAW]), w[P_PAIR] != 0.0
    Y, beta, dE, ec = w[P_Y], w[P_BETA], w[P_DE], w[P_EC]
    share, mm, mb, sy = w[P_SHARE], w[P_MM], w[P_MB], w[P_SY]
    factor, thick, c_eps, chi, aq = w[P_FACTOR], w[P_THICK] != 0.0, w[P_CEPS], w[P_CHI], w[P_AQ]
    rs, c0, active, prompt_D = w[P_RS], w[P_C0], w[P_EACT], w[P_D]
    curved = law_id != HOOKE or beta != 0.0 or dE != 0.0 or share != 0.0 or sy > 0.0
    stretches, stores = thick or c_eps != 0.0, chi != 0.0 or aq != 0.0
    inner, Ys = int(w[P_SPRING]), w[P_YS]
    bends = curved or stretches or series is not None
    cuts = w[P_WHOLE] == 0.0
    currents = rs > 0.0 and pair  # a motion to and fro within a step drives currents that a mean does not know
    remembers = sy / w[P_EY] if sy > 0.0 else 0.0
    enough = _TOLERANCE if bends else _STRAIGHT_TOLERANCE
    smooth = _SMOOTH if sy == 0.0 and share == 0.0 else 1.0
    c, T, x, g = w[A_C:A_C + n], w[A_T:A_T + n], w[A_X:A_X + n], w[A_G:A_G + n]
    g_pair = complex(w[P_GR], w[P_GI])
    z_pair, T_pair = complex(w[X_ZR], w[X_ZI]), complex(w[P_TR], w[P_TI])
    z_kept = 0.0 * z_pair
    c_pair = complex(2.0 * w[P_CR], 2.0 * w[P_CI])
    e, V, vq, P, load, Wm = w[X_E], w[X_V], w[X_VQ], w[X_P], w[X_LOAD], w[X_WM]
    s, t, f, tf = w[X_S], w[X_T], w[X_F], w[X_TF]
    ph, dph = field(thick, c_eps, e)
    new = np.zeros(n)
    # of a spring in series: strain, stress beyond its line, slope of that
    spring, r, rt, spring_part = w[X_SPRING], 0.0, 0.0, 0.0
    if series is not None:
        r, rt = _beyond_line(inner, law_p, Ys, spring)
    lift = curve = middle = 0.0
    rc, charges, leaks = rs * c0, 0.0, 1.0 + rs / w[P_RL]
    D1, D2, step1, length = w[X_D1], w[X_D2], w[X_STEP], -1.0
    tab = w[A_TABLES:A_TABLES + TABLE]
    quick, pair_quick = n, False
    spent, budget = 0, _TRIES_A_STEP * h.size + 20_000
    for i in range(h.size):
        whole, done = h[i], 0.0
        step = whole
        v_start, v_end = u0[i], u1[i]
        while True:
            spent += 1
            if spent > budget:  # a chain too stiff to be worth following
                e = math.nan
                break
            if step != length:
                at = mt.table_of(w, step)
                tab, length = w[at:at + TABLE], step
                quick = n
                while quick > 0 and step > _QUICK * T[quick - 1]:
                    quick -= 1
                pair_quick = pair and step > _QUICK * abs(T_pair)
                charges = step / rc if rs > 0.0 else 0.0
            if done > 0.0 or step < whole:
                rise = (u1[i] - u0[i]) / whole
                v_start, v_end = u0[i] + rise * done, u0[i] + rise * (done + step)
            kept = 0.0
            for j in range(n):
                kept += tab[mt.KEEP + j] * x[j]
            if pair:
                z_kept = complex(tab[mt.KR], tab[mt.KI]) * z_pair
                kept += z_kept.real
            S1 = tab[mt.S1] + prompt_D
            spring_kept, G1, GG1 = 0.0, 0.0, 0.0
            if series is not None:
                for j in range(n):
                    spring_kept += g[j] * tab[mt.KEEP + j] * x[j]
                if pair:
                    spring_kept += (g_pair * z_kept).real
                G1, GG1 = tab[mt.G1] + prompt_D, tab[mt.GG1] + prompt_D
                # beyond its line the spring gives less, the stiffer it is there
                S1 -= G1 * G1 * rt / (1.0 + GG1 * rt)
            # what the material holds against the stress beyond the linear spring
            held, slope0 = s + f - Y * e, t + tf - Y
            # smooth motion goes on as it did: then the first correction is the last
            D = 2.0 * D1 - D2 if step == step1 else 0.0
            if abs(D) > _SMALL:
                D = 0.0
            v1, vm, v2, dv = v_end, 0.5 * (v_start + v_end), 0.0, 0.0
            if rs == 0.0:
                v2 = (v_start * v_start + v_start * v_end + v_end * v_end) * (1.0 / 3.0)
            vq1, P1 = vq, P
            good, centred = False, True
            ss = se = dse = J = change = p0 = p1 = 0.0
            transient = zc = l0 = l1 = dies = m_dies = 0.0
            # a jump of more than a little is followed up by the law itself
            at_jump, held_jump, slope_jump, ph_jump, dph_jump = 0.0, held, slope0, ph, dph
            r0, r_jump, rt_jump, r1, rt1, spring1 = r, r, rt, r, rt, spring + spring_part * D
            s1, t1, f1, tf1, ph1, dph1, W1 = s, t, f, tf, ph, dph, 0.0
            prompt = 0.0
            if rs > 0.0:
                prompt = max(factor * ph * S1 / (1.0 + S1 * (slope0 - factor * V * V * dph)), 0.0)
                vm = V + 0.5 * (v_end - v_start)
            z_new, slope = z_kept, 0.0
            for it in range(_MAX_ITERATIONS):
                e1 = e + D
                if bends and (it > 0 or D != 0.0):
                    if curved:
                        s1, t1, W1 = elastic(law_id, law_p, Y, beta, dE, ec, share, mm, mb, Wm, e1)
                    if sy > 0.0:
                        f1, tf1 = friction(w, e1)
                    if stretches:
                        ph1, dph1 = field(thick, c_eps, e1)
                if bends and not curved:
                    s1 = Y * e1
                if it == 0 or rs > 0.0:
                    if rs > 0.0:
                        if active > 0.0:
                            middle = vm
                            conducts, lift, curve = leaking(w[P_RL], active, w[P_Z0], rs, middle)
                            leaks = 1.0 + rs * conducts
                        v1, vm, v2, dv, zc, transient, l0, l1, dies, m_dies = charge(
                            charges, leaks, c_eps, prompt, e, e1, V, v_start + lift, v_end + lift)
                        if active > 0.0:
                            centred = abs(vm - middle) <= _CENTRED * abs(vm) + _LITTLE_V
                    if stores:
                        vq1, P1, ss, se, dse = stored(tab[mt.Q0:mt.Q2 + 1], tab[mt.P0:mt.P2 + 1], factor, aq, chi, v1,
                                                      vm, v2, dv, vq, P)
                    else:
                        se = factor * v1 * v1
                        ss = 2.0 * factor * v2 - se
                        dse = 2.0 * factor * v1 * dv
                p0, p1 = ss, se
                if bends:
                    # the jump at the start: what is held goes with the strain that follows at once
                    J = 0.0
                    if prompt_D > 0.0:
                        for _ in range(8):
                            # about where the law was worked out last
                            bend = prompt_D * (slope_jump + rt_jump - ss * dph_jump)
                            J = (prompt_D * (ss * ph_jump - held_jump - (r_jump - r) - load)
                                 + bend * at_jump) / (1.0 + bend)
                            if abs(J - at_jump) < _SMALL or not -5.0 < e + J < 0.95:
                                break
                            at_jump = J
                            if curved:
                                held_jump, slope_jump = beyond_spring(w, law_p, Wm, e + J)
                            if stretches:
                                ph_jump, dph_jump = field(thick, c_eps, e + J)
                            if series is not None:
                                r_jump, rt_jump = _beyond_line(inner, law_p, Ys, spring + J)
                        r0 = r_jump + rt_jump * (J - at_jump)
                        p0 = load + J / prompt_D + (r0 - r)
                    else:
                        p0 = ss * ph - held
                    p1 = se * ph1 - (s1 + f1 - Y * e1)
                found = kept + prompt_D * p1
                a = first = second = line0 = line1 = 0.0
                if transient != 0.0 and (quick < n or pair_quick):
                    # the dying part of the charging, and the line beside it
                    a, m = dies, m_dies
                    level = l0 + l1 * (m - a) / (1.0 - a) - 0.5 * (vq + vq1)
                    first = factor * ph * (2.0 * level + 0.5 * (P + P1)) * transient
                    second = factor * ph * transient * transient
                    line1 = p1 - first * a - second * a * a
                    line0 = p0 + p1 - 2.0 * first * m - second * m * (1.0 + a) - line1
                if a == 0.0:
                    found += tab[mt.S0] * p0 + tab[mt.S1] * p1
                else:
                    for j in range(n):
                        if j < quick:
                            new[j] = tab[mt.W0 + j] * p0 + tab[mt.W1 + j] * p1
                        else:
                            new[j] = (tab[mt.W0 + j] * line0 + tab[mt.W1 + j] * line1
                                      + c[j] * mt.dying(tab[mt.LONG + j], tab[mt.KEEP + j], zc, a, first, second))
                        found += new[j]
                    if pair:
                        w0, w1 = complex(tab[mt.AR], tab[mt.AI]), complex(tab[mt.BR], tab[mt.BI])
                        if pair_quick:
                            y_pair, stay_pair = step / T_pair, complex(tab[mt.KR], tab[mt.KI])
                            z_new = w0 * line0 + w1 * line1 + c_pair * mt.dying(y_pair, stay_pair, zc + 0j, a + 0j,
                                                                                first, second)
                        else:
                            z_new = w0 * p0 + w1 * p1
                        found += z_new.real
                if series is not None:
                    # the spring's strain that goes with the stress at the end; what dies in the step is in `new`
                    drive = spring_kept + prompt_D * p1
                    if a == 0.0:
                        drive += tab[mt.G0] * p0 + tab[mt.G1] * p1
                    else:
                        for j in range(n):
                            drive += g[j] * new[j]
                        if pair:
                            drive += (g_pair * z_new).real
                    spring1, r1, rt1 = _in_series(inner, law_p, Ys, spring1, drive - tab[mt.GG0] * r0, GG1)
                    found -= tab[mt.G0] * r0 + G1 * r1
                    S1 = tab[mt.S1] + prompt_D - G1 * G1 * rt1 / (1.0 + GG1 * rt1)
                slope = ph1 * dse + se * dph1 - (t1 + tf1 - Y) if bends else dse
                change = (found - e1) / (1.0 - S1 * slope)
                if it > 25:
                    change *= 0.5  # to and fro across a corner of friction or softening
                D += change
                if (not bends and rs == 0.0) or (abs(change) < enough and (it > 0 or change != D or not bends)
                                                 and centred):
                    good = True
                    p1 += slope * change
                    W1 += s1 * change
                    s1 += t1 * change
                    f1 += tf1 * change
                    ph1 += dph1 * change
                    v1 += dv * change
                    if series is not None:
                        moved = G1 * slope * change / (1.0 + GG1 * rt1)
                        spring1 += moved
                        r1 += rt1 * moved
                    if a != 0.0:
                        for j in range(n):
                            new[j] += tab[mt.W1 + j] * slope * change
                        if pair:
                            z_new += complex(tab[mt.BR], tab[mt.BI]) * slope * change
                    break
                if abs(change) > 0.1:
                    D += math.copysign(0.1, change) - change
                if not -5.0 < e + D < 0.95:
                    break
            if not good or math.isnan(D):
                e = math.nan
                break
            grow = 2.0
            aside, pushed, r_aside = 0.0, 0.0, 0.0
            if cuts and (curved or stretches or currents or tab[mt.GALL] > 0.0) and step > _SHORTEST * whole:
                # the middle as the modes know it, and the straight line that the law was taken along
                mid = 0.5 * prompt_D * (p0 + p1) + tab[mt.U0] * p0 + tab[mt.U1] * p1
                for j in range(n):
                    mid += tab[mt.HALF + j] * x[j]
                if series is not None:
                    # the same of the spring, and what its law is there beside its line
                    mid -= 0.5 * prompt_D * (r0 + r1) + tab[mt.GU0] * r0 + tab[mt.GU1] * r1
                    within = (0.5 * prompt_D * (p0 + p1 - r0 - r1) + tab[mt.GU0] * p0 + tab[mt.GU1] * p1
                              - tab[mt.GGU0] * r0 - tab[mt.GGU1] * r1)
                    for j in range(n):
                        within += g[j] * tab[mt.HALF + j] * x[j]
                    if pair:
                        within += (g_pair * complex(tab[mt.HR], tab[mt.HI]) * z_pair).real
                    along = 0.5 * (r0 + r1)
                    _, r_aside, _ = _in_series(inner, law_p, Ys, within, within + prompt_D * along, prompt_D)
                    r_aside -= along
                    mid -= prompt_D * r_aside
                    worst = 2.0 / 3.0 * tab[mt.GALL] * _SMOOTH * abs(r_aside)
                    step, grow = judged(step, grow, worst, _COURSE_TOLERANCE, 1.0 / 3.0, 8.0)
                    if step < length:
                        continue
                y = D - J
                ring = 0.0
                if pair:
                    mid += (complex(tab[mt.HR], tab[mt.HI]) * z_pair).real
                    if step > abs(T_pair):
                        # what swings to and fro within the step may be in the middle just where it began
                        ring = abs(z_pair - c_pair * (p0 - T_pair * (p1 - p0) / step))
                beside = mid - e - 0.5 * (D + J)
                off = abs(beside) + ring
                slope1 = t1 + tf1 - Y - se * dph1
                first_slope = slope0 - ss * dph
                wrong = off * max(abs(first_slope), abs(slope1)) + 0.125 * abs((slope1 - first_slope) * y)
                # volts that a motion beside the line moves, and the stress that they are
                moves = 4.0 * se * rc / (rc + step) if currents else 0.0
                turned = moves * ring
                if (sy > 0.0 or share > 0.0) and 4.0 * off > abs(y):
                    # a turn within the step, which friction and softening remember
                    turned += 3.0 * (remembers + share * t1) * (4.0 * off - abs(y)) ** 2 / (16.0 * off)
                worst = 2.0 / 3.0 * tab[mt.ALL] * (wrong + turned + moves * abs(beside))
                if worst > 0.02 * _COURSE_TOLERANCE:
                    # the law in the middle
                    holds = beyond_spring(w, law_p, Wm, mid)[0] if curved else 0.0
                    if stretches:
                        phm, _ = field(thick, c_eps, mid)
                        holds -= 0.5 * (ss + se) * (phm - ph)
                    aside = 0.5 * ((ss + se) * ph - p0 - p1) - holds
                    wrong = smooth * abs(aside) + ring * max(abs(first_slope), abs(slope1))
                    aside -= moves * beside
                    worst = 2.0 / 3.0 * tab[mt.ALL] * (wrong + turned + moves * abs(beside))
                    step, grow = judged(step, grow, worst, _COURSE_TOLERANCE, 1.0 / 3.0, 8.0)
                    if step < length:
                        continue
            if cuts and a == 0.0 and v_start != v_end and step > _SHORTEST * whole:
                # the square of a straight voltage, where modes are quick enough to see that it is no line
                volts = (V if rs > 0.0 else v_start) - vq
                wrong = 3.0 * abs((ss - factor * (volts + P) * volts) * ph) * tab[mt.BOW]
                step, grow = judged(step, grow, wrong, _CIRCUIT_TOLERANCE, 0.25, 4.0)
                if step < length:
                    continue
            if cuts and rs > 0.0 and abs(D) > _SMALL and step > 1e-6 * whole:
                wrong = early_current(e, D, charges, V, v1)
                if wrong > _CIRCUIT_TOLERANCE and charges > 1.0:
                    # a step of several time constants says nothing about one within the first
                    step = halved(step, rc / step)
                    continue
                step, grow = judged(step, grow, wrong, _CIRCUIT_TOLERANCE, 1.0 / 3.0, 8.0)
                if step < length:
                    continue
            if cuts and active > 0.0 and step > 1e-6 * whole:
                wrong = bent_leak(e + D, leaks, curve, charges, V, v1)
                step, grow = judged(step, grow, wrong, _CIRCUIT_TOLERANCE, 0.5, 4.0)
                if step < length:
                    continue
            if aside != 0.0 or r_aside != 0.0:
                # what is held in the middle beside the line, as a parabola
                pushed = tab[mt.SM] * aside
                if series is not None:
                    # the spring's strain without its answer, then with it
                    inside = (tab[mt.GM] * aside - tab[mt.GGM] * r_aside) / (1.0 + GG1 * rt1)
                    pushed -= tab[mt.GM] * r_aside + G1 * rt1 * inside
                pushed /= 1.0 - S1 * slope
                D += pushed
                if series is not None:
                    inside += G1 * slope * pushed / (1.0 + GG1 * rt1)
                    spring1 += inside
                    r1 += rt1 * inside
                p1 += slope * pushed
                W1 += s1 * pushed
                s1 += t1 * pushed
                f1 += tf1 * pushed
                ph1 += dph1 * pushed
                v1 += dv * pushed
            if a == 0.0:
                for j in range(n):
                    x[j] = (tab[mt.KEEP + j] * x[j] + tab[mt.W0 + j] * p0 + tab[mt.W1 + j] * p1
                            + tab[mt.WM + j] * aside)
                if pair:
                    z_pair = z_kept + complex(tab[mt.AR], tab[mt.AI]) * p0 + complex(tab[mt.BR], tab[mt.BI]) * p1
            else:
                for j in range(n):
                    x[j] = (tab[mt.KEEP + j] * x[j] + new[j] + tab[mt.W1 + j] * slope * pushed
                            + tab[mt.WM + j] * aside)
                if pair:
                    z_pair = z_kept + z_new + complex(tab[mt.BR], tab[mt.BI]) * slope * pushed
            if series is not None:
                for j in range(n):
                    x[j] -= g[j] * (tab[mt.W0 + j] * r0 + tab[mt.W1 + j] * r1 + tab[mt.WM + j] * r_aside)
                if pair:
                    z_pair -= g_pair * (complex(tab[mt.AR], tab[mt.AI]) * r0 + complex(tab[mt.BR], tab[mt.BI]) * r1
                                        + complex(tab[mt.MR], tab[mt.MI]) * r_aside)
                spring_part = (spring1 - spring) / D if abs(D) > _TOLERANCE else 0.0
                spring, r, rt = spring1, r1, rt1
            if pair:
                z_pair += complex(tab[mt.MR], tab[mt.MI]) * aside
            e += D
            if sy > 0.0:
                commit_friction(w, e, f1)
            if not curved:
                s1 = Y * e
            s, t, f, tf, ph, dph, V, vq, P, load = s1, t1, f1, tf1, ph1, dph1, v1, vq1, P1, p1
            Wm = max(Wm, W1)
            D2, D1, step1 = D1 if step == step1 else D, D, step
            done += step
            if done >= whole * (1.0 - 1e-12):
                break
            step = following(step, grow, whole - done)
        out[i] = e
        if math.isnan(e):
            out[i:] = math.nan
            break
    w[X_E], w[X_V], w[X_VQ], w[X_P], w[X_LOAD], w[X_WM] = e, V, vq, P, load, Wm
    w[X_S], w[X_T], w[X_F], w[X_TF] = s, t, f, tf
    w[X_ZR], w[X_ZI] = z_pair.real, z_pair.imag
    w[X_D1], w[X_D2], w[X_STEP], w[X_SPRING] = D1, D2, step1, spring
    w[X_TRIED] += spent


@_jit
def prepare(w, law_p):
    """Fill in what follows from the numbers of a plant, and the state of a rested one."""
    rested(w, law_p)
    w[X_V:X_TRIED + 1] = 0.0
    w[A_X:A_X + MODES] = 0.0
    w[X_STEP] = -1.0
    w[A_H:A_H + TABLES] = -1.0


@_jit
def drive_voltage(w, law_p, h, u0, u1, out, series):
    """Strain (m,) at nodes after steps h (m,) s, the supply straight from u0 to u1 (m,) V within each; rested.

    w (SIZE,) holds the numbers of the plant; its state is overwritten.
    """
    prepare(w, law_p)
    run(w, law_p, h, u0, u1, out, series)

"""Coefficients of one step of the modes, kept for the few lengths that steps have: see `plant_kernel`."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .circuit_kernel import fold, place, straight
from .plant_layout import (
    A_C,
    A_G,
    A_H,
    A_T,
    A_TABLES,
    MODES,
    P_AQ,
    P_CHI,
    P_CI,
    P_CR,
    P_GI,
    P_GR,
    P_N,
    P_PAIR,
    P_SPRING,
    P_TAUD,
    P_TAUQ,
    P_TI,
    P_TR,
    TABLE,
    TABLES,
)
from .static import HOOKE

_jit = njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})

# ---- of a table: what stays of modes, weights of the stress's start and end, what stays to the middle, weight of what
# the stress in the middle is beside its line, length of the step in time constants; then sums
KEEP, W0, W1, HALF, WM, LONG = 0, MODES, 2 * MODES, 3 * MODES, 4 * MODES, 5 * MODES
(
    S0, S1, SM, U0, U1, ALL,  # sums of weights, to the end and to the middle; of what a step can do at all
    BOW,  # strain (1/Pa) at the end by a parabola that is taken as a line, at most
    KR, KI, AR, AI, BR, BI, MR, MI, HR, HI,  # the pair: what stays, weights, what stays to the middle
    Q0, Q1, Q2, P0, P1, P2,  # stored charge, polarisation
    G0, G1, GM, GU0, GU1, GALL,  # as S0 to ALL, of modes as the spring in series shows them
    GG0, GG1, GGM, GGU0, GGU1,  # the same, driven from there
) = range(6 * MODES, 6 * MODES + 34)


@_jit
def _lag(z):
    """A lag after z time constants: what stays of it, weights of a straight input's start and end, and of what the
    input is in the middle beside that line, if it is a parabola. z may be complex."""
    if abs(z) < 0.02:
        m = 1.0 - z * (0.5 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z / 120.0)))
        second = z * (0.5 - z * (1.0 / 6.0 - z * (1.0 / 24.0 - z / 120.0)))
        return 1.0 - z * m, z * m - second, second, z * (2.0 / 3.0 - z * (1.0 / 3.0 - z * (0.1 - z / 45.0)))
    stays = np.exp(-z)
    m = (1.0 - stays) / z
    first = m - stays
    return stays, first, 1.0 - m, 4.0 * (first * (1.0 - 2.0 / z) + stays)


@_jit
def _bowed(z, most):
    """What a lag of z time constants has at its end of a stress t (t - 1), above the line of its mean and end."""
    return min(z * z / 36.0, most, 2.0 / (3.0 * z) if z > 1.0 else 1.0)


@_jit
def _fill_series(tab, gamma, first, second, beside, middle0, middle1):
    """Add a mode's weights to the sums that a spring in series has; all may be complex."""
    once, twice = gamma, gamma * gamma
    tab[G0] += (once * first).real
    tab[G1] += (once * second).real
    tab[GM] += (once * beside).real
    tab[GU0] += (once * middle0).real
    tab[GU1] += (once * middle1).real
    tab[GG0] += (twice * first).real
    tab[GG1] += (twice * second).real
    tab[GGM] += (twice * beside).real
    tab[GGU0] += (twice * middle0).real
    tab[GGU1] += (twice * middle1).real
    tab[GALL] += abs(once * (first + second))


@_jit
def _fill_table(w, tab, h):
    """Coefficients of a step of length h (s)."""
    tab[S0:HI + 1] = 0.0
    tab[G0:GGU1 + 1] = 0.0
    series = w[P_SPRING] != HOOKE
    for j in range(int(w[P_N])):
        c = w[A_C + j]
        stays, first, second, beside = _lag(h / w[A_T + j])
        half, u0, u1, _ = _lag(0.5 * h / w[A_T + j])
        tab[KEEP + j], tab[W0 + j], tab[W1 + j], tab[HALF + j] = stays, c * first, c * second, half
        tab[WM + j] = c * beside
        tab[LONG + j] = h / w[A_T + j]
        tab[SM] += c * beside
        tab[S0] += c * first
        tab[S1] += c * second
        tab[U0] += c * (u0 + 0.5 * u1)
        tab[U1] += c * 0.5 * u1
        tab[ALL] += abs(c) * (first + second)
        tab[BOW] += abs(c) * _bowed(h / w[A_T + j], 0.06)
        if series:
            _fill_series(tab, w[A_G + j], c * first, c * second, c * beside, c * (u0 + 0.5 * u1), c * 0.5 * u1)
    if w[P_PAIR] != 0.0:
        c, T = complex(2.0 * w[P_CR], 2.0 * w[P_CI]), complex(w[P_TR], w[P_TI])
        kept, first, second, aside = _lag(h / T)
        halved, v0, v1, _ = _lag(0.5 * h / T)
        tab[KR], tab[KI], tab[HR], tab[HI] = kept.real, kept.imag, halved.real, halved.imag
        first, second, aside, v0, v1 = c * first, c * second, c * aside, c * v0, c * v1
        tab[MR], tab[MI] = aside.real, aside.imag
        tab[SM] += aside.real
        tab[AR], tab[AI], tab[BR], tab[BI] = first.real, first.imag, second.real, second.imag
        tab[S0] += first.real
        tab[S1] += second.real
        tab[U0] += v0.real + 0.5 * v1.real
        tab[U1] += 0.5 * v1.real
        tab[ALL] += abs(first + second)
        tab[BOW] += abs(c) * _bowed(abs(h / T), 0.2)
        if series:
            _fill_series(tab, complex(w[P_GR], w[P_GI]), first, second, aside, v0 + 0.5 * v1, 0.5 * v1)
    if w[P_AQ] != 0.0:
        tab[Q0], tab[Q1], tab[Q2] = straight(h / w[P_TAUQ])
    if w[P_CHI] != 0.0:
        tab[P0], tab[P1], tab[P2] = straight(h / w[P_TAUD])


@_jit
def table_of(w, h):
    """Where the coefficients of a step of length h (s) begin; those of a few lengths need not be worked out again."""
    k = place(h, TABLES)
    at = A_TABLES + k * TABLE
    if h != w[A_H + k]:
        w[A_H + k] = h
        _fill_table(w, w[at:at + TABLE], h)
    return at


@fold
def dying(z, keep, x, left, first, second):
    """What a mode of z time constants in a step has at its end of first exp(-x t/h) + second exp(-2 x t/h).

    left: what exp(-x t/h) is there then.
    """
    d, d2 = z - x, z - 2.0 * x
    if abs(d) < 1e-3:
        return z * (first * left * (1.0 - d * (0.5 - d / 6.0)) + second * (left * left - keep) / d2)
    if abs(d2) < 1e-3:
        return z * (first * (left - keep) / d + second * left * left * (1.0 - d2 * (0.5 - d2 / 6.0)))
    return z * (first * (left - keep) * d2 + second * (left * left - keep) * d) / (d * d2)

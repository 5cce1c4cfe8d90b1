"""Where the numbers and the state of a plant under voltage stand in the one array that its kernel takes."""

from __future__ import annotations

from .material_kernel import BEYOND

# ---- numbers of a plant, behind those of the material
(
    P_FACTOR, P_THICK, P_CEPS, P_CHI, P_TAUD,  # stress
    P_RS, P_RL, P_C0, P_EACT, P_Z0,  # circuit
    P_AQ, P_TAUQ,  # stored charge
    P_N, P_D, P_PAIR,  # real modes, strain that follows the stress at once (1/Pa), whether a pair swings
    P_CR, P_CI, P_TR, P_TI,  # the pair's first: coefficient (1/Pa), time constant (s)
    P_WHOLE,  # whether steps are taken as they are, however wrong
    P_SPRING, P_YS, P_GR, P_GI,  # law and modulus (Pa) of a curved spring in series; the pair's gamma (`series_modes`)
) = range(BEYOND, BEYOND + 24)

# ---- numbers that go from step to step
(
    X_V, X_VQ, X_P, X_LOAD,  # volts on the dielectric, stored charge, polarisation, stress on the linear network
    X_ZR, X_ZI,  # state of the pair
    X_D1, X_D2, X_STEP,  # the last two changes of the strain, and the length of their steps
    X_SPRING,  # strain of the curved spring in series
    X_TRIED,  # steps tried since the state was prepared
) = range(BEYOND + 24, BEYOND + 35)

#: most real modes
MODES = 28
#: what is kept of a length of step beside the modes: sums of weights, the pair, lags of stored charge and polarisation
SUMS = 36
TABLE = 6 * MODES + SUMS
#: lengths of steps of which coefficients are kept; a power of two
TABLES = 32
A_H = BEYOND + 36  # the lengths
A_C = A_H + TABLES
A_T = A_C + MODES
A_X = A_T + MODES
A_G = A_X + MODES
A_TABLES = A_G + MODES
SIZE = A_TABLES + TABLES * TABLE

"""State space of a linear network in modal coordinates, continuous and discrete.

With input u and output y, direct compliance d and modes of gain g_j and time constant T_j,

    x_j' = -x_j/T_j + b_j u,    y = sum c_j x_j + d u,    b_j = |c_j| = sqrt(|g_j|/T_j)

A is diagonal, the slowest mode first; input and output of a state carry its gain evenly. A companion form of the same
system has entries that span tens of decades and loses its slow modes to rounding.

Discrete systems take one row of input and give one row of output; which part of the time the input of row k was in
force is the campaign's convention `hold` (CONTRACT 1):

* ``end``: until the row's time: x_k = Ad x_(k-1) + Bd u_k, y_k = C x_k + d u_k. Written as an ordinary system with
  z_k = Ad x_(k-1): z_(k+1) = Ad z_k + Ad Bd u_k, y_k = C z_k + (C Bd + d) u_k.
* ``start``: from the row's time on, the reading being taken just before: x_(k+1) = Ad x_k + Bd u_k,
  y_k = C x_k + d u_(k-1). Where d is not zero one more state remembers u_(k-1).
* ``zoh``: what c2d(sys, Ts, 'zoh') of MATLAB and python-control gives: as start, the reading just after:
  y_k = C x_k + d u_k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DISCRETE = ("end", "start", "zoh")


@dataclass(frozen=True)
class StateSpace:
    """A (m, m) 1/s, B (m, 1), C (1, m), D (1, 1), and Ad, Bd, Cd, Dd of the discrete system with sample time Ts (s).

    u, y and hence D in the units of input and output; the states have no unit of their own.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    Ad: Array
    Bd: Array
    Cd: Array
    Dd: Array
    Ts: float


MATRICES = ("A", "B", "C", "D", "Ad", "Bd", "Cd", "Dd")


def from_modes(direct: float, gain: Array, T: Array, Ts: float, hold: str) -> StateSpace:
    """State space of y = direct u + sum gain_j lag_j(u); gain (m,), T (m,) s, Ts s, hold one of DISCRETE."""
    order = np.argsort(-T, kind="stable")
    gain, T = gain[order], T[order]
    share = np.sqrt(np.abs(gain) / T)
    A, B = np.diag(-1.0 / T), share[:, None]
    C, D = (np.sign(gain) * share)[None], np.array([[float(direct)]])
    Ad, Bd, Cd, Dd = np.diag(np.exp(-Ts / T)), (share * T * -np.expm1(-Ts / T))[:, None], C, D
    if hold == "end":
        Bd, Dd = Ad @ Bd, D + C @ Bd
    elif hold == "start" and direct != 0.0:
        split = np.sqrt(abs(direct))
        Ad = np.pad(Ad, ((0, 1), (0, 1)))
        Bd = np.vstack([Bd, [[split]]])
        Cd = np.hstack([C, [[np.sign(direct) * split]]])
        Dd = np.zeros((1, 1))
    return StateSpace(A, B, C, D, Ad, Bd, Cd, Dd, Ts)

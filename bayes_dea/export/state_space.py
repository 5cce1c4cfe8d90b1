"""State space of a linear network in modal coordinates, continuous and discrete.

With input u and output y, direct compliance d and modes of gain g_j and time constant T_j,

    x_j' = -x_j/T_j + b_j u,    y = sum c_j x_j + d u,    b_j = |c_j| = sqrt(|g_j|/T_j)

A is diagonal, the slowest mode first; input and output of a state carry its gain evenly. A companion form of the same
system has entries that span tens of decades and loses its slow modes to rounding. A pair of modes that swings (complex
g and T) has two states and a block [[p, -w], [w, p]] of its pole p + iw in A, its input on the first.

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
from typing import Any

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


def from_modes(direct: float, gain: NDArray[Any], T: NDArray[Any], Ts: float, hold: str) -> StateSpace:
    """State space of y = direct u + sum gain_j lag_j(u); gain (m,), T (m,) s, Ts s, hold one of DISCRETE.

    gain and T may be complex, in conjugate pairs.
    """
    pole = -1.0 / T
    first = np.flatnonzero(pole.imag >= 0.0)  # one of each pair
    first = first[np.argsort(1.0 / pole.real[first], kind="stable")]
    m = T.size
    A, B, C, Ad, Bd = np.zeros((m, m)), np.zeros((m, 1)), np.zeros((1, m)), np.zeros((m, m)), np.zeros((m, 1))
    i = 0
    for j in first:
        swings = pole[j].imag > 0.0
        share = np.sqrt((2.0 if swings else 1.0) * np.abs(gain[j]) / np.abs(T[j]))
        decay = np.exp(pole[j] * Ts)
        fed = share * -T[j] * np.expm1(pole[j] * Ts)
        B[i, 0] = share
        if swings:
            # the state is z = share T f, of which y takes the real part of 2 gain f
            A[i : i + 2, i : i + 2], Ad[i : i + 2, i : i + 2] = _turning(pole[j]), _turning(decay)
            Bd[i : i + 2, 0] = fed.real, fed.imag
            shown = 2.0 * gain[j] / (share * T[j]) if share > 0.0 else 0.0j
            C[0, i : i + 2] = shown.real, -shown.imag
        else:
            A[i, i], Ad[i, i], Bd[i, 0] = pole[j].real, decay.real, fed.real
            C[0, i] = np.sign(gain[j].real) * share
        i += 2 if swings else 1
    D = np.array([[float(direct)]])
    Cd, Dd = C, D
    if hold == "end":
        Bd, Dd = Ad @ Bd, D + C @ Bd
    elif hold == "start" and direct != 0.0:
        split = np.sqrt(abs(direct))
        Ad = np.pad(Ad, ((0, 1), (0, 1)))
        Bd = np.vstack([Bd, [[split]]])
        Cd = np.hstack([C, [[np.sign(direct) * split]]])
        Dd = np.zeros((1, 1))
    return StateSpace(A, B, C, D, Ad, Bd, Cd, Dd, Ts)


def _turning(z: complex) -> Array:
    """Times z, of real and imaginary part."""
    return np.array([[z.real, -z.imag], [z.imag, z.real]])

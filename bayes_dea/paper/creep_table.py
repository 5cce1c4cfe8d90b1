"""Table SVIII by itself: is every row the discretised cascade of Eq. (13), and what do its poles say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .printed import StateSpaceRow


@dataclass(frozen=True)
class CascadeCheck:
    """A row against the zero-order hold of x1' = -p1 x1 + g x2, x2' = -p2 x2 + x3, x3' = -p3 x3 + b u at Ts.

    Each element beside what the row's own poles give; `fits`: within half of the last printed digit of the element and
    what the rounding of the poles leaves.
    """

    voltage_V: int
    A23: tuple[float, float]
    B2: tuple[float, float]
    B3: tuple[float, float]
    fits: bool


def cascade_check(row: StateSpaceRow) -> CascadeCheck:
    """Elements from the poles; the input gain b is the power of two that comes nearest (scaling by powers of two)."""
    p2, p3 = row.poles_per_s[1:]
    A22, A33 = row.A[1, 1], row.A[2, 2]
    Ts = row.sample_time_s
    b = 2.0 ** round(np.log2(row.B[2] * p3 / (1.0 - A33)))
    if p3 == p2:
        A23 = Ts * A22
        B2 = b * ((1.0 - A22) / p2**2 - Ts * A22 / p2)
    else:
        A23 = (A22 - A33) / (p3 - p2)
        B2 = b / (p3 - p2) * ((1.0 - A22) / p2 - (1.0 - A33) / p3)
    B3 = b * (1.0 - A33) / p3
    half = 0.5e-4
    # a pole is rounded to 4 decimals as well: how far that moves the element of the fastest mode
    d_p3 = half / A33 / Ts
    loose_B3 = abs(b * (1.0 - A33) / p3**2) * d_p3 + b * half / p3
    fits = (
        abs(A23 - row.A[1, 2]) <= half * 1.2
        and abs(B2 - row.B[1]) <= half * 1.2
        and abs(B3 - row.B[2]) <= half + loose_B3
    )
    return CascadeCheck(
        round(row.voltage_V), (row.A[1, 2], float(A23)), (row.B[1], float(B2)), (row.B[2], float(B3)), bool(fits)
    )

"""The paper's models on any command: with one set of parameters, and with a look-up table over the voltage.

A look-up interpolates every parameter linearly in the voltage of the moment, as Simulink's n-D Lookup Table does, and
puts it into the differential equations of the model, whose states stay as they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from ..models.lags import make_drive, simulate_modes
from .printed import printed
from .reconstruct import hooke_displacement
from .swarm_fits import Geometry, modes_of

Array = NDArray[np.float64]


@njit(cache=True)
def _maxwell_rows(h, s, Y, k, d, d0, e):  # type: ignore[no-untyped-def]
    """Strain (n,) of Y, d0 and three Maxwell branches under stress s held over each step; k, d (n, 3) of each row.

    Eq. (6) exactly over a step with its parameters and a constant strain rate; the balance holds at its end.
    """
    q = np.zeros(3)
    last = 0.0
    for i in range(s.size):
        left, stiff = s[i], Y
        for j in range(3):
            tau = d[i, j] / k[i, j]
            a = np.exp(-h / tau)
            w = k[i, j] * tau / h * (1.0 - a)
            q[j] *= a
            left += w * last - q[j]
            stiff += w
        if d0[i] > 0.0:
            left += d0[i] / h * last
            stiff += d0[i] / h
        e[i] = left / stiff
        for j in range(3):
            tau = d[i, j] / k[i, j]
            q[j] += k[i, j] * tau / h * (1.0 - np.exp(-h / tau)) * (e[i] - last)
        last = e[i]


@njit(cache=True)
def _kelvin_rows(h, s, k, d, e):  # type: ignore[no-untyped-def]
    """Strain (n,) of a spring k[:, 0] and three Kelvin-Voigt elements in series; k (n, 4), d (n, 3) of each row."""
    state = np.zeros(3)
    for i in range(s.size):
        e[i] = s[i] / k[i, 0]
        for j in range(3):
            a = np.exp(-h * k[i, j + 1] / d[i, j])
            state[j] = a * state[j] + (1.0 - a) * s[i] / k[i, j + 1]
            e[i] += state[j]


@njit(cache=True)
def _state_rows(u, A, B, C, every, y):  # type: ignore[no-untyped-def]
    """Output (n,) of x+ = A x + B u with matrices of each row, stepped at every so many rows and held between."""
    x = np.zeros(3)
    out = 0.0
    for i in range(u.size):
        if i % every == 0:
            new = B[i] * u[i]
            for r in range(3):
                for c in range(3):
                    new[r] += A[i, r, c] * x[c]
            x = new
            out = C[i, 0] * x[0] + C[i, 1] * x[1] + C[i, 2] * x[2]
        y[i] = out


def looked_up(table_V: Array, table: Array, voltage_V: Array) -> Array:
    """Linear interpolation of each column of `table` (K, ...) at voltages (n,), the ends held; (n, ...)."""
    v = np.clip(np.abs(voltage_V), table_V[0], table_V[-1])
    at = np.clip(np.searchsorted(table_V, v, side="right") - 1, 0, table_V.size - 2)
    w = (v - table_V[at]) / (table_V[at + 1] - table_V[at])
    w = w.reshape(-1, *([1] * (table.ndim - 1)))
    return np.asarray(table[at] * (1.0 - w) + table[at + 1] * w)


def fixed_answer(model: str, p: Array, time_s: Array, command_V: Array, g: Geometry) -> Array:
    """Displacement (n,) in m with one set of parameters, exactly."""
    D, c, T = modes_of(model, p)
    drive = make_drive(time_s, g.stress_per_V2 * command_V**2, "end")
    return g.stroke_m * simulate_modes(drive, float(D[0]), c[0], T[0])[0]


def lookup_answer(model: str, table_V: Array, table: Array, time_s: Array, command_V: Array, g: Geometry) -> Array:
    """Displacement (n,) in m with every parameter looked up; `table` (K, d) in the order of the model."""
    p = np.ascontiguousarray(looked_up(table_V, table, command_V))
    h = float(time_s[1] - time_s[0])
    s = g.stress_per_V2 * command_V**2
    e = np.empty(s.size)
    if model == "gkv":
        _kelvin_rows(h, s, np.ascontiguousarray(p[:, :4]), np.ascontiguousarray(p[:, 4:]), e)
    else:
        d0 = np.ascontiguousarray(p[:, 6]) if model == "gkm" else np.zeros(s.size)
        _maxwell_rows(
            h, s, printed().maxwell.Y_Pa, np.ascontiguousarray(p[:, :3]), np.ascontiguousarray(p[:, 3:6]), d0, e
        )
    return g.stroke_m * e


def state_space_answer(time_s: Array, command_V: Array, actuator: str) -> Array:
    """Model 4: Table SVIII looked up, driven by the static Hooke displacement, stepped every 10 ms; (n,) in m."""
    p = printed()
    rows = [p.state_space[v] for v in sorted(p.state_space)]
    table_V = np.array([r.voltage_V for r in rows])
    A, B, C = (
        looked_up(table_V, np.array(m), command_V)
        for m in ([r.A_used for r in rows], [r.B for r in rows], [r.C for r in rows])
    )
    every = round(rows[0].sample_time_s / float(time_s[1] - time_s[0]))
    y = np.empty(time_s.size)
    _state_rows(
        hooke_displacement(p, command_V, actuator),
        np.ascontiguousarray(A),
        np.ascontiguousarray(B),
        np.ascontiguousarray(C),
        every,
        y,
    )
    return y

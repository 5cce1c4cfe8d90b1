"""Exact responses of first-order lags to held or linear inputs, on even or uneven time steps.

A lag T f' = s - f is discretised exactly for what the input does between two rows (CONTRACT, `hold`):

* ``end``: the row's input was in force during the interval that ends at the row;
* ``start``: the row's input is in force during the interval that begins at the row; a reading at the row still shows
  what the row before commanded, so that this is ``end`` one row later;
* ``linear``: the voltage runs linearly between rows, so the stress, its square, is quadratic.

There is no solver and no step-size error. At even steps one pass takes four modes and four rows at a time
(`four_rows`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..campaign.scratch import BLOCK, beside, pieces
from ..compiled import njit
from ..errors import InputError
from .four_rows import ROWS, four_rows

HOLD_CODES = {"end": 0, "start": 0, "linear": 2}  # a start is an end one row later

# input held: the four rows of a block; linear voltage: the row before as well, and the middles
_held, _held_added = four_rows(ROWS, 0, False), four_rows(ROWS, 0, True)
_linear, _linear_added = four_rows(ROWS + 1, ROWS, False), four_rows(ROWS + 1, ROWS, True)

#: states below this (Pa, or m Pa) have died: left alone they would go on to numbers below 1e-308, which processors
#: work out in microcode, tens of times slower, for as long as the input stays zero
_DEAD = 1e-150
#: rows after which that is asked, where every row is worked out by itself, and blocks of four rows
_EVERY_ROWS, _EVERY_BLOCKS = 16, 256


@dataclass(frozen=True)
class Drive:
    """Input of one recording, ready for the kernels.

    dt: (n,) s, dt[i] = time from row i-1 to row i, dt[0] = 0. uniform: the common step or 0.0.
    stress: (n,) Pa at the rows. middle: (n,) Pa half-way between row i-1 and row i (only read for ``linear``).
    """

    dt: NDArray[np.float64]
    uniform: float
    stress: NDArray[np.float64]
    middle: NDArray[np.float64]
    hold: int

    @property
    def n(self) -> int:
        """Number of rows."""
        return int(self.stress.size)

    @property
    def span(self) -> float:
        """Length in s."""
        return float(self.dt.sum())


def even_step(time_s: NDArray[np.float64], tolerance: float = 2e-3) -> float:
    """The common step of an evenly sampled time column, or 0.0.

    Time stamps are often rounded in the file; a stamp within `tolerance` of a step of its place counts as there.
    """
    n = time_s.size
    if n < 3:
        return 0.0
    step = (time_s[-1] - time_s[0]) / (n - 1)
    for part in pieces(n, BLOCK):
        ideal = time_s[0] + step * np.arange(part.start, part.stop)
        if not np.max(np.abs(time_s[part] - ideal)) <= tolerance * step:
            return 0.0
    return float(step)


def make_drive(time_s: NDArray, stress: NDArray, hold: str, middle: NDArray | None = None) -> Drive:
    """Drive from rows; `middle` (stress half-way between rows) is needed for hold = "linear" only.

    Raises InputError when time does not rise or `hold` is unknown.
    """
    if hold not in HOLD_CODES:
        raise InputError(f"hold = '{hold}' is unknown; one of {', '.join(HOLD_CODES)}")
    time_s = np.ascontiguousarray(time_s, float)
    stress = np.ascontiguousarray(stress, float)
    dt = beside(time_s)
    for part in pieces(max(time_s.size - 1, 0), BLOCK):
        here = np.diff(time_s[part.start : part.stop + 1])
        if np.any(here <= 0):
            row = part.start + int(np.argmax(here <= 0)) + 1
            raise InputError(f"time does not rise at sample {row}: {time_s[row - 1]} s, then {time_s[row]} s")
        dt[part.start + 1 : part.stop + 1] = here
    step = even_step(time_s)
    if step > 0:
        dt[1:] = step
    if hold == "start":
        # what acts until a row is the input of the row before; before the first one nothing did
        late = beside(stress)
        late[1:] = stress[:-1]
        stress = late
    if middle is None:
        middle = stress
    return Drive(dt, step, stress, np.ascontiguousarray(middle, float), HOLD_CODES[hold])


@njit(cache=True)
def _weights(h, T):
    """Decay and weights of the input at start, middle and end of a step of length h, for a quadratic input."""
    p = h / T
    a = np.exp(-p)
    m0 = -np.expm1(-p)
    if p < 0.1:
        # moments of p exp(-p (1 - x)) x^k by series, k! sum (-1)^n p^(n+1) / (n+k+1)!: the closed form cancels here
        m1 = m2 = 0.0
        for n in range(8, -1, -1):
            m1 = p / (n + 2) * (1.0 - m1)
            m2 = p / (n + 3) * (1.0 - m2)
    else:
        m1 = 1.0 - m0 / p
        m2 = 1.0 - 2.0 * m1 / p
    return a, m0 - 3 * m1 + 2 * m2, 4 * (m1 - m2), 2 * m2 - m1


@njit(cache=True)
def _tables(h, T, c, D, hold, now, later, carried, decay):
    """Fill the tables of `four_rows` for up to four modes T, c (m,) at even steps h.

    Inputs of a block: its four rows, or, for hold = 2, the row before, its four rows and the four middles.
    """
    now[:] = later[:] = carried[:] = decay[:] = 0.0
    for k in range(ROWS):
        now[k + 1 if hold == 2 else k, k] = D
    for j in range(T.size):
        p = h / T[j]
        if hold == 2:
            _, w0, w1, w2 = _weights(h, T[j])
        else:
            w0, w1, w2 = -np.expm1(-p), 0.0, 0.0
        for row in range(ROWS):
            for k in range(row, ROWS):
                share = c[j] * np.exp(-(k - row) * p)
                now[row, k] += share * w0
                if hold == 2:
                    now[row + 1, k] += share * w2
                    now[5 + row, k] += share * w1
            left = np.exp(-(ROWS - 1 - row) * p)
            later[row, j] += left * w0
            if hold == 2:
                later[row + 1, j] += left * w2
                later[5 + row, j] += left * w1
            carried[j, row] = c[j] * np.exp(-(row + 1) * p)
        # a time constant much longer than the record: its decay is all in the digits that rounding takes from 1 - lost
        lost = -np.expm1(-ROWS * p)
        decay[0, j] = 1.0 - lost
        decay[1, j] = (1.0 - decay[0, j]) - lost


@njit(cache=True, nogil=True)
def _bury(f):
    """Put states (m,) to rest that have died."""
    for k in range(f.size):
        if abs(f[k]) < _DEAD:
            f[k] = 0.0


@njit(cache=True)
def _even(h, s, middle, hold, D, c, T, states, out, add):
    """Even steps: up to four modes in one pass over all rows but the first. states (m,) are carried on.

    out = D s + sum c f, or, with `add`, out += sum c f.
    """
    m = T.size
    taps = 9 if hold == 2 else ROWS
    now, later = np.empty((taps, ROWS)), np.empty((taps, ROWS))
    carried, decay = np.empty((ROWS, ROWS)), np.empty((2, ROWS))
    _tables(h, T, c, 0.0 if add else D, hold, now, later, carried, decay)
    f = np.zeros(ROWS)
    f[:m] = states
    blocks = (s.size - 1) // ROWS
    for k in range(0, blocks, _EVERY_BLOCKS):
        _bury(f)
        row, many = 1 + ROWS * k, min(_EVERY_BLOCKS, blocks - k)
        if hold == 2:
            if add:
                _linear_added(s[row - 1 :], middle[row:], now, later, carried, decay, f, out[row:], many)
            else:
                _linear(s[row - 1 :], middle[row:], now, later, carried, decay, f, out[row:], many)
        else:
            if add:
                _held_added(s[row:], middle, now, later, carried, decay, f, out[row:], many)
            else:
                _held(s[row:], middle, now, later, carried, decay, f, out[row:], many)
    # rows that are left over
    begin = 1 + ROWS * blocks
    if not add:
        for i in range(begin, s.size):
            out[i] = D * s[i]
    for j in range(m):
        a, w0, w1, w2 = np.exp(-h / T[j]), 0.0, 0.0, -np.expm1(-h / T[j])
        if hold == 2:
            a, w0, w1, w2 = _weights(h, T[j])
        here = f[j]
        for i in range(begin, s.size):
            here = a * here + w2 * s[i]
            if hold == 2:
                here += w0 * s[i - 1] + w1 * middle[i]
            out[i] += c[j] * here
        states[j] = here


@njit(cache=True)
def respond(dt, uniform, s, middle, hold, D, c, T, f0, out):
    """Strain (n,) into `out` of one network in modes form, and its final lag states.

    D: 1/Pa; c, T: (m,); f0: (m,) lag states (Pa) before the first row, zero when rested. Returns states (m,).
    """
    n = s.size
    m = T.size
    states = f0.copy()
    if uniform > 0 and m > 0:
        # row 0 is the start: the state there is f0
        out[0] = D * s[0]
        for j in range(m):
            out[0] += c[j] * states[j]
        for j in range(0, m, ROWS):
            k = min(j + ROWS, m)
            _even(uniform, s, middle, hold, D, c[j:k], T[j:k], states[j:k], out, j > 0)
        return states
    for i in range(n):
        out[i] = D * s[i]
    for j in range(m):
        f = states[j]
        out[0] += c[j] * f
        last = -1.0
        decay = w0 = w1 = w2 = 0.0
        for i in range(1, n):
            if abs(f) < _DEAD:
                f = 0.0
            if dt[i] != last:
                last = dt[i]
                if hold == 2:
                    decay, w0, w1, w2 = _weights(last, T[j])
                else:
                    decay = np.exp(-last / T[j])
                    w1 = -np.expm1(-last / T[j])
            if hold == 2:
                f = decay * f + w0 * s[i - 1] + w1 * middle[i] + w2 * s[i]
            else:
                f = decay * f + w1 * s[i]
            out[i] += c[j] * f
        states[j] = f
    return states


@njit(cache=True, nogil=True)
def lag_rows(dt, s, middle, hold, T, f, start, stop, out):
    """Lag responses of rows start..stop-1 for many time constants at once, out (rows, K); f (K,) is carried.

    The loop over time constants is the inner one, so that it runs in vector registers.
    """
    K = T.size
    last = -1.0
    a = np.empty(K)
    w0 = np.zeros(K)
    w1 = np.empty(K)
    w2 = np.zeros(K)
    for i in range(start, stop):
        if i > 0:
            if i % _EVERY_ROWS == 0:
                _bury(f)
            if dt[i] != last:
                last = dt[i]
                for k in range(K):
                    if hold == 2:
                        a[k], w0[k], w1[k], w2[k] = _weights(last, T[k])
                    else:
                        a[k] = np.exp(-last / T[k])
                        w1[k] = -np.expm1(-last / T[k])
            if hold == 2:
                x0, x1, x2 = s[i - 1], middle[i], s[i]
                for k in range(K):
                    f[k] = a[k] * f[k] + w0[k] * x0 + w1[k] * x1 + w2[k] * x2
            else:
                v = s[i]
                for k in range(K):
                    f[k] = a[k] * f[k] + w1[k] * v
        for k in range(K):
            out[i - start, k] = f[k]


@njit(cache=True, nogil=True)
def lag_block_sums(dt, s, middle, hold, T, f, which, weight, out):
    """Weighted sums of lag responses and, last column, of the input over the blocks `which` (n,) names."""
    K = T.size
    chunk = 4096
    rows = np.empty((chunk, K))
    for start in range(0, s.size, chunk):
        stop = min(start + chunk, s.size)
        lag_rows(dt, s, middle, hold, T, f, start, stop, rows)
        for i in range(start, stop):
            b = which[i]
            w = weight[i]
            for k in range(K):
                out[b, k] += w * rows[i - start, k]
            out[b, K] += w * s[i]


def simulate_modes(
    drive: Drive, D: float, c: NDArray, T: NDArray, state: NDArray | None = None, out: NDArray | None = None
) -> tuple[NDArray, NDArray]:
    """Strain (n,) of a network in modes form under `drive`, into `out` if given, and the lag states (m,) at its end.

    The stress is finite. out: contiguous.
    """
    c = np.ascontiguousarray(c, float)
    T = np.ascontiguousarray(T, float)
    out = beside(drive.stress) if out is None else out
    f0 = np.zeros(T.size) if state is None else np.ascontiguousarray(state, float)
    end = respond(drive.dt, drive.uniform, drive.stress, drive.middle, drive.hold, float(D), c, T, f0, out)
    return out, end

"""The sufficient statistics of a stream, grown block by block (see likelihood/gram.py for what is summed and why).

Every row pairs with the row before it, also across blocks. A gap in device time is crossed exactly where the command
stood still; where it moved meanwhile, its course is unknown: nothing is interpolated, and rows do not count until what
the gap may have left behind is gone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..likelihood.basis import LagBasis
from ..likelihood.gram import RecordGram
from ..models.lags import HOLD_CODES, lag_rows
from .mains import line_columns

Array = NDArray[np.float64]
#: steps (n,) s, voltage (n,) V at their start and end, lags with input (n, K + 1) to further columns (n, m)
Beyond = Callable[[Array, Array, Array, Array], Array]

#: pairs of rows up to this many steps apart are used; beyond, a chain begins anew
_CLASSES = 3
#: a gap in which the command moved counts as one from here on (s)
_SHORT_GAP_S = 0.02
#: what is left of an unknown stretch after this many times its length is below a part in thirty of its creep
_FORGET = 10.0


@dataclass(frozen=True)
class Rows:
    """Observed rows of a block. F (n, p): basis, input, what is beside them, one, y; before (n, p): the observed row
    in front of each; steps (n,): how many sampling steps lie between, 0 where a chain begins; time_s (n,); y (n,):
    readings as they came, mains and all."""

    F: Array
    before: Array
    steps: NDArray[np.int64]
    time_s: Array
    y: Array


class SessionSums:
    """Sums of one session of the device: one clock, one offset. `scale` (m Pa per V^2): drive from the voltage."""

    def __init__(self, basis: LagBasis, step_s: float, scale: float, hold: str, offset_sd: float,
                 state: Array | None = None, doubt_s: float = 0.0, beyond: int = 0) -> None:
        self._as_new = (basis, step_s, scale, hold, offset_sd, None if state is None else state.copy(), doubt_s)
        self.beyond = beyond  # columns beside the lags, for models that are more than lags
        p = basis.size + beyond + 3
        self.basis, self.step_s, self.scale, self.hold, self.offset_sd = basis, step_s, scale, hold, offset_sd
        self.first = np.zeros((p, p))
        self.later, self.earlier, self.cross = (np.zeros((_CLASSES, p, p)) for _ in range(3))
        self.pairs = np.zeros(_CLASSES, dtype=np.int64)
        self.chains = self.n = self.rows = 0
        self.lost = 0
        self.state = np.zeros(basis.size) if state is None else state.copy()
        self.last_beyond = np.zeros((0, beyond))  # those of the last rows that were taken in
        self._doubt_s = doubt_s  # length of an unknown stretch before the first row
        self._until = -np.inf
        self.left_out = 0  # readings that do not count for what nobody saw
        self.unknown: list[tuple[float, float]] = []  # stretches of time (s) from such a gap to where readings count
        self._last_t = self._last_V = 0.0
        self._seen: Array | None = None  # last observed row
        self._seen_t = 0.0
        self.lines: dict[int, list[float]] = {}  # of each line taken out: times it was, and the sum of its cosines

    def anew(self) -> SessionSums:
        """The same session before its first row."""
        return SessionSums(*self._as_new, self.beyond)

    def change(self, columns: Array) -> None:
        """Multiply the columns beside the lags with a matrix (beyond, any), back to the start."""
        q = self.basis.size + 1
        T = np.zeros((self.first.shape[0], self.first.shape[0] - self.beyond + columns.shape[1]))
        T[:q, :q] = np.eye(q)
        T[q : q + self.beyond, q : q + columns.shape[1]] = columns
        T[q + self.beyond :, q + columns.shape[1] :] = np.eye(2)
        self.first, self.later, self.earlier, self.cross = (
            T.T @ x @ T for x in (self.first, self.later, self.earlier, self.cross))
        self._seen = None if self._seen is None else self._seen @ T
        self.last_beyond = self.last_beyond @ columns
        self.beyond = columns.shape[1]

    @property
    def last_voltage_V(self) -> float:
        """Voltage of the last row."""
        return self._last_V

    def add(self, time_s: Array, voltage_V: Array, y: Array, masked: NDArray[np.bool_],
            lines_Hz: tuple[float, ...] = (), beyond: Beyond | None = None) -> Rows:
        """Take rows (n,) in; masked: not to be counted; lines_Hz: to be taken out; beyond: gives further columns (n, m)
        from steps (n,) s, voltage (n,) V at their start and end, and lags with input (n, K + 1). Returns the rows with
        their responses."""
        K = self.basis.size
        n = time_s.size
        begins = self.rows == 0
        dt = np.diff(time_s, prepend=time_s[0] if begins else self._last_t)
        whole = np.rint(dt / self.step_s)
        near = (np.abs(dt / self.step_s - whole) < 0.05) & (whole >= 1)
        dt = np.where(near, whole * self.step_s, dt)  # stamps are rounded; the clock is not
        V_before = np.concatenate([[0.0 if begins else self._last_V], voltage_V[:-1]])
        used = V_before if self.hold == "start" else voltage_V
        stress = self.scale * used**2
        observed = np.isfinite(y) & ~masked
        could = observed
        if begins and self._doubt_s > 0:
            self._doubtful(float(time_s[0]), float(time_s[0]) + _FORGET * self._doubt_s)
        observed = observed & (time_s >= self._until)
        gaps = np.flatnonzero(dt > 1.5 * self.step_s)
        self.lost += int(np.sum(np.maximum(whole[gaps] - 1, 0)))
        for i in gaps[(dt[gaps] > _SHORT_GAP_S) & (np.abs(voltage_V[gaps] - V_before[gaps]) > 0.5)]:
            self._doubtful(float(time_s[i]), max(self._until, float(time_s[i] + _FORGET * dt[i])))
            observed &= ~((time_s >= time_s[i]) & (time_s < self._until))
        self.left_out += int(np.count_nonzero(could & ~observed))
        # row 0 of the kernel is the row before: it only carries its input
        lags = np.empty((n + 1, K))
        middle = self.scale * (0.5 * (voltage_V + V_before)) ** 2
        lag_rows(np.append(0.0, dt), np.append(self.scale * V_before[0] ** 2, stress), np.append(0.0, middle),
                 HOLD_CODES[self.hold], self.basis.time_constants, self.state, 0, n + 1, lags)
        F = np.empty((n, K + self.beyond + 3))
        F[:, :K] = lags[1:]
        F[:, K] = stress
        if beyond is not None:
            starts = V_before if self.hold == "linear" else used
            self.last_beyond = beyond(dt, np.ascontiguousarray(starts), np.ascontiguousarray(used), F[:, : K + 1])
            F[:, K + 1 : -2] = self.last_beyond
        F[:, -2] = 1.0
        F[:, -1] = np.where(observed, y, 0.0)
        self._last_t, self._last_V = float(time_s[-1]), float(voltage_V[-1])
        self.rows += n
        return self._pair(self._without(F[observed], time_s[observed], lines_Hz), time_s[observed], y[observed])

    def _doubtful(self, from_s: float, until_s: float) -> None:
        """Readings between do not count; stretches that meet are one."""
        if self.unknown and from_s <= self.unknown[-1][1]:
            from_s = self.unknown.pop()[0]
        self.unknown.append((from_s, until_s))
        self._until = until_s

    def _without(self, G: Array, t: Array, lines_Hz: tuple[float, ...]) -> Array:
        """Rows projected off the cosine and sine of each line."""
        if not lines_Hz or len(G) < 10 * len(lines_Hz):
            return G
        for f in lines_Hz:
            count = self.lines.setdefault(round(f / 10), [0.0, 0.0])
            count[0] += 1
            count[1] += float(np.cos(2 * np.pi * f * self.step_s))
        C = line_columns(t, lines_Hz)
        return np.asarray(G - C @ np.linalg.lstsq(C, G, rcond=None)[0])

    def _pair(self, G: Array, t: Array, y: Array) -> Rows:
        if not len(G):
            return Rows(G, G, np.zeros(0, dtype=np.int64), t, y)
        head = self._seen is None
        before = np.concatenate([(G[:1] if self._seen is None else self._seen[None]), G[:-1]])
        apart = np.diff(t, prepend=t[0] if head else self._seen_t) / self.step_s
        steps = np.rint(apart).astype(np.int64)
        steps[(np.abs(apart - steps) > 0.05) | (steps > _CLASSES) | (steps < 1)] = 0
        for k in range(_CLASSES):
            members = steps == k + 1
            count = int(members.sum())
            if not count:
                continue
            a, b = (G, before) if count == len(G) else (G[members], before[members])
            self.later[k] += a.T @ a
            self.earlier[k] += b.T @ b
            product = a.T @ b
            self.cross[k] += product + product.T
            self.pairs[k] += count
        heads = G[steps == 0]
        self.first += heads.T @ heads
        self.chains += len(heads)
        self.n += len(G)
        self._seen, self._seen_t = G[-1].copy(), float(t[-1])
        return Rows(G, before, steps, t, y)

    def outlook(self, beyond: Beyond | None = None) -> Callable[[Array, Array], Array]:
        """Columns (n, K + 1 + beyond) of rows that would come next, from the present memory: steps (n,) s, voltage
        (n,) V held over each; the first row is this moment."""
        start, scale, times = self.state.copy(), self.scale, self.basis.time_constants

        def columns(dt: Array, voltage_V: Array) -> Array:
            stress = scale * voltage_V**2
            out = np.empty((dt.size, times.size))
            lag_rows(np.ascontiguousarray(dt), stress, np.zeros(dt.size), 0, times, start.copy(), 0, dt.size, out)
            own = np.column_stack([out, stress])
            return own if beyond is None else np.concatenate([own, beyond(dt, voltage_V, voltage_V, own)], axis=1)

        return columns

    def gram(self) -> RecordGram:
        """The sums so far, as the likelihood takes them."""
        used = self.pairs > 0
        used[0] = True
        return RecordGram(self.first.copy(), self.later[used].copy(), self.earlier[used].copy(),
                          self.cross[used].copy(), self.chains, self.pairs[used].copy(),
                          1.0 + np.flatnonzero(used).astype(np.float64), self.n, np.array([self.offset_sd]),
                          self.state.copy())


def weighted(gram: RecordGram, sd: float, rho: float) -> Array:
    """Products (p, p) of all columns under the precision of AR(1) noise."""
    w = 1.0 / (sd * sd)
    Q = w * gram.first
    for k, step in enumerate(gram.steps):
        r = abs(rho) ** step if round(step) % 2 == 0 else np.copysign(abs(rho) ** step, rho)
        u = w / (1 - r * r)
        Q = Q + u * gram.later[k] + u * r * r * gram.earlier[k] - u * r * gram.cross[k]
    return np.asarray(Q)

"""The sufficient statistics of a stream, grown block by block (see likelihood/gram.py for what is summed and why).

Every row pairs with the row before it, also across blocks. A gap in device time is crossed exactly where the command
stood still; where it moved meanwhile, its course is unknown: nothing is interpolated, and rows do not count until what
the gap may have left behind is gone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..likelihood.basis import LagBasis
from ..likelihood.gram import RecordGram
from ..models.lags import lag_rows

Array = NDArray[np.float64]

#: pairs of rows up to this many steps apart are used; beyond, a chain begins anew
_CLASSES = 3
#: a gap in which the command moved counts as one from here on (s)
_SHORT_GAP_S = 0.02
#: what is left of an unknown stretch after this many times its length is below a part in thirty of its creep
_FORGET = 10.0


@dataclass(frozen=True)
class Rows:
    """Observed rows of a block. F (n, K + 3): basis, input, one, y; before (n, K + 3): the observed row in front of
    each; steps (n,): how many sampling steps lie between, 0 where a chain begins; time_s (n,)."""

    F: Array
    before: Array
    steps: NDArray[np.int64]
    time_s: Array


class SessionSums:
    """Sums of one session of the device: one clock, one offset. `scale` (m Pa per V^2): drive from the voltage."""

    def __init__(self, basis: LagBasis, step_s: float, scale: float, hold: str, offset_sd: float,
                 state: Array | None = None, doubt_s: float = 0.0) -> None:
        K = basis.size
        p = K + 3
        self.basis, self.step_s, self.scale, self.hold, self.offset_sd = basis, step_s, scale, hold, offset_sd
        self.first = np.zeros((p, p))
        self.later, self.earlier, self.cross = (np.zeros((_CLASSES, p, p)) for _ in range(3))
        self.pairs = np.zeros(_CLASSES, dtype=np.int64)
        self.chains = self.n = self.rows = 0
        self.lost = 0
        self.state = np.zeros(K) if state is None else state.copy()
        self._doubt_s = doubt_s  # length of an unknown stretch before the first row
        self._until = -np.inf
        self._last_t = self._last_V = 0.0
        self._seen: Array | None = None  # last observed row
        self._seen_t = 0.0

    @property
    def last_voltage_V(self) -> float:
        """Voltage of the last row."""
        return self._last_V

    def add(self, time_s: Array, voltage_V: Array, y: Array, masked: NDArray[np.bool_]) -> Rows:
        """Take rows (n,) in; masked: not to be counted. Returns them with their responses."""
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
        if begins and self._doubt_s > 0:
            self._until = time_s[0] + _FORGET * self._doubt_s
        observed &= time_s >= self._until
        gaps = np.flatnonzero(dt > 1.5 * self.step_s)
        self.lost += int(np.sum(np.maximum(whole[gaps] - 1, 0)))
        for i in gaps[(dt[gaps] > _SHORT_GAP_S) & (np.abs(voltage_V[gaps] - V_before[gaps]) > 0.5)]:
            self._until = max(self._until, time_s[i] + _FORGET * dt[i])
            observed &= ~((time_s >= time_s[i]) & (time_s < self._until))
        # row 0 of the kernel is the row before: it only carries its input
        lags = np.empty((n + 1, K))
        lag_rows(np.concatenate([[0.0], dt]), np.concatenate([[0.0], stress]), np.zeros(n + 1), 0,
                 self.basis.time_constants, self.state, 0, n + 1, lags)
        F = np.empty((n, K + 3))
        F[:, :K] = lags[1:]
        F[:, K] = stress
        F[:, K + 1] = 1.0
        F[:, K + 2] = np.where(observed, y, 0.0)
        self._last_t, self._last_V = float(time_s[-1]), float(voltage_V[-1])
        self.rows += n
        return self._pair(F[observed], time_s[observed])

    def _pair(self, G: Array, t: Array) -> Rows:
        if not len(G):
            return Rows(G, G, np.zeros(0, dtype=np.int64), t)
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
        return Rows(G, before, steps, t)

    def gram(self) -> RecordGram:
        """The sums so far, as the likelihood takes them."""
        used = self.pairs > 0
        used[0] = True
        return RecordGram(self.first.copy(), self.later[used].copy(), self.earlier[used].copy(),
                          self.cross[used].copy(), self.chains, self.pairs[used].copy(),
                          1.0 + np.flatnonzero(used).astype(np.float64), self.n, np.array([self.offset_sd]),
                          self.state.copy())

"""The smoothest command for a wanted stroke: regularised least squares over the whole of it.

A network without an instantaneous part and two poles more than zeros (pz3, ss3) cannot be inverted row by row: its
sampled form has a zero near -1 (Astrom, Hagander, Sternby 1984, doi 10.1016/0005-1098(84)90062-1; -0.967 where the
fastest lag is ten steps long). It becomes a pole of the inverse: every bend of the wish starts an alternation from row
to row that dies away slowly. Here the squared voltage s = V^2 minimises

    sum_i r_i (y_i - wish_i)^2 + sum_i (s_i - 2 s_(i-1) + s_(i-2))^2 / q,     0 <= s <= V_max^2,

y being the network's answer: among all commands that come equally near, the one that bends least. r is one over the
square of the tolerance, q the smallest with which the wish is met to the tolerance wherever a larger one meets it.
Where the command would have to be faster than it may be, r falls until it need not be. Without bounds the minimum is
one pass forward and one back over the rows (a Kalman smoother in the form of Bryson and Frazier; Bierman 1973, doi
10.1016/0005-1098(73)90035-8), the bends being the noise of a random walk; bounds are held by an active set.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from ..models.lags import Drive, simulate_modes
from .inverse import ABOVE, FAST, MET, NEGATIVE, Inverted, Limits, _allowed

Array = NDArray[np.float64]
#: variances of a bend, in squares of the full range of V^2, from which q is taken
_BENDS = 10.0 ** np.arange(-14.0, -4.0)
#: a larger q is worth it where it meets the wish on more than this share of the rows
_WORTH = 1e-3
#: variance with which a row is held at a bound, likewise
_HELD = 1e-14
#: variance of what a held row should answer, and how often it is let go
_AIMLESS, _FREED = 1e12, 3
#: V^2 beyond its range by this share of it is cut off without ado
_SLACK = 1e-7
_BOUND_ROUNDS, _SPEED_ROUNDS, _MEAN_ROUNDS = 25, 8, 3
#: solutions in one of the last rounds, before one has been seen
_USUAL = 6
#: V^2 beyond its range by this share of it is a leap that cannot be meant
_FAR = 0.3
#: weights of rows fall by this at a time where the command is too fast, over so many periods of the highest frequency
_SOFTER, _REACH = 0.1, 1.5


@dataclass(frozen=True)
class Network:
    """Answer sum_j c_j f_j of lags T_j (s) to s / V_max^2, in tolerances; a (n, 3): their decays over the steps."""

    c: Array
    a: Array


@njit(cache=True, nogil=True)
def _gains(c, a, noise, q, held, row_of_s, gain, spread):
    """Forward pass of the covariances. State: the lags, s, and its step. noise (n,): variance of y; held (n,): bool.

    Out: row_of_s (n, m) covariance of s with the state before the readings of a row, gain (n, 2, m) and spread (n, 2)
    of the readings of y and, where it is held, of s.
    """
    n, k = a.shape
    m = k + 2
    P = np.zeros((m, m))
    P[k, k] = 1.0
    F = np.zeros((m, m))
    FP = np.empty((m, m))
    for i in range(n):
        if i > 0:
            F[:] = 0.0
            for j in range(k):
                F[j, j] = a[i, j]
                F[j, k] = 1.0 - a[i, j]
                F[j, k + 1] = 1.0 - a[i, j]
            F[k, k] = 1.0
            F[k, k + 1] = 1.0
            F[k + 1, k + 1] = 1.0
            for x in range(m):
                for y in range(m):
                    total = 0.0
                    for z in range(m):
                        total += F[x, z] * P[z, y]
                    FP[x, y] = total
            for x in range(m):
                for y in range(x + 1):
                    total = 0.0
                    for z in range(m):
                        total += FP[x, z] * F[y, z]
                    # a bend of one moves the step, s and the lags
                    bx = 1.0 - a[i, x] if x < k else 1.0
                    by = 1.0 - a[i, y] if y < k else 1.0
                    P[x, y] = total + q * bx * by
                    P[y, x] = P[x, y]
        row_of_s[i] = P[k]
        for reading in range(2):
            if reading == 1 and not held[i]:
                spread[i, 1] = 0.0
                continue
            h = np.zeros(m)
            if reading == 0:
                h[:k] = c
            else:
                h[k] = 1.0
            Ph = np.zeros(m)
            for x in range(m):
                for y in range(m):
                    Ph[x] += P[x, y] * h[y]
            S = noise[i] if reading == 0 else _HELD
            for x in range(m):
                S += h[x] * Ph[x]
            spread[i, reading] = S
            for x in range(m):
                gain[i, reading, x] = Ph[x] / S
            for x in range(m):
                for y in range(m):
                    P[x, y] -= Ph[x] * Ph[y] / S


@njit(cache=True, nogil=True)
def _means(c, a, wish, held, at, row_of_s, gain, spread, out):
    """Forward and backward pass of the means with these gains: the smoothed s (n,) into out."""
    n, k = a.shape
    m = k + 2
    x = np.zeros(m)
    before = np.empty(n)
    missed = np.zeros((n, 2))
    for i in range(n):
        if i > 0:
            x[k] += x[k + 1]
            for j in range(k):
                x[j] = a[i, j] * x[j] + (1.0 - a[i, j]) * x[k]
        before[i] = x[k]
        v = wish[i]
        for j in range(k):
            v -= c[j] * x[j]
        missed[i, 0] = v
        for j in range(m):
            x[j] += gain[i, 0, j] * v
        if held[i]:
            v = at[i] - x[k]
            missed[i, 1] = v
            for j in range(m):
                x[j] += gain[i, 1, j] * v
    adjoint = np.zeros(m)
    for i in range(n - 1, -1, -1):
        for reading in range(1, -1, -1):
            if reading == 1 and not held[i]:
                continue
            along = missed[i, reading] / spread[i, reading]
            for j in range(m):
                along += gain[i, reading, j] * adjoint[j]
            if reading == 1:
                adjoint[k] -= along
            else:
                for j in range(k):
                    adjoint[j] -= along * c[j]
        s = before[i]
        for j in range(m):
            s -= row_of_s[i, j] * adjoint[j]
        out[i] = s
        # back through the step: F' adjoint
        pull = adjoint[k]
        for j in range(k):
            pull += (1.0 - a[i, j]) * adjoint[j]
            adjoint[j] *= a[i, j]
        adjoint[k + 1] += pull
        adjoint[k] = pull


class _Count:
    """How many solutions were found of those to come: each round is taken to need as many as the longest before it."""

    def __init__(self, tell: Callable[[float, float], None]) -> None:
        self.tell = tell
        self.solved, self.begun, self.longest, self.left = 0, len(_BENDS), _USUAL, _MEAN_ROUNDS

    def begin(self) -> None:
        """A round begins."""
        self.begun, self.left = self.solved, self.left - 1

    def add(self) -> None:
        """One more was found."""
        self.solved += 1
        self.longest = max(self.longest, self.solved - self.begun)
        rounds = self.left + (self.left < _MEAN_ROUNDS)
        self.tell(self.solved, self.begun + rounds * self.longest)


class _Smoother:
    """The least squares problem of one network; room for its gains is made once."""

    def __init__(self, network: Network, count: _Count | None = None) -> None:
        n, m = network.a.shape[0], network.a.shape[1] + 2
        self.network, self.count = network, count or _Count(lambda done, of: None)
        self.row_of_s, self.gain, self.spread = np.empty((n, m)), np.empty((n, 2, m)), np.empty((n, 2))

    def solve(self, wish: Array, noise: Array, q: float, held: NDArray[np.bool_], at: Array) -> Array:
        """s (n,) without bounds; rows `held` are taken to `at`."""
        out = np.empty(wish.size)
        c, a = self.network.c, self.network.a
        _gains(c, a, noise, q, held, self.row_of_s, self.gain, self.spread)
        _means(c, a, wish, held, at, self.row_of_s, self.gain, self.spread, out)
        self.count.add()
        return out

    def bounded(self, wish: Array, noise: Array, q: float) -> Array:
        """s (n,) within 0..1. Rows beyond a bound are held there and aim at nothing: else their neighbours would make
        up for them, and shake. They are let go, a few times, where the answer falls short on the other side.
        """
        held, at = np.zeros(wish.size, bool), np.zeros(wish.size)
        freed = np.zeros(wish.size, np.int64)
        for _ in range(_BOUND_ROUNDS):
            s = self.solve(wish, np.where(held, _AIMLESS, noise), q, held, at)
            over = self.answer(np.clip(s, 0.0, 1.0)) - wish
            free = held & np.where(at > 0.5, over > 1.0, over < -1.0) & (freed < _FREED)
            freed[free] += 1
            beyond = ~held & ((s < -_SLACK) | (s > 1.0 + _SLACK))
            if not free.any() and not beyond.any():
                break
            at = np.where(beyond & (s > 0.5), 1.0, np.where(beyond, 0.0, at))
            held = (held & ~free) | beyond
        return np.clip(s, 0.0, 1.0)

    def softened(self, wish: Array, q: float, time_s: Array, reach: float) -> Array:
        """Variances of y (n,), raised around rows where V^2 would be far out of its range, until it is not."""
        noise, free, nowhere = np.ones(wish.size), np.zeros(wish.size, bool), np.zeros(wish.size)
        for _ in range(_SPEED_ROUNDS):
            s = self.solve(wish, noise, q, free, nowhere)
            wild = (s < -_FAR) | (s > 1.0 + _FAR)
            if not wild.any():
                break
            noise = np.where(_near(time_s, wild, reach), noise / _SOFTER, noise)
        return noise

    def answer(self, s: Array) -> Array:
        """y (n,) of s (n,), in tolerances."""
        out = np.empty(s.size)
        _answer(self.network.c, self.network.a, s, out)
        return out


@njit(cache=True, nogil=True)
def _answer(c, a, s, out):
    f = np.zeros(c.size)
    for i in range(s.size):
        out[i] = 0.0
        for j in range(c.size):
            f[j] = a[i, j] * f[j] + (1.0 - a[i, j]) * s[i]
            out[i] += c[j] * f[j]


@njit(cache=True, nogil=True)
def _limited(wanted, time_s, dt, top, frequency, out, fast):
    """The command within the limits of speed, row after row, and where these forbade what was wanted."""
    memory = np.array([wanted[0], 0.0, wanted[0], -np.inf])
    usual = np.median(dt[1:])
    for i in range(wanted.size):
        out[i], fast[i] = _allowed(wanted[i], time_s[i], dt[i] if dt[i] > 0.0 else usual, top, frequency, memory)


def follow(
    time_s: Array,
    drive: Drive,
    factor: float,
    mean: tuple[Array, Array],
    typical: tuple[Array, Array],
    wish: Array,
    limits: Limits,
    tolerance: float,
    tell: Callable[[float, float], None] = lambda done, of: None,
) -> Inverted:
    """Voltages (n,) with which the network follows the strain `wish` (n,) to `tolerance`, as smoothly as that allows.

    drive: steps of the rows, held. factor: Pa per V^2. mean: (c, T) of the network that is to follow, the mean of all
    draws with as many lags as they have together; typical: the same in three lags, with which it is inverted (what they
    differ in is taken off the wish). tell: called with (done, of), `of` as far as it can be foreseen.
    """
    top = limits.voltage_V
    scale = factor * top**2 / tolerance
    network = Network(typical[0] * scale, np.exp(-drive.dt[:, None] / typical[1]))
    smoother = _Smoother(network, count := _Count(tell))
    most = smoother.answer(np.ones(wish.size))
    goal = np.clip(wish / tolerance, 0.0, most)
    reach = _REACH / limits.frequency_Hz if limits.frequency_Hz > 0 else 10.0 * float(np.median(drive.dt[1:]))
    q = _bend(smoother, goal, time_s, reach)
    for _ in range(_MEAN_ROUNDS):
        count.begin()
        # what no voltage reaches is not aimed at; V^2 far out of its range is a leap of the wish
        goal = np.clip(goal, 0.0, most)
        noise = smoother.softened(goal, q, time_s, reach)
        for _ in range(_SPEED_ROUNDS):
            wanted = top * np.sqrt(smoother.bounded(goal, noise, q))
            voltage, fast = np.empty(wish.size), np.zeros(wish.size, bool)
            _limited(wanted, time_s, drive.dt, top, limits.frequency_Hz, voltage, fast)
            if not fast.any():
                break
            noise = np.where(_near(time_s, fast, reach), noise / _SOFTER, noise)
        s = (voltage / top) ** 2
        exact, _ = simulate_modes(_with(drive, s * factor * top**2), 0.0, mean[0], mean[1])
        difference = exact / tolerance - smoother.answer(s)
        if np.max(np.abs(np.clip(wish / tolerance - difference, 0.0, most) - goal)) < 0.05:
            break
        goal = wish / tolerance - difference
    over = exact / tolerance - wish / tolerance
    flag = np.full(wish.size, MET, np.int8)
    flag[noise > 1.0] = FAST
    flag[fast] = FAST
    flag[(voltage <= 1e-3 * top) & (over > 1.0)] = NEGATIVE
    flag[(voltage >= top * (1 - 1e-6)) & (over < -1.0)] = ABOVE
    return Inverted(voltage, flag)


def _with(drive: Drive, stress: Array) -> Drive:
    return Drive(drive.dt, drive.uniform, stress, stress, drive.hold)


def _bend(smoother: _Smoother, goal: Array, time_s: Array, reach: float) -> float:
    """The smallest variance of a bend with which the wish is met nearly wherever a larger one meets it, leaps aside."""
    free, nowhere, noise = np.zeros(goal.size, bool), np.zeros(goal.size), np.ones(goal.size)
    found = [smoother.solve(goal, noise, q, free, nowhere) for q in _BENDS]
    wild = (found[-1] < -_FAR) | (found[-1] > 1.0 + _FAR)
    steady = ~_near(time_s, wild, 10.0 * reach) if wild.any() else ~wild
    if not steady.any():
        return float(_BENDS[len(_BENDS) // 2])
    missed = np.array([np.mean(np.abs(smoother.answer(s) - goal)[steady] > 1.0) for s in found])
    return float(_BENDS[np.flatnonzero(missed <= missed.min() + _WORTH)[0]])


def _near(time_s: Array, rows: NDArray[np.bool_], reach: float) -> NDArray[np.bool_]:
    """Rows (n,) within `reach` of one of some rows."""
    at = time_s[rows]
    change = np.zeros(time_s.size + 1, np.int64)
    np.add.at(change, np.searchsorted(time_s, at - reach), 1)
    np.add.at(change, np.searchsorted(time_s, at + reach, side="right"), -1)
    return np.cumsum(change[:-1]) > 0

"""A small basis for the responses of all first-order lags to the inputs of a campaign.

f(T; t), the response of a lag of time constant T, is analytic in log T with poles half a turn away from the real
axis, so that it is interpolated on Chebyshev nodes of log T to any accuracy (Trefethen, Approximation Theory and
Practice, ch. 8). On given inputs the nodes' responses are nearly dependent: a pivoted QR picks the few (30 to 45)
whose combinations give all others, and a table over log T holds the coefficients. A linear model's response is then
a vector of about forty numbers, whatever the length of the records.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr, solve_triangular

from ..campaign.scratch import BLOCK, pieces
from ..compiled import njit
from ..errors import InputError
from ..models.lags import HOLD_CODES, Drive, lag_rows

_NODES_PER_EFOLD = 5.2
_TABLE_PER_EFOLD = 160


@dataclass(frozen=True)
class LagBasis:
    """Coefficients of f(T; .) in K chosen lags. `table` (rows, K) over an even grid of log T; see `coefficients`."""

    time_constants: NDArray[np.float64]  # (K,) s, the chosen lags
    table: NDArray[np.float64]
    log_low: float
    step: float
    reference_s: float  # f is interpolated as f (1 + T/reference), bounded for slow modes
    error: float  # largest error of a response, relative to the largest input

    @property
    def size(self) -> int:
        """Number of basis responses, without the input itself."""
        return int(self.time_constants.size)


@njit(cache=True)
def coefficients(D, c, T, table, log_low, step, reference, out):
    """Response vectors of modes: D (B,), c (B, m), T (B, m) into out (B, K + 1), the input last."""
    B, m = c.shape
    K = table.shape[1]
    rows = table.shape[0]
    for b in range(B):
        for k in range(K):
            out[b, k] = 0.0
        out[b, K] = D[b]
        for j in range(m):
            x = (math.log(T[b, j]) - log_low) / step
            x = min(max(x, 1.0), rows - 2.0 - 1e-9)
            i = int(x)
            u = x - i
            # cubic through four neighbours
            w0 = -u * (u - 1.0) * (u - 2.0) / 6.0
            w1 = (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0
            w2 = -(u + 1.0) * u * (u - 2.0) / 2.0
            w3 = (u + 1.0) * u * (u - 1.0) / 6.0
            scale = c[b, j] / (1.0 + T[b, j] / reference)
            w0 *= scale
            w1 *= scale
            w2 *= scale
            w3 *= scale
            for k in range(K):
                out[b, k] += (w0 * table[i - 1, k] + w1 * table[i, k]) + (w2 * table[i + 1, k] + w3 * table[i + 2, k])


def _barycentric(nodes: NDArray, x: NDArray) -> NDArray:
    """Interpolation matrix (len(x), len(nodes)) at Chebyshev points of the first kind (Berrut & Trefethen 2004)."""
    n = nodes.size
    theta = (2 * np.arange(n) + 1) * np.pi / (2 * n)
    w = (-1.0) ** np.arange(n) * np.sin(theta)
    difference = x[:, None] - nodes[None, :]
    exact = np.abs(difference) < 1e-14
    difference[exact] = 1.0
    q = w / difference
    out = q / q.sum(axis=1, keepdims=True)
    hit = exact.any(axis=1)
    out[hit] = exact[hit]
    return out


def _sample_rows(drive: Drive, rng: np.random.Generator, count: int = 1500) -> NDArray[np.int64]:
    """Rows at which a drive's responses are compared: near changes of the input, and spread over the rest."""
    n = drive.n
    if n <= count:
        return np.arange(n)
    largest, sizes = np.empty(0, np.int64), np.empty(0)
    for part in pieces(n - 1, BLOCK):
        jumps = np.abs(np.diff(drive.stress[part.start : part.stop + 1]))
        # a held command moves at a few rows only: the many ties at zero would make a selection among all rows slow
        moved = np.flatnonzero(jumps)
        largest, sizes = np.append(largest, part.start + moved), np.append(sizes, jumps[moved])
        if largest.size > 12:
            chosen = np.argpartition(sizes, -12)[-12:]
            largest, sizes = largest[chosen], sizes[chosen]
    after = (largest[:, None] + np.unique(np.geomspace(1, max(2, n // 4), 60).astype(int))[None, :]).ravel()
    spread = np.linspace(0, n - 1, count // 2).astype(int)
    return np.unique(np.concatenate([after[after < n], spread, rng.integers(0, n, count // 4)]))


def build_basis(drives: Sequence[Drive], tolerance: float = 3e-8) -> LagBasis:
    """Basis for all time constants from a tenth of the shortest step to a thousand times the longest record.

    tolerance: relative size at which a further lag adds nothing. Faster lags than the lower end follow the held
    input within exp(-10); slower ones than the upper end are ramps to 0.1 %. Raises InputError when no drive acts.
    """
    if not any(np.any(d.stress) for d in drives):
        raise InputError(
            "the command is 0 V in every voltage recording: nothing in them says how the actuator answers; "
            "check the voltage_V columns"
        )
    shortest = min(_shortest(d) for d in drives)
    reference = max(d.span for d in drives)
    low, high = math.log(0.1 * shortest), math.log(1e3 * reference)
    n = max(24, math.ceil(_NODES_PER_EFOLD * (high - low)))
    theta = (2 * np.arange(n) + 1) * np.pi / (2 * n)
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(theta)
    T = np.exp(nodes)
    rng = np.random.default_rng(0)
    picked = []
    different = _different(drives)
    for d in different:
        rows = _sample_rows(d, rng, max(300, 9000 // len(different)))
        picked.append(_responses_at(d, T, rows) * (1 + T / reference))
    A = np.concatenate(picked)
    largest = np.abs(A).max() or 1.0
    R, pivots = qr(A / largest, mode="r", pivoting=True, overwrite_a=True, check_finite=False)
    diagonal = np.abs(np.diag(R))
    K = max(1, int(np.sum(diagonal > tolerance * diagonal[0])))
    keep = pivots[:K]
    P = np.zeros((K, n))
    P[:, keep] = np.eye(K)
    P[:, pivots[K:]] = solve_triangular(R[:K, :K], R[:K, K:])
    size = math.ceil(_TABLE_PER_EFOLD * (high - low)) + 4
    step = (high - low) / (size - 4)
    grid = low - step + step * np.arange(size)
    table = _barycentric(nodes, np.clip(grid, low, high)) @ P.T
    # coefficients belong to f (1 + T_k/reference) of the chosen lags; the Gram holds the plain f
    table *= 1 + T[keep] / reference
    basis = LagBasis(np.ascontiguousarray(T[keep]), np.ascontiguousarray(table), low - step, step, reference, 0.0)
    return LagBasis(
        basis.time_constants, basis.table, basis.log_low, basis.step, reference, _worst_error(basis, drives[0], rng)
    )


def _shortest(drive: Drive) -> float:
    """Shortest step of a drive in s."""
    steps = (drive.dt[part] for part in pieces(drive.n, BLOCK))
    return min(float(h[h > 0].min(initial=np.inf)) for h in steps)


def _responses_at(drive: Drive, T: NDArray, rows: NDArray, chunk: int = 16384) -> NDArray:
    """Lag responses at some rows only. Stretches of constant input are crossed in one exact step."""
    keep = _kept_rows(drive, rows)
    if keep is None:
        return _responses_by_row(drive, T, rows, chunk)
    elapsed, upto = np.empty(keep.size), 0.0
    for part in pieces(drive.n, BLOCK):
        here = np.cumsum(np.concatenate([[upto], drive.dt[part]]))[1:]
        first, last = np.searchsorted(keep, [part.start, part.stop])
        elapsed[first:last] = here[keep[first:last] - part.start]
        upto = float(here[-1])
    dt = np.diff(elapsed, prepend=elapsed[0])
    stress, middle = drive.stress[keep], drive.middle[keep]
    place = np.searchsorted(keep, rows)
    out = np.empty((rows.size, T.size))
    state = np.zeros(T.size)
    buffer = np.empty((min(chunk, keep.size), T.size))
    for start in range(0, keep.size, chunk):
        stop = min(start + chunk, keep.size)
        lag_rows(dt, stress, middle, drive.hold, T, state, start, stop, buffer)
        inside = (place >= start) & (place < stop)
        out[inside] = buffer[place[inside] - start]
    return out


def _kept_rows(drive: Drive, rows: NDArray) -> NDArray[np.int64] | None:
    """Rows between which the input stands still, with those asked about; None where a long input never does."""
    if drive.hold == HOLD_CODES["linear"]:
        return np.arange(drive.n) if drive.n <= BLOCK else None
    changes, many = [np.zeros(1, np.int64)], 0
    for part in pieces(max(drive.n - 1, 0), BLOCK):
        here = part.start + np.flatnonzero(np.diff(drive.stress[part.start : part.stop + 1]) != 0)
        changes.append(here)
        many += here.size
        if many > BLOCK:
            return None
    moved = np.concatenate(changes)
    return np.unique(np.concatenate([[0], moved[1:], moved[1:] + 1, rows]))


def _responses_by_row(drive: Drive, T: NDArray, rows: NDArray, chunk: int) -> NDArray:
    """Lag responses at some rising rows of a drive, from all of its rows."""
    out, state, buffer = np.empty((rows.size, T.size)), np.zeros(T.size), np.empty((chunk, T.size))
    for part in pieces(int(rows[-1]) + 1, chunk):
        lag_rows(drive.dt, drive.stress, drive.middle, drive.hold, T, state, part.start, part.stop, buffer)
        first, last = np.searchsorted(rows, [part.start, part.stop])
        out[first:last] = buffer[rows[first:last] - part.start]
    return out


def _different(drives: Sequence[Drive]) -> list[Drive]:
    """Drives that are not a multiple of an earlier one: their responses would be multiples as well."""
    kept: list[Drive] = []
    for d in drives:
        if not any(_alike(d, o) for o in kept):
            kept.append(d)
    return kept


def _alike(d: Drive, o: Drive) -> bool:
    """Whether a drive is a multiple of another."""
    if d.n != o.n:
        return False
    a, b = _largest(d), _largest(o)
    return all(
        np.array_equal(d.dt[part], o.dt[part]) and bool(np.abs(d.stress[part] / a - o.stress[part] / b).max() < 1e-9)
        for part in pieces(d.n, BLOCK)
    )


def _largest(drive: Drive) -> float:
    return max(float(drive.stress.max()), -float(drive.stress.min())) or 1.0


def _worst_error(basis: LagBasis, drive: Drive, rng: np.random.Generator) -> float:
    T = np.exp(rng.uniform(math.log(basis.time_constants.min()), math.log(basis.time_constants.max()), 12))
    rows = _sample_rows(drive, rng, 400)
    exact = _responses_at(drive, T, rows)
    skeleton = _responses_at(drive, basis.time_constants, rows)
    w = np.empty((12, basis.size + 1))
    coefficients(
        np.zeros(12), np.ones((12, 1)), T[:, None], basis.table, basis.log_low, basis.step, basis.reference_s, w
    )
    return float(np.abs(skeleton @ w[:, :-1].T - exact).max() / max(_largest(drive), 1e-300))

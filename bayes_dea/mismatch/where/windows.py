"""Where recordings are looked at: windows of their blocks, each a unit vector in whitened coordinates.

Nearly all are flat in time, of every length by powers of two, each overlapping half of the next: what they see are
differences of running sums, so that neither a matrix of them nor a name of each is kept. The others have shapes
(harmonics, a drift) or lie here and there (after edges, at a voltage), and are rows of a sparse matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, vstack

from ...compiled import njit
from ...gauss_newton.reduced import Piece
from .features import Features, features
from .shapes import SMALLEST, Window, shaped

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Flat:
    """Flat windows in time: blocks begin ... stop - 1 (k,) of a piece (k,), which end at t0_s ... t1_s (k,)."""

    begin: Rows
    stop: Rows
    piece: Rows
    t0_s: Array
    t1_s: Array

    def window(self, k: int) -> Window:
        """One of them by name."""
        return Window("time", int(self.piece[k]), "", float(self.t0_s[k]), float(self.t1_s[k]), "")


class Windows(Sequence[Window]):
    """All windows by name, the flat ones first; those are named as they are asked for."""

    def __init__(self, flat: Flat, shaped: tuple[Window, ...]) -> None:
        self.flat, self.shaped = flat, shaped

    def __len__(self) -> int:
        return self.flat.begin.size + len(self.shaped)

    @overload
    def __getitem__(self, k: int) -> Window: ...
    @overload
    def __getitem__(self, k: slice) -> list[Window]: ...
    def __getitem__(self, k: int | slice) -> Window | list[Window]:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        k = range(len(self))[k]  # from the end, too, and no further
        many = self.flat.begin.size
        return self.flat.window(k) if k < many else self.shaped[k - many]


@dataclass(frozen=True)
class Places:
    """Where recordings are looked at. It depends on the recordings, on no fit.

    weights (n,): see `weights_of`, piece after piece; shaped: windows that are not flat (m, n); seed: of the noise that
    residuals are held against, the same for all fits; near a threshold two judgements of one fit would differ by it
    otherwise.
    """

    weights: Array = field(repr=False)
    windows: Windows = field(repr=False)
    shaped: csr_matrix = field(repr=False)
    seed: int

    @cached_property
    def inverse(self) -> Array:
        """(k,) 1 / length of the flat windows before they were made unit vectors."""
        square = self._sums(self.weights)
        return np.asarray(1.0 / np.sqrt(np.where(square > 0.0, square, np.inf)))

    @cached_property
    def across(self) -> Rows:
        """Indices of the windows over several recordings."""
        of = [k for k, w in enumerate(self.windows.shaped) if w.piece < 0]
        return self.inverse.size + np.array(of, dtype=np.int64)

    def times(self, x: Array) -> Array:
        """What every window sees of x (n,)."""
        return np.concatenate([self._sums(x) * self.inverse, self.shaped @ x])

    def highest(self, x: Array, scale: Array) -> Array:
        """The largest size (c,) of what a window sees of columns (n, c), each times its scale."""
        k, flat = self.inverse.size, self.windows.flat
        out = np.max(np.abs(self.shaped @ x) * scale[k:, None], axis=0, initial=0.0)
        _highest(flat.begin, flat.stop, self.inverse * scale[:k], self.weights, np.ascontiguousarray(x), out)
        return np.asarray(out)

    def rows(self, chosen: Sequence[int] | Rows) -> csr_matrix:
        """Some of the windows as rows (len(chosen), n)."""
        k, flat = self.inverse.size, self.windows.flat
        at = np.asarray(chosen, dtype=np.int64)
        own, order = at[at < k], np.argsort(np.concatenate([np.flatnonzero(at < k), np.flatnonzero(at >= k)]))
        size = flat.stop[own] - flat.begin[own]
        ends = np.concatenate([[0], np.cumsum(size)])
        index = np.arange(ends[-1]) + np.repeat(flat.begin[own] - ends[:-1], size)
        value = self.weights[index] * np.repeat(self.inverse[own], size)
        out = vstack(
            [csr_matrix((value, index, ends), shape=(own.size, self.weights.size)), self.shaped[at[at >= k] - k]]
        )
        return csr_matrix(out)[order]

    def _sums(self, x: Array) -> Array:
        """Sums of weights times x (n,) over the flat windows."""
        flat = self.windows.flat
        upto = np.concatenate([[0.0], np.cumsum(self.weights * x)])
        return np.asarray(upto[flat.stop] - upto[flat.begin])


@njit(cache=True, nogil=True)
def _highest(begin, stop, scale, weights, x, out):
    """out (c,): raised to the largest |scale * sum of weights x| over flat windows, x (n, c)."""
    n, c = x.shape
    upto = np.empty((n + 1, c))
    upto[0] = 0.0
    for i in range(n):
        for j in range(c):
            upto[i + 1, j] = upto[i, j] + weights[i] * x[i, j]
    for k in range(begin.size):
        a, b, s = begin[k], stop[k], scale[k]
        for j in range(c):
            size = abs(upto[b, j] - upto[a, j]) * s
            out[j] = max(out[j], size)


def weights_of(piece: Piece) -> Array:
    """Roots of the samples of the blocks of a piece, zero for each of its nuisances: a constant offset in whitened
    coordinates (nb + m,)."""
    return np.concatenate([np.sqrt(piece.blocks.count), np.zeros(piece.nuisance_sd.size)])


def places_of(
    pieces: Sequence[Piece], rng: np.random.Generator, looks: Sequence[Features] | None = None
) -> Places:
    """The windows of recordings; rng: draws the seed of their noise."""
    weights = [weights_of(p) for p in pieces]
    start = np.concatenate([[0], np.cumsum([w.size for w in weights])]).astype(np.int64)
    rows = _Rows(np.concatenate(weights))
    for one in shaped(pieces, looks or [features(p) for p in pieces], start):
        rows.add(*one)
    windows = Windows(_flat(pieces, start), tuple(rows.windows))
    return Places(rows.weights, windows, rows.matrix(), int(rng.integers(2**63)))


def _flat(pieces: Sequence[Piece], start: Rows) -> Flat:
    """Flat windows of every length by powers of two, each overlapping half of the next."""
    begin, stop, which, first_s, last_s = [], [], [], [], []
    for i, piece in enumerate(pieces):
        size, nb, t = SMALLEST, piece.blocks.n, piece.blocks.time_s
        while size <= nb:
            first = np.arange(0, nb - size + 1, max(size // 2, 1))
            begin.append(start[i] + first)
            stop.append(start[i] + first + size)
            which.append(np.full(first.size, i))
            first_s.append(t[first])
            last_s.append(t[first + size - 1])
            size *= 2
    if not begin:
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        return Flat(none, none, none, nothing, nothing)
    return Flat(*(np.concatenate(x) for x in (begin, stop, which, first_s, last_s)))


class _Rows:
    """Rows of a sparse matrix, each normalised to one."""

    def __init__(self, weights: Array) -> None:
        """weights: see `weights_of`."""
        self.weights = weights
        self.index: list[Rows] = []
        self.value: list[Array] = []
        self.sizes: list[int] = []
        self.windows: list[Window] = []

    def add(self, index: Rows, shape: Array | None, window: Window) -> None:
        """One window with a shape."""
        if index.size < SMALLEST:
            return
        v = self.weights[index] * (1.0 if shape is None else shape)
        norm = float(np.linalg.norm(v))
        if norm > 0:
            self.index.append(index)
            self.value.append(v / norm)
            self.sizes.append(index.size)
            self.windows.append(window)

    def matrix(self) -> csr_matrix:
        """(windows, n)"""
        ends = np.concatenate([[0], np.cumsum(self.sizes)])
        value, index = np.concatenate([np.empty(0), *self.value]), np.concatenate([np.empty(0, np.int64), *self.index])
        return csr_matrix((value, index, ends), shape=(len(self.sizes), self.weights.size))

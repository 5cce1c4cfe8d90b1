"""Medians and quantiles of columns that are longer than memory should hold: exact, from a few passes over their pieces.

What is asked about comes as a function that gives the pieces anew at every call. A float64 and its bits, read as an
integer, are in the same order (with the bits of negative numbers turned round). A pass counts how many numbers share
their first sixteen bits; the wanted rank is in one of these bins, and the next pass looks at that one only, until it
holds few enough numbers to be sorted. Up to `BLOCK` rows are put into memory and left to numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ..compiled import njit
from .scratch import BLOCK, pieces

Array = NDArray[np.float64]
Pieces = Callable[[], Iterator[Array]]
_BITS, _BINS = 16, 1 << 16


def of(column: Array, function: Callable[[Array], Array] | None = None) -> Pieces:
    """The pieces of a column (n,), or of a function of it taken row by row."""
    return lambda: (column[part] if function is None else function(column[part]) for part in pieces(column.size, BLOCK))


def differences(column: Array, good: NDArray[np.bool_] | None = None) -> Pieces:
    """What each row of a column (n,) is more than the one before it; of those rows only where `good` (n,) holds."""

    def give() -> Iterator[Array]:
        before = np.empty(0)
        for part in pieces(column.size, BLOCK):
            here = column[part] if good is None else column[part][good[part]]
            if not here.size:
                continue
            yield np.diff(np.concatenate([before, here]) if before.size else here)
            before = np.array(here[-1:])

    return give


def median(values: Pieces) -> float:
    """np.median of all pieces together; nan where there are none. They must not hold nan."""
    n, few = _gather(values)
    if few is not None:
        return float(np.median(few)) if n else float("nan")
    low, high = (n - 1) // 2, n // 2
    a, b = _ranked(values, [low, high])
    return float(np.mean([a, b]))


def quantiles(values: Pieces, at: Sequence[float]) -> list[float]:
    """np.quantile of all pieces together at levels 0..1 (linear interpolation). They must not hold nan."""
    n, few = _gather(values)
    if few is not None:
        return [float(q) for q in np.quantile(few, at)]
    places = [q * (n - 1) for q in at]
    ranks = [min(int(p) + k, n - 1) for p in places for k in (0, 1)]
    found = _ranked(values, ranks)
    out = []
    for p, a, b in zip(places, found[::2], found[1::2], strict=True):
        share = p - int(p)
        # as numpy: from the nearer end, so that neither is left
        out.append(a + (b - a) * share if share < 0.5 else b - (b - a) * (1.0 - share))
    return out


def _gather(values: Pieces) -> tuple[int, Array | None]:
    """How many numbers there are, and all of them where they are few."""
    held: list[Array] = []
    n = 0
    for piece in values():
        n += piece.size
        if n <= BLOCK:
            held.append(piece)
        else:
            held.clear()
    if n > BLOCK:
        return n, None
    return n, held[0] if len(held) == 1 else np.concatenate(held) if held else np.empty(0)


def _ranked(values: Pieces, ranks: Sequence[int]) -> list[float]:
    """The numbers of these ranks, counted from 0."""
    found = _within(values, 0, 0, sorted(set(ranks)))
    return [found[r] for r in ranks]


def _within(values: Pieces, prefix: int, level: int, ranks: Sequence[int]) -> dict[int, float]:
    """Numbers by their ranks among those whose first `level` digits of 16 bits are `prefix`."""
    counts = np.zeros(_BINS, np.int64)
    for piece in values():
        _count(_bits(piece), prefix, level, counts)
    upto = np.cumsum(counts)
    which = np.searchsorted(upto, ranks, side="right")
    out: dict[int, float] = {}
    for b in np.unique(which):
        here = [r for r, w in zip(ranks, which, strict=True) if w == b]
        first = int(upto[b - 1]) if b else 0
        # the first digit carries the sign
        digits = (int(b) - _BINS // 2) if level == 0 else (prefix << _BITS) | int(b)
        if level == 3:
            out |= {r: float(_turned(np.array([digits], np.int64)).view(np.float64)[0]) for r in here}
        elif counts[b] <= BLOCK:
            some = np.concatenate([_pick(_bits(piece), digits, level + 1) for piece in values()])
            at = [r - first for r in here]
            some = np.partition(some, at)
            out |= {r: float(_turned(some[k : k + 1]).view(np.float64)[0]) for r, k in zip(here, at, strict=True)}
        else:
            deeper = _within(values, digits, level + 1, [r - first for r in here])
            out |= {r: deeper[r - first] for r in here}
    return out


def _bits(piece: Array) -> NDArray[np.int64]:
    return (piece + 0.0).view(np.int64)  # + 0.0: one zero only


def _turned(bits: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where(bits < 0, bits ^ np.int64(0x7FFFFFFFFFFFFFFF), bits)


@njit(cache=True, nogil=True)
def _count(bits, prefix, level, counts):
    """How often each next digit comes among the numbers with this prefix."""
    for b in bits:
        k = b ^ np.int64(0x7FFFFFFFFFFFFFFF) if b < 0 else b
        if level == 0:
            counts[(k >> 48) + 32768] += 1
        elif (k >> (64 - 16 * level)) == prefix:
            counts[(k >> (48 - 16 * level)) & 0xFFFF] += 1


@njit(cache=True, nogil=True)
def _pick(bits, prefix, level):
    """The numbers with this prefix, as integers in their order."""
    out = np.empty(bits.size, np.int64)
    n = 0
    for b in bits:
        k = b ^ np.int64(0x7FFFFFFFFFFFFFFF) if b < 0 else b
        if (k >> (64 - 16 * level)) == prefix:
            out[n] = k
            n += 1
    return out[:n].copy()

"""The rows of a mechanical recording at which the material between plates is worked out.

What drives it is a line of straight pieces (`forward.imposed_position`), and the branches follow a straight piece
exactly, whatever its length: a few rows of a long block are enough. Only where there is hardly a force every row is
kept: contact is lost and found there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import Blocks

#: blocks of more rows than that are known at these parts of their length
_LONG = 16
_PLACES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True)
class Path:
    """A subset of a recording's rows, the first and the last among them: time_s (m,) s, position_m (m,) m, row (m,)."""

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    row: NDArray[np.int64]


def make_path(
    time_s: NDArray[np.float64], position_m: NDArray[np.float64], loose: NDArray[np.bool_],
    averaged: Blocks | None = None, corners_s: NDArray[np.float64] | None = None,
) -> Path:
    """Path through an imposed position (n,) m.

    loose (n,): rows that are kept, because the plates may part or meet there. averaged: blocks over which the force
    will be averaged. corners_s: times between which the position is straight.
    """
    n = time_s.size
    keep = loose.copy()
    keep[[0, n - 1]] = True
    if corners_s is not None:
        after = np.clip(np.searchsorted(time_s, corners_s), 1, n - 1)
        keep[after] = keep[after - 1] = True  # the corner lies between two rows
    if averaged is not None:
        for first, stop in zip(averaged.start, averaged.stop, strict=True):
            keep[first:stop] |= stop - first <= _LONG
            keep[np.rint(first + _PLACES * (stop - 1 - first)).astype(np.int64)] = True
    row = np.flatnonzero(keep)
    return Path(np.ascontiguousarray(time_s[row]), np.ascontiguousarray(position_m[row]), row)

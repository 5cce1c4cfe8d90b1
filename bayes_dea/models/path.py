"""The rows of a mechanical recording at which the material between plates is worked out.

What drives it is a line of straight pieces (`forward.imposed_position`), and the branches follow a straight piece
exactly, whatever its length: a few rows of a long block are enough. Only where there is hardly a force every row is
kept: contact is lost and found there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..noise.blocks import Blocks

#: blocks of more rows than that are known at these parts of their length
_LONG = 16
_PLACES = np.linspace(0.0, 1.0, 17)
#: part of a step from a row within which a corner is that row
ON_ROW = 1e-3


@dataclass(frozen=True)
class Path:
    """A subset of a recording's rows, the first and the last among them, and corners between rows.

    time_s (m,) s, position_m (m,) m; row (m,): index of the row, for a corner a number between two.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    row: NDArray[np.float64]

    @cached_property
    def durations(self) -> NDArray[np.float64]:
        """Times (m - 1,) s between them, see `durations`; not to be written to."""
        return durations(self.time_s)

    def of_rows(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Those of values (m,) that belong to rows."""
        return values[self.row == np.floor(self.row)]


def durations(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Times (m - 1,) s between stamps (m,), which are rounded in a file: those that are alike but for it are equal."""
    h = np.diff(time_s)
    step = float(np.median(h))
    h[np.abs(h - step) < 1e-6 * step] = step
    return h


def make_path(
    time_s: NDArray[np.float64], position_m: NDArray[np.float64], loose: NDArray[np.bool_],
    averaged: Blocks | None = None, corners: NDArray[np.float64] | None = None,
) -> Path:
    """Path through an imposed position (n,) m.

    loose (n,): rows that are kept, because the plates may part or meet there. averaged: blocks over which the force
    will be averaged. corners (2, c): times (s) and positions (m) between which it is straight; friction feels a turn
    that is cut by a tenth of a micrometre.
    """
    n = time_s.size
    keep = loose.copy()
    keep[[0, n - 1]] = True
    if corners is not None:
        after = np.clip(np.searchsorted(time_s, corners[0]), 1, n - 1)
        keep[after] = keep[after - 1] = True  # the corner lies between two rows
    if averaged is not None:
        for first, stop in zip(averaged.start, averaged.stop, strict=True):
            keep[first:stop] |= stop - first <= _LONG
            keep[np.rint(first + _PLACES * (stop - 1 - first)).astype(np.int64)] = True
    rows = np.flatnonzero(keep)
    t, x, row = time_s[rows], position_m[rows], rows.astype(np.float64)
    if corners is not None:
        share = (corners[0] - time_s[after - 1]) / (time_s[after] - time_s[after - 1])
        inside = (share > ON_ROW) & (share < 1.0 - ON_ROW)
        at = np.searchsorted(t, corners[0][inside])
        t, x = np.insert(t, at, corners[0][inside]), np.insert(x, at, corners[1][inside])
        row = np.insert(row, at, (after - 1 + share)[inside])
    return Path(np.ascontiguousarray(t), np.ascontiguousarray(x), row)

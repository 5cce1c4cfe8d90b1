"""A lag basis for a command that is not known beforehand.

The response to any held command is a sum of step responses, shifted and scaled. Lags whose combinations give the step
response of every time constant at all times up to the longest run therefore give the response to anything that will be
played; short pulses and slow alternation are added, so that neither differences nor sums lose digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..likelihood.basis import LagBasis, build_basis
from ..models.lags import Drive

#: points a decade at which responses are compared
_PER_DECADE = 60


def open_basis(step_s: float, longest_s: float, tolerance: float = 1e-8) -> LagBasis:
    """Basis for samples every `step_s` and runs of up to `longest_s`, whatever is commanded."""
    decades = max(1.0, np.log10(longest_s / step_s))
    times = np.unique(np.geomspace(1.0, longest_s / step_s, int(_PER_DECADE * decades)).astype(np.int64)) * step_s
    times = np.concatenate([[0.0], times])
    shapes = [np.ones(times.size)]
    for pulse in np.geomspace(step_s, longest_s / 10, max(2, int(decades))):
        shapes.append((times <= pulse * (1 + 1e-9)).astype(float))
    for half in np.geomspace(30 * step_s, longest_s / 3, max(2, int(decades))):
        shapes.append((np.floor(times / half) % 2 == 0).astype(float))
    return build_basis([_drive(times, s) for s in shapes], tolerance)


def _drive(times: NDArray, stress: NDArray) -> Drive:
    stress = stress.copy()
    stress[0] = 0.0
    return Drive(np.diff(times, prepend=0.0), 0.0, stress, stress, 0)

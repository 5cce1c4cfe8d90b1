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


def open_basis(step_s: float, longest_s: float, tolerance: float = 1e-8, linear: bool = False) -> LagBasis:
    """Basis for samples every `step_s` and runs of up to `longest_s`, whatever is commanded.

    linear: voltages run straight from row to row, so that stresses are parabolas: two more shapes within a step.
    """
    decades = max(1.0, np.log10(longest_s / step_s))
    times = np.unique(np.geomspace(1.0, longest_s / step_s, int(_PER_DECADE * decades)).astype(np.int64)) * step_s
    times = np.concatenate([[0.0], times])
    shapes = [np.ones(times.size)]
    for pulse in np.geomspace(step_s, longest_s / 10, max(2, int(decades))):
        shapes.append((times <= pulse * (1 + 1e-9)).astype(float))
    for half in np.geomspace(30 * step_s, longest_s / 3, max(2, int(decades))):
        shapes.append((np.floor(times / half) % 2 == 0).astype(float))
    if not linear:
        return build_basis([_drive(times, s) for s in shapes], tolerance)
    drives = [_straight(times, s) for s in shapes]
    bump = np.zeros(times.size)
    bump[1] = 1.0
    drives.append(Drive(drives[0].dt, 0.0, np.zeros(times.size), bump, 2))
    return build_basis(drives, tolerance)


def _drive(times: NDArray, stress: NDArray) -> Drive:
    stress = stress.copy()
    stress[0] = 0.0
    return Drive(np.diff(times, prepend=0.0), 0.0, stress, stress, 0)


def _straight(times: NDArray, stress: NDArray) -> Drive:
    """The voltage's root of the stress, straight between rows."""
    volts = np.sqrt(_drive(times, stress).stress)
    return Drive(np.diff(times, prepend=0.0), 0.0, volts**2, (0.5 * (volts + np.append(0.0, volts[:-1]))) ** 2, 2)

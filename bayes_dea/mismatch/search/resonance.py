"""Where a resonance is looked for: coarsely where it is damped well, then closer and closer as it rings longer.

What rings for many periods is matched within its own width only, and beside it with the wrong sign; a well damped one
at a frequency nearby agrees over the first periods, and shows where to look.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: damping ratio, step of log frequency, half-width of what is searched around the best so far, how many of these
_STAGES = ((0.35, 0.35, None, 0), (0.12, 0.12, None, 0), (0.04, 0.04, 0.12, 4), (0.015, 0.013, 0.03, 3))


def look_for_resonances(low: float, high: float, score: Callable[[Array], float]) -> None:
    """Score points (log frequency, log damping ratio) between the frequencies `low` and `high` (Hz).

    score: minus log posterior of a point (2,), infinite where it has none; what it scores it keeps.
    """
    known: list[tuple[float, float]] = []
    for damping, step, around, most in _STAGES:
        centres: list[Array]
        if around is None:
            centres = [np.asarray(np.arange(np.log(low), np.log(high), step), dtype=float)]
        else:
            best: list[float] = []
            for _, x in sorted(known):
                if all(abs(x - other) > around for other in best):
                    best.append(x)
            n = round(around / step)
            centres = [np.asarray(x + step * np.arange(-n, n + 1), dtype=float) for x in best[:most]]
        for x in np.unique(np.concatenate(centres)):
            if np.log(low) <= x <= np.log(high):
                known.append((score(np.array([x, np.log(damping)])), float(x)))

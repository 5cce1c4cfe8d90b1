"""Mains is of the place and not of a recording: lines that some show are in those, too, that cannot show them.

Where the fifth harmonic of a wave of 10 Hz falls on 50 Hz, nothing in that recording parts the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .mains import Mains, MainsLine

#: recordings that have to show a line, and the factor within which most of them agree on its amplitude
_SHOWN_BY = 2
_FACTOR = 1.5


def site_lines(found: Sequence[Mains | None], highest_Hz: Sequence[float]) -> list[Mains | None]:
    """Mains of recordings of one sensor, with the lines that the others show where one has none of that harmonic.

    highest_Hz: half the sampling rate of each. A line is taken over where two at least show it and two thirds of those
    agree on its amplitude within a factor of 1.5; its phase stays open.
    """
    out = list(found)
    shown: dict[tuple[float, int], list[MainsLine]] = {}
    for mains in found:
        for line in mains.lines if mains is not None else ():
            shown.setdefault((mains.base_Hz if mains is not None else 0.0, line.harmonic), []).append(line)
    for (base, harmonic), lines in sorted(shown.items()):
        sizes = np.array([line.amplitude for line in lines])
        middle = float(np.median(sizes))
        agree = np.abs(np.log(sizes / middle)) < np.log(_FACTOR)
        if len(lines) < _SHOWN_BY or np.mean(agree) < 2.0 / 3.0:
            continue
        # the frequency of the longest recordings is the best known: it has the smallest standard error of amplitude
        best = min(lines, key=lambda line: line.amplitude_se)
        new = replace(best, amplitude=middle, phase_rad=0.0)
        for i, mains in enumerate(out):
            if best.frequency_Hz > 0.95 * highest_Hz[i]:
                continue
            if mains is None:
                out[i] = Mains(base, best.frequency_Hz / harmonic, (new,), True, taken_over=True)
            elif mains.base_Hz == base and all(line.harmonic != harmonic for line in mains.lines):
                out[i] = replace(mains, lines=(*mains.lines, new))
    return out


def frequencies(found: Sequence[Mains | None], base_Hz: float, line: MainsLine) -> NDArray[np.float64]:
    """Frequencies (k,) at which recordings show the harmonic of a line."""
    shown = (other for mains in found if mains is not None and mains.base_Hz == base_Hz for other in mains.lines)
    return np.array([other.frequency_Hz for other in shown if other.harmonic == line.harmonic])

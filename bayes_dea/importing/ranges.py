"""Units by range: what a dielectric elastomer actuator on a bench can do, and what a sampling clock looks like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.importing.shapes import span

Array = NDArray[np.float64]

#: smallest and largest span in SI that a column of this quantity has in practice
PLAUSIBLE: dict[str, tuple[float, float]] = {
    "voltage": (50.0, 2.0e4),  # below 50 V nothing moves, above 20 kV there is no amplifier
    "displacement": (1e-7, 1e-2),  # strokes of stacks and films, also at a tenth of the voltage
    "position": (2e-5, 0.5),  # testing machines
    "force": (1e-3, 2e3),
    "capacitance": (1e-12, 1e-4),
}
_UNITS: dict[str, tuple[tuple[str, float], ...]] = {
    "voltage": (("V", 1.0), ("kV", 1e3)),
    "displacement": (("m", 1.0), ("mm", 1e-3), ("um", 1e-6)),
    "position": (("m", 1.0), ("mm", 1e-3), ("um", 1e-6)),
    "force": (("N", 1.0), ("mN", 1e-3)),
    "capacitance": (("F", 1.0), ("nF", 1e-9), ("pF", 1e-12)),
}


@dataclass(frozen=True)
class UnitGuess:
    """Units under which the numbers are plausible, the likeliest first, and what was looked at."""

    candidates: tuple[str, ...]
    why: str


def unit_by_range(quantity: str, values: Array) -> UnitGuess:
    """The units in which a column of this quantity can be."""
    size = span(values)
    if quantity == "voltage" or quantity == "capacitance":
        size = float(np.nanmax(np.abs(values)))
    low, high = PLAUSIBLE[quantity]
    fitting = tuple(u for u, factor in _UNITS[quantity] if low <= size * factor <= high)
    if quantity == "voltage" and "V" in fitting and "kV" in fitting:
        fitting = ("V",) if size > 20.0 else fitting
    what = "reaches" if quantity in ("voltage", "capacitance") else "spans"
    return UnitGuess(
        fitting,
        f"{what} {size:.4g}, in practice {low:g} to {high:g} {'V' if quantity == 'voltage' else ''}".rstrip()
        + {"displacement": " m", "position": " m", "force": " N", "capacitance": " F"}.get(quantity, ""),
    )


@dataclass(frozen=True)
class Clock:
    """What a rising column can be: a time in `unit`, or a count of samples."""

    unit: str | None
    why: str
    count: bool = False


def clock_unit(values: Array) -> Clock:
    """Unit of a column of times that names none: epochs and clocks by their size, counts by their steps."""
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    steps = steps[steps > 0]
    if steps.size == 0:
        return Clock(None, "does not rise")
    first, step = float(finite[0]), float(np.median(steps))
    for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
        if 9e8 < first * factor < 4e9:
            return Clock(unit, f"begins at {first:.10g}: {unit} since 1970")
    if (4e4 < first < 6e4 or 7.2e5 < first < 7.6e5) and step < 0.02:
        return Clock("day", f"begins at {first:.10g} in steps of {step:.3g}: days of a spreadsheet or of MATLAB")
    if np.all(steps == 1.0) and float(finite[0]) in (0.0, 1.0):
        return Clock(None, "counts 1, 2, 3: a number of samples, or a unit that is not said", count=True)
    if step < 1.0 or not np.all(np.mod(finite, 1.0) == 0):
        return Clock("s", f"steps of {step:.4g}: seconds")
    return Clock(None, f"whole steps of {step:.4g}: seconds, milliseconds or a count")


def rate_of(time: Array) -> tuple[float, bool]:
    """(samples a second, whether they are even): over the whole record where even, from the median step where not."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0]
    if steps.size == 0:
        return 0.0, False
    median = float(np.median(steps))
    even = float(np.mean(np.abs(steps - median) > 0.2 * median)) < 0.01
    return (steps.size / float(steps.sum()) if even else 1.0 / median), even

"""Whether one recording's times are in another unit than those of the others: ms among s."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_dea.campaign.schema import Recording

#: times the unit of the others, and what it is called
_FACTORS = ((1e3, "ms"), (1e6, "us"), (1.0 / 60.0, "min"), (1.0 / 3600.0, "h"))
#: two steps are one and the same within this share, and one is a factor of another within the next
_SAME, _NEAR = 0.02, 0.002
_FEWEST_OTHERS = 2
_STEPS = 2_000


def check_time_units(recordings: Sequence[Recording]) -> list[str]:
    """A warning for each voltage recording whose time step is a factor between units away from that of all others.

    A recording at 1 Hz among others at 1 kHz may be meant, so nothing is refused.
    """
    with_time = [r for r in recordings if r.is_voltage and r.time_s.size > 1]
    steps = np.array([_step(r) for r in with_time])
    out = []
    for i, r in enumerate(with_time):
        others = np.delete(steps, i)
        if others.size < _FEWEST_OTHERS or not np.all(others > 0.0) or np.ptp(others) > _SAME * others[0]:
            continue
        for factor, unit in _FACTORS:
            if abs(steps[i] / (factor * np.median(others)) - 1.0) < _NEAR:
                out.append(
                    f"{r.name}: its time step is {steps[i]:g} s, that of the other voltage recordings {others[0]:g} s. "
                    f'If its times are in {unit}, map them: columns.time_s = {{ name = "time_s", unit = "{unit}" }} in '
                    "its [format]; if it was recorded so, it is right as it is."
                )
    return out


def _step(r: Recording) -> float:
    """Median step of the first rows in s."""
    return float(np.median(np.diff(np.asarray(r.time_s[: _STEPS + 1], float))))

"""What is said of uneven times: recording by recording where few have them, in one line where many do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayes_dea.campaign.gaps import MANY
from bayes_dea.campaign.holes import holes_in, some_steps
from bayes_dea.campaign.schema import Recording

#: a step this far from the median one, as a share of it, is another; so many of them make times uneven
_OFF, _FEW = 0.2, 0.01


@dataclass(frozen=True)
class _Steps:
    """Shortest, longest and median step of a recording's times in s."""

    recording: str
    low: float
    high: float
    median: float

    @property
    def size(self) -> str:
        return f"steps from {self.low:.4g} to {self.high:.4g} s, median {self.median:.4g} s"


def uneven_warnings(recordings: Sequence[Recording]) -> list[str]:
    """Lines on times whose steps differ, which are used as they stand. Of holes it is said that they are (`holes`)."""
    found = [s for r in recordings if (s := _steps(r)) is not None]
    if len(found) < MANY:
        return [f"{s.recording}: time_s is uneven ({s.size}); the times are used as they stand." for s in found]
    most = max(found, key=lambda s: max(s.high / s.median, s.median / max(s.low, 1e-300)))
    return [
        f"time_s is uneven in {len(found)} of {len(recordings)} recordings, the most in {most.recording} "
        f"({most.size}); the times are used as they stand."
    ]


def _steps(r: Recording) -> _Steps | None:
    """Of a recording with uneven times."""
    if r.kind == "capacitance" or "time_s" not in r.columns or r.time_s.size < 2:
        return None
    steps = some_steps(r.time_s)
    median = float(np.median(steps))
    uneven = median > 0 and np.mean(np.abs(steps - median) > _OFF * median) > _FEW
    if not uneven or holes_in(r.time_s).size:
        return None
    return _Steps(r.name, float(steps.min()), float(steps.max()), median)

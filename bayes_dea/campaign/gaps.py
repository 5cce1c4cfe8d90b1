"""What is said of missing readings: recording by recording where few have some, in one line where many do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bayes_dea.campaign.rhythm import reading_every
from bayes_dea.campaign.schema import Recording

#: recordings with gaps of one column from which on one line tells of all
MANY = 4
#: recordings that this line names
NAMED = 3


@dataclass(frozen=True)
class _Gaps:
    """Gaps of a column of one recording: how many of how many readings, every how many rows one, and the first."""

    recording: str
    column: str
    count: int
    of: int
    every: int
    first: str
    drives: bool  # the actuator, so that what happened there is not known

    @property
    def share(self) -> float:
        return self.count / self.of

    @property
    def size(self) -> str:
        """Such as "12 in 6000 rows (0.2 %)"."""
        of = "rows" if self.every == 1 else f"readings, one every {self.every} rows"
        return f"{self.of} {of} ({100.0 * self.share:.2g} %)"

    def told(self) -> str:
        """One line."""
        many = times(self.count, "gap")
        text = f"{self.recording}: {self.column} has {many} in {self.size}, the first at {self.first}"
        if self.drives:
            text += ("; what drove the actuator there is not known, and readings for which that matters do not count. "
                     "Fill them in if the command is known")
        return text + "."


def gap_warnings(recordings: Sequence[Recording], where: Sequence[Callable[[int], str]]) -> list[str]:
    """Lines on the gaps of all columns. where: says for every recording where its elements stand."""
    found = [g for r, at in zip(recordings, where, strict=True) for g in _of_recording(r, at)]
    out: list[str] = []
    for column in dict.fromkeys(g.column for g in found):
        own = [g for g in found if g.column == column]
        # what drove the actuator is to be filled in, place by place
        many = len(own) >= MANY and not any(g.drives for g in own)
        out += [_together(own)] if many else [g.told() for g in own]
    return out


def _of_recording(r: Recording, where: Callable[[int], str]) -> list[_Gaps]:
    out = []
    for name, values in r.columns.items():
        first, every = reading_every(values) if name == r.output else (0, 1)
        own = np.isnan(values[first::every])  # of a sensor that is read at every k-th row the others are no gaps
        gaps = first + every * np.flatnonzero(own)
        if gaps.size:
            drives = name in ("voltage_V", "position_m") and name != r.output
            out.append(_Gaps(r.name, name, gaps.size, own.size, every, where(int(gaps[0])), drives))
    return out


def _together(own: Sequence[_Gaps]) -> str:
    """One line on the gaps of a column in many recordings; it names those with the largest share."""
    count, of = sum(g.count for g in own), sum(g.of for g in own)
    most = sorted(own, key=lambda g: -g.share)[:NAMED]
    named = "; ".join(f"{g.recording}: {g.count} in {g.size}, the first at {g.first}" for g in most)
    return (f"{own[0].column} has {times(count, 'gap')} in {len(own)} recordings ({100.0 * count / of:.2g} % of their "
            f"readings), the most in {named}.")


def times(count: int, what: str) -> str:
    """Such as "1 gap" or "3 gaps"."""
    return f"{count} {what}" + ("" if count == 1 else "s")

"""Mains pick-up in a stream: lines at 50 or 60 Hz and their harmonics, found while samples come.

`find_mains` looks at the newest rows at growing intervals; a line that leaps up is seen at once in what one block's
prediction leaves over. From then on each block is projected off the cosine and sine of every line, the data as well as
the responses of the model (`sums`): amplitude and phase are thereby integrated out block by block, with a flat prior,
and may wander with the grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: seconds of a session after which is looked for lines, and how often later
_LOOKS_S = (2.0, 4.0, 8.0, 16.0, 32.0)
_EVERY_S = 30.0
#: seconds of rows that are kept to look at
KEPT_S = 64.0
#: probability at which one look believes a line: there are thousands of looks in a day
_FALSE_ALARM = 1e-6
#: a line that leaps up explains this share of what is too much in a block
_SHARE = 0.5
_HARMONICS = 6


@dataclass
class MainsWatch:
    """frequencies: of the lines that are taken out of every block; found: what is known of each, for live.json."""

    step_s: float
    found: list[dict[str, Any]] = field(default_factory=list)
    _next_s: float = 0.0
    _look: int = 0
    _began_s: float = math.nan

    @property
    def frequencies(self) -> tuple[float, ...]:
        """In Hz, rising."""
        return tuple(sorted(line["frequency_Hz"] for line in self.found))

    def begin(self, time_s: float) -> None:
        """A new session: its clock starts anew."""
        self._began_s, self._look, self._next_s = time_s, 0, time_s + _LOOKS_S[0]

    def due(self, time_s: float) -> bool:
        """Whether it is time to look."""
        return time_s >= self._next_s

    def look(self, time_s: Array, voltage_V: Array, y: Array, masked: NDArray[np.bool_], session: int) -> bool:
        """Look at rows (n,); True where a line was found that was not there before."""
        from ..noise.mains import find_mains

        self._look += 1
        self._next_s = self._began_s + _LOOKS_S[self._look] if self._look < len(_LOOKS_S) else time_s[-1] + _EVERY_S
        if 0.5 / self.step_s < 55.0:
            return False
        mains = find_mains(y, time_s, voltage_V, mask=masked, false_alarm=_FALSE_ALARM)
        if mains is None:
            return False
        new = False
        for line in mains.lines:
            new |= self._take(line.frequency_Hz, line.amplitude, float(time_s[0]), session)
        return new

    def explains(self, time_s: Array, residual: Array, sd: float, session: int) -> bool:
        """Whether a line that is not known yet explains most of what a block's residual (n,) m scatters too much."""
        n = residual.size
        excess = float(residual @ residual) - n * sd * sd
        if n < 50 or excess <= 0:
            return False
        best, at = 0.0, 0.0
        for base in (50.0, 60.0):
            for k in range(1, _HARMONICS + 1):
                for f in k * base * (1 + np.array([-0.004, -0.002, 0.0, 0.002, 0.004])):
                    if f < 0.45 / self.step_s:
                        c = line_columns(time_s, (float(f),))
                        amount = float(np.sum((c.T @ residual) ** 2)) * 2 / n
                        best, at = max((best, at), (amount, float(f)))
        # what scatter alone does in the best of so many bands is far below 40 of its variances
        if best < max(_SHARE * excess, 40.0 * sd * sd):
            return False
        return self._take(at, math.sqrt(2 * best / n), float(time_s[0]), session)

    def _take(self, frequency: float, amplitude: float, time_s: float, session: int) -> bool:
        for line in self.found:
            if abs(frequency / line["frequency_Hz"] - 1) < 0.02:
                line["frequency_Hz"], line["amplitude_m"] = frequency, amplitude
                return False
        self.found.append({"frequency_Hz": frequency, "amplitude_m": amplitude, "since_s": time_s, "session": session})
        return True

    def words(self) -> list[str]:
        """For the warnings."""
        return [f"mains at {line['frequency_Hz']:.2f} Hz with an amplitude of {line['amplitude_m']:.2g} m is in the "
                f"readings from {line['since_s']:.0f} s on; it is estimated and taken out, block by block"
                for line in self.found]


def line_columns(time_s: Array, frequencies: tuple[float, ...]) -> Array:
    """Cosine and sine (n, 2 lines) of each line."""
    phase = 2 * np.pi * np.outer(time_s - (time_s[0] if time_s.size else 0.0), frequencies)
    return np.concatenate([np.cos(phase), np.sin(phase)], axis=1)

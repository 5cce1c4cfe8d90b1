"""Seconds by phase of a diagnosis."""

from __future__ import annotations

import time


class Laps:
    """A watch: called with the name of a phase as it ends, it adds what has passed since the last one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.begin()

    def begin(self) -> None:
        """What passed until now belongs to no phase."""
        self._mark = time.perf_counter()

    def __call__(self, phase: str) -> None:
        now = time.perf_counter()
        self.seconds[phase] = self.seconds.get(phase, 0.0) + now - self._mark
        self._mark = now

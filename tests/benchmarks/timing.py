"""Interleaved timing: every round calls every method once, and ratios are taken within a round.

A machine that is busy with something else slows a whole round, not one method, so that the median of the rounds'
ratios says more than the ratio of two medians. Processor time is counted, not the clock on the wall: what is timed
here runs in one thread and waits for nothing, and processor time leaves out what other programs took.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Timed:
    """Processor seconds of every call by method; `reference` is the method that ratios are taken to."""

    seconds: Mapping[str, tuple[float, ...]]
    reference: str

    def median(self, name: str) -> float:
        """Median seconds of one call."""
        return median(self.seconds[name])

    def ratio(self, name: str) -> float:
        """Median over rounds of seconds over those of the reference in the same round."""
        pairs = zip(self.seconds[name], self.seconds[self.reference], strict=False)
        return median([a / b for a, b in pairs])


def median(values: Any) -> float:
    """Median of a few numbers, nan of none."""
    ordered = sorted(values)
    n = len(ordered)
    return math.nan if n == 0 else 0.5 * (ordered[(n - 1) // 2] + ordered[n // 2])


def interleaved(
    methods: Mapping[str, Callable[[], Any]],
    reference: str,
    rounds: int = 7,
    slow_rounds: int = 2,
    slow_s: float = 0.3,
    target_s: float = 0.02,
) -> Timed:
    """Time methods (each without arguments) in turn; fast ones are repeated within a round until `target_s`.

    A method that takes longer than `slow_s` is called in the first `slow_rounds` rounds only. All are called once
    before, uncounted (compilation, caches).
    """
    repeats, slow = {}, set()
    for name, call in methods.items():
        once = _seconds(call, 1)
        if once > slow_s:
            once = _seconds(call, 1) if once < 4 * slow_s else once
        else:
            once = _seconds(call, 1)
        repeats[name] = max(1, min(20_000, round(target_s / max(once, 1e-7))))
        if once > slow_s:
            slow.add(name)
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for i in range(rounds):
        for name, call in methods.items():
            if name in slow and i >= slow_rounds:
                continue
            seconds[name].append(_seconds(call, repeats[name]))
    return Timed({name: tuple(v) for name, v in seconds.items()}, reference)


def _seconds(call: Callable[[], Any], n: int) -> float:
    began = time.process_time()
    for _ in range(n):
        call()
    return (time.process_time() - began) / n

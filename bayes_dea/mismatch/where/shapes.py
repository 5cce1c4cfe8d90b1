"""Windows with a shape, or here and there: a drift, harmonics and periods of a wave, what follows edges, levels, ways.

Each comes as its blocks, counted over all recordings, its shape over them (None: flat) and its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...gauss_newton.reduced import Piece
from .features import HARMONICS, SINCE_EDGE, Features

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

#: blocks in the shortest window
SMALLEST = 4
#: blocks of a recording that a drift is looked for in, at least
_DRIFTS = 16
#: periods of a wave that are looked at one by one
_PERIODS = 40
#: equal parts of the largest voltage
_LEVELS = 6
#: speed (ranges a second) from which on an input goes somewhere, and time (s) after an edge from which on
_GOES, _SETTLED_S = 0.05, 0.01


@dataclass(frozen=True)
class Window:
    """One place looked at."""

    family: str
    piece: int  # -1: over several recordings
    what: str
    t0_s: float
    t1_s: float
    key: str


Shaped = tuple[Rows, Array | None, Window]


@dataclass(frozen=True)
class _Look:
    """A recording: its index, what was measured, where its blocks begin among all, what these are like."""

    index: int
    channel: str
    begin: int
    features: Features

    def window(self, family: str, own: Rows, what: str, key: str, shape: Array | None = None) -> Shaped:
        """A window of its blocks `own`."""
        t = self.features.time_s
        return self.begin + own, shape, Window(family, self.index, what, float(t[own[0]]), float(t[own[-1]]), key)


def shaped(pieces: Sequence[Piece], looks: Sequence[Features], start: Rows) -> Iterator[Shaped]:
    """All of them. start: of the blocks of each piece."""
    seen = [_Look(i, p.channel, int(start[i]), f) for i, (p, f) in enumerate(zip(pieces, looks, strict=True))]
    for look in seen:
        yield from _drift(look)
        yield from _harmonics(look)
        yield from _periods(look)
    yield from _after_edges(seen)
    yield from _at_levels([look for look in seen if look.channel == "displacement"])
    yield from _on_the_way(seen)


def _drift(look: _Look) -> Iterator[Shaped]:
    nb = look.features.time_s.size
    if nb >= _DRIFTS:
        yield look.window("trend", np.arange(nb), "a drift over the recording", "drift", np.linspace(-1, 1, nb))


def _harmonics(look: _Look) -> Iterator[Shaped]:
    f = look.features
    if f.frequency_Hz <= 0:
        return
    inside = np.flatnonzero(np.isfinite(f.phase))
    for k in range(1, HARMONICS + 1):
        for name, wave in (("cos", np.cos), ("sin", np.sin)):
            what = f"harmonic {k} of {f.frequency_Hz:.3g} Hz ({name})"
            shape = wave(2 * np.pi * k * f.phase[inside])
            yield look.window("frequency", inside, what, f"{f.frequency_Hz:.3g}:{k}", shape)


def _periods(look: _Look) -> Iterator[Shaped]:
    f = look.features
    if f.frequency_Hz <= 0:
        return
    for repeat in range(min(int(f.repetition.max()) + 1, _PERIODS)):
        own = np.flatnonzero(f.repetition == repeat)
        if own.size < SMALLEST:
            continue
        turn = 2 * np.pi * f.phase[own]
        for name, shape in (("level", None), ("sin", np.sin(turn)), ("cos", np.cos(turn))):
            yield look.window("repetition", own, f"period {repeat + 1} ({name})", str(repeat + 1), shape)


def _after_edges(seen: Sequence[_Look]) -> Iterator[Shaped]:
    """Of each recording, and of all with the same channel where that are several."""
    for channel in dict.fromkeys(look.channel for look in seen):
        theirs = [look for look in seen if look.channel == channel]
        for sign, word, short in ((1, "rising", "rise"), (-1, "falling", "fall")):
            for low, high in pairwise(SINCE_EDGE):
                what, key, all_own = f"{low:g}-{high:g} s after {word} edges", f"{short}:{low:g}", []
                for look in theirs:
                    f = look.features
                    own = np.flatnonzero((f.since_edge_s >= low) & (f.since_edge_s < high) & (np.sign(f.jump) == sign))
                    if own.size:
                        all_own.append(look.begin + own)
                        yield look.window("edge", own, what, key)
                if len(all_own) > 1:
                    yield _across("edge", all_own, what, key)


def _at_levels(seen: Sequence[_Look]) -> Iterator[Shaped]:
    if not seen:
        return
    top = max(float(np.max(look.features.level)) for look in seen) or 1.0
    for j in range(_LEVELS):
        low, high = top * j / _LEVELS, top * (j + 1) / _LEVELS
        below = high if j + 1 < _LEVELS else np.inf
        at = [(look.begin, (look.features.level >= low) & (look.features.level < below)) for look in seen]
        own = [begin + np.flatnonzero(inside) for begin, inside in at]
        yield _across("voltage", own, f"{low:.0f}-{high:.0f} V", f"{0.5 * (low + high):.0f}")


def _on_the_way(seen: Sequence[_Look]) -> Iterator[Shaped]:
    """While the input goes up or down by itself: of each recording, and of all."""
    for name, sign in (("up", 1.0), ("down", -1.0)):
        what, all_own = f"while the input goes {name}", []
        for look in seen:
            f = look.features
            # inf before the first edge
            own = np.flatnonzero((sign * f.speed > _GOES) & (f.since_edge_s > _SETTLED_S))
            if own.size:
                all_own.append(look.begin + own)
                yield look.window("direction", own, what, name)
        if all_own:
            yield _across("direction", all_own, what, name)


def _across(family: str, parts: Sequence[Rows], what: str, key: str) -> Shaped:
    """A window over several recordings."""
    return np.concatenate(parts), None, Window(family, -1, what, 0.0, 0.0, key)

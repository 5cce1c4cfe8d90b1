"""Where recordings begin and end in one long file: restarts of time, run numbers, holes, and pauses between
protocols.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bayes_dea.importing.shapes import Run, filled, is_reading, scatter, span, voltage_shape
from bayes_dea.importing.tables import Array

MIN_ROWS = 10
_EQUAL = 0.03  # of the largest level
_LONG_TRAIN = 12


@dataclass(frozen=True)
class Part:
    """Rows first ... last-1 (from 0) of a table as one recording.

    `continued`: it goes on where the one before ended, so that the actuator had not rested; `rest_s` the time between.
    """

    first: int
    last: int
    why: str = ""
    continued: bool = False
    rest_s: float = 0.0


def split_rows(time: Array | None, run: Array | None, rows: int) -> list[Part]:
    """Parts by what the file says: a run number that changes, time that begins again."""
    marks: dict[int, str] = {}
    if run is not None:
        for i in np.flatnonzero(np.diff(run) != 0):
            marks[int(i) + 1] = "the run number changes"
    if time is not None:
        for i in np.flatnonzero(np.diff(time) < 0):
            marks.setdefault(int(i) + 1, f"time begins again, from {time[i]:.6g} to {time[i + 1]:.6g}")
    edges = [0, *sorted(marks), rows]
    out = []
    for a, b in pairwise(edges):
        # where the clock goes on, so does the actuator's memory
        goes_on = a > 0 and time is not None and time[a] > time[a - 1]
        rest = float(time[a] - time[a - 1]) if goes_on and time is not None else 0.0
        out.append(Part(a, b, marks.get(a, marks.get(b, "")), bool(goes_on), rest))
    return out


def defect(time: Array) -> int | None:
    """Row (from 0) at which time runs backwards without beginning again; None where it does not.

    A new recording begins near where the one before began; a clock that falls back a little is damaged.
    """
    begin = 0
    for i in np.flatnonzero(np.diff(time) < 0):
        first, before, now = float(time[begin]), float(time[i]), float(time[i + 1])
        if now > first + 0.1 * (before - first) + 2.0 * float(np.median(np.abs(np.diff(time[begin : i + 1])))):
            return int(i) + 1
        begin = int(i) + 1
    return None


def split_holes(time: Array, part: Part) -> list[Part]:
    """Parts by holes of half a minute and fifty steps or more. Ever longer steps (log-spaced creep) are no holes."""
    t = time[part.first : part.last]
    steps = np.diff(t)
    if steps.size < 2:
        return [part]
    beside = np.maximum(np.concatenate(([0.0], steps[:-1])), np.concatenate((steps[1:], [0.0])))
    holes = np.flatnonzero((steps > max(30.0, 50.0 * float(np.median(steps)))) & (steps > 10.0 * beside))
    edges = [0, *(int(h) + 1 for h in holes), t.size]
    out = []
    for k, (a, b) in enumerate(pairwise(edges)):
        if k == 0:
            out.append(Part(part.first + a, part.first + b, part.why, part.continued, part.rest_s))
        else:
            rest = float(t[a] - t[a - 1])
            out.append(
                Part(part.first + a, part.first + b, f"nothing was recorded for {rest:.4g} s before", True, rest)
            )
    return out


def split_pauses(time: Array, voltage: Array, part: Part) -> list[Part]:
    """Parts by pauses at zero volts between protocols of their own; conditioning steps stay with their hold."""
    t, v = time[part.first : part.last], filled(voltage[part.first : part.last])
    total = max(span(v), float(np.abs(v).max()))
    if total == 0.0:
        return [part]
    zero = np.abs(v) <= (0.02 * total if is_reading(v) else max(0.002 * total, 5.0 * scatter(v)))
    blocks = _blocks(t, v, zero, total)
    groups = _groups(t, blocks)
    if len(groups) < 2 or _train(t, groups) or not _clear(t, v, groups):
        return [part]
    out = []
    begin = part.first
    for k, group in enumerate(groups):
        if k + 1 < len(groups):
            pause_from, pause_to = group[-1].last, groups[k + 1][0].first
            step = float(np.median(np.diff(t)))
            quiet = max(round(min(1.0, 0.1 * float(t[pause_to] - t[pause_from])) / step), 1)
            end = part.first + max(pause_to - quiet, pause_from + 1)
        else:
            end = part.last
        why = "a pause at 0 V, and another protocol or another level after it"
        out.append(Part(begin, end, why, part.continued if k == 0 else True, part.rest_s if k == 0 else 0.0))
        begin = end
    return out


def _blocks(t: Array, v: Array, zero: np.ndarray, total: float) -> list[Run]:
    """Stretches away from zero; those that only touch zero for a moment are one. `level` is nan where it is not
    held.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~zero, [False])).astype(np.int8)))
    found = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    joined: list[tuple[int, int]] = []
    for a, b in found:
        if joined:
            before = joined[-1]
            pause = t[a] - t[before[1] - 1]
            held = _level(v, a, b, total) is not None and _level(v, *before, total) is not None
            if not held and (
                a - before[1] <= 3 or pause <= 0.15 * max(t[b - 1] - t[a], t[before[1] - 1] - t[before[0]])
            ):
                joined[-1] = (before[0], b)
                continue
        joined.append((a, b))
    out = []
    for a, b in joined:
        level = _level(v, a, b, total)
        out.append(Run(a, b, float("nan") if level is None else level))
    longest = max((r.last - r.first for r in out), default=0)
    return [r for r in out if r.last - r.first >= max(3, 0.005 * longest)]  # a spike is no protocol


def _level(v: Array, a: int, b: int, total: float) -> float | None:
    """The level that a stretch is held at, but for its edges."""
    middle = float(np.median(v[a:b]))
    good = np.abs(v[a:b] - middle) < 0.05 * total
    return middle if float(np.mean(good)) > 0.9 or (b - a) - int(good.sum()) <= 3 else None


def _groups(t: Array, blocks: list[Run]) -> list[list[Run]]:
    """Blocks that belong to one protocol: pulses of one level, up to a hold after conditioning steps."""
    groups: list[list[Run]] = []
    for block in blocks:
        if groups and _belongs(t, groups[-1], block):
            groups[-1].append(block)
        else:
            groups.append([block])
    return groups


def _belongs(t: Array, group: list[Run], block: Run) -> bool:
    before = group[-1]
    if not (np.isfinite(before.level) and np.isfinite(block.level)):
        return False
    if abs(before.level - block.level) > _EQUAL * max(abs(before.level), abs(block.level)):
        return False
    # equal steps, then one hold much longer: what follows is the next recording's conditioning
    durations = np.array([t[r.last - 1] - t[r.first] for r in group])
    steps = durations[:-1]
    held = (
        steps.size > 1
        and float(np.ptp(steps)) < 0.1 * float(steps.mean())
        and durations[-1] > 3.0 * float(steps.max())
    )
    return not held


def _clear(t: Array, v: Array, groups: list[list[Run]]) -> bool:
    """Whether every piece is a protocol of its own: a clear kind each, and real pauses between them.

    A random signal that happens to touch zero falls apart into pieces that are nothing in particular; it stays whole.
    """
    for before, after in pairwise(groups):
        first, last = before[-1].last, after[0].first
        shorter = min(t[before[-1].last - 1] - t[before[0].first], t[after[-1].last - 1] - t[after[0].first])
        if last - first < 10 or t[last] - t[first] < 0.05 * shorter:
            return False
    for group in groups:
        a, b = max(group[0].first - 5, 0), min(group[-1].last + 5, v.size)
        shape = voltage_shape(t[a:b], v[a:b])
        if not shape.sure or shape.kind == "voltage":
            return False
    return True


def _train(t: Array, groups: list[list[Run]]) -> bool:
    """Many short pulses of different heights: one signal with many levels, not many recordings."""
    if len(groups) <= _LONG_TRAIN or any(len(g) > 1 or not np.isfinite(g[0].level) for g in groups):
        return False
    return float(np.median([t[g[0].last - 1] - t[g[0].first] for g in groups])) < 20.0

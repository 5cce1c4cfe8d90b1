"""Commands of the menu's patterns as functions of their settings.

Each pattern gives its command twice: in full, for the bench to play, and at a few rows that stand for many readings,
for working out what it teaches. Every command begins with a quiet stretch, from which the offset is read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Settings = Mapping[str, float]

#: s of rest at the start and of 0 V at the end of each command
QUIET_S = 2.0
#: rows a period and periods that are worked out; the others count as like the last
_ROWS_A_PERIOD, _PERIODS = 48, 5
_RAMP_S = 0.3


@dataclass(frozen=True)
class Rows:
    """time_s (n,), values (n,) in force during the interval that ends at the row, readings (n,) that it stands for."""

    time_s: Array
    values: Array
    readings: Array


def levels(pattern: str, s: Settings) -> list[tuple[float, float]]:
    """(voltage in V, how long in s) of a pattern that holds voltages one after the other."""
    V = s["voltage_V"]
    if pattern == "creep":
        return [(V, s["duration_s"])]
    if pattern == "staircase":
        n = int(s["steps"])
        return [(V * k / n, s["hold_s"]) for k in (*range(1, n + 1), *range(n - 1, 0, -1))]
    if pattern == "repeat after a high step":
        hold = s["hold_s"]
        return [(V, hold), (0.0, hold), (s["high_V"], hold), (0.0, hold), (V, hold)]
    raise ValueError(pattern)


def duration_s(pattern: str, s: Settings) -> float:
    """Length of a command with its quiet ends."""
    if pattern in _LEVELS:
        return 2 * QUIET_S + sum(d for _, d in levels(pattern, s))
    return QUIET_S * (1 if pattern == "relaxation" else 2) + s["duration_s"]


_LEVELS = ("creep", "staircase", "repeat after a high step")
_WAVES: dict[str, Callable[[Array], Array]] = {
    "sine": lambda phase: np.sin(2 * np.pi * phase),
    "triangle": lambda phase: 1.0 - 4.0 * np.abs((phase + 0.25) % 1.0 - 0.5),
    "rectangle": lambda phase: np.where(phase % 1.0 < 0.5, 1.0, -1.0),
}


def command(pattern: str, s: Settings, t: Array) -> Array:
    """Command (n,) at times (n,) s: V, or m where plates move."""
    since = np.round(t - QUIET_S, 9)
    if pattern in _LEVELS:
        parts = levels(pattern, s)
        ends = np.cumsum([d for _, d in parts])
        at = np.searchsorted(ends, since, side="right")
        V = np.array([*(v for v, _ in parts), 0.0])
        return np.where(since >= 0, V[np.minimum(at, len(parts))], 0.0)
    running = (since >= 0) & (since < s["duration_s"] - 1e-9)
    if pattern == "chirp":
        return np.where(running, s["voltage_V"] + s["amplitude_V"] * np.sin(2 * np.pi * _chirp_phase(s, since)), 0.0)
    if pattern == "compression":
        phase = np.clip(since, 0.0, s["duration_s"]) * s["frequency_Hz"]
        return s["amplitude_m"] * (1 - np.abs(2 * (phase % 1.0) - 1))
    if pattern == "relaxation":
        return s["amplitude_m"] * np.clip(since / _RAMP_S, 0.0, 1.0)
    wave = _WAVES[pattern](np.round(since * s["frequency_Hz"], 9))
    return np.where(running, s["voltage_V"] + s["amplitude_V"] * wave, 0.0)


def _chirp_phase(s: Settings, since: Array) -> Array:
    """Cycles since the start of an exponential sweep."""
    rate = np.log(s["end_frequency_Hz"] / s["frequency_Hz"]) / s["duration_s"]
    return s["frequency_Hz"] / rate * np.expm1(rate * np.clip(since, 0.0, s["duration_s"]))


def full(pattern: str, s: Settings, rate_Hz: float) -> tuple[Array, Array]:
    """Time (n,) and command (n,) to be played. Held levels need rows at their ends only; waves get 200 a period."""
    end = duration_s(pattern, s)
    if pattern in _LEVELS:
        t = _held_times(pattern, s, 1.0 / rate_Hz)
        # a row's value was in force until it: one more row at each edge ends the level before
        return t, command(pattern, s, np.maximum(t - 0.5 / rate_Hz, 0.0))
    step = 1.0 / rate_Hz
    if pattern == "relaxation":
        fast = np.arange(0.0, QUIET_S + 2.0, step)
        t = np.concatenate([fast, np.arange(QUIET_S + 2.0, end, 0.5), [end]])
        return t, command(pattern, s, t)
    if pattern != "chirp":
        # whole rows to a quarter of a period, so that turning points and edges are among them
        period = 1.0 / s["frequency_Hz"]
        step = period / (4.0 * max(1, round(min(period / step, 200.0) / 4.0)))
    waving = QUIET_S + step * np.arange(round(s["duration_s"] / step) + 1)
    t = np.concatenate([np.arange(0.0, QUIET_S - 0.5 * step, step), waving, [waving[-1] + 0.5 * step, end]])
    return t, command(pattern, s, t)


def _held_times(pattern: str, s: Settings, step: float) -> Array:
    """Rows at the start, the ends of all levels, one step after each, and every second between."""
    edges = QUIET_S + np.concatenate([[0.0], np.cumsum([d for _, d in levels(pattern, s)])])
    end = edges[-1] + QUIET_S
    between = np.arange(0.0, end, max(1.0, end / 2000.0))
    return np.unique(np.round(np.concatenate([between, edges, edges + step, [end]]), 6))


def rows(pattern: str, s: Settings, rate_Hz: float) -> Rows:
    """The few rows that a command is worked out at."""
    if pattern in _LEVELS:
        return _held_rows(pattern, s, rate_Hz)
    if pattern == "relaxation":
        t = np.concatenate([[0.0, QUIET_S], QUIET_S + _RAMP_S * np.arange(1, 9) / 8,
                            QUIET_S + _RAMP_S + np.geomspace(0.05, s["duration_s"] - _RAMP_S, 90)])
        return _plain(t, command(pattern, s, t), rate_Hz)
    if pattern == "chirp":
        cycles = float(_chirp_phase(s, np.array([s["duration_s"]]))[0])
        return _chirp_rows(s, cycles, rate_Hz)
    return _periodic_rows(pattern, s, rate_Hz)


def _plain(t: Array, values: Array, rate_Hz: float) -> Rows:
    # the first row is a moment, not an interval
    return Rows(t, values, np.diff(t, prepend=t[0]) * rate_Hz)


def _held_rows(pattern: str, s: Settings, rate_Hz: float) -> Rows:
    times, values = [np.array([0.0, QUIET_S])], [np.zeros(2)]
    start = QUIET_S
    for V, length in [*levels(pattern, s), (0.0, QUIET_S)]:
        first = min(1.0 / rate_Hz, 0.2 * length)
        since = np.geomspace(first, length, 45 if length > 10 else 25)
        times.append(start + since)
        values.append(np.full(since.size, V))
        start += length
    return _plain(np.concatenate(times), np.concatenate(values), rate_Hz)


def _chirp_rows(s: Settings, cycles: float, rate_Hz: float) -> Rows:
    """Twelve whole periods spread over the sweep; between them the mean square acts."""
    rate = np.log(s["end_frequency_Hz"] / s["frequency_Hz"]) / s["duration_s"]
    begin = np.unique(np.floor(np.geomspace(1.0, max(cycles - 1.0, 2.0), 12)) - 1.0)
    mean_square = np.sqrt(s["voltage_V"] ** 2 + 0.5 * s["amplitude_V"] ** 2)
    t, v, w = [np.array([0.0, QUIET_S])], [np.zeros(2)], [np.array([0.0, QUIET_S * rate_Hz])]
    last = QUIET_S
    ends = np.append(begin[1:], cycles)
    for c, until in zip(begin, ends, strict=True):
        phase = c + np.arange(1, _ROWS_A_PERIOD + 1) / _ROWS_A_PERIOD
        at = QUIET_S + np.log1p(phase * rate / s["frequency_Hz"]) / rate
        start = QUIET_S + np.log1p(c * rate / s["frequency_Hz"]) / rate
        if start > last + 1e-9:
            t.append(np.array([start]))
            v.append(np.array([mean_square]))
            w.append(np.zeros(1))
        stop = QUIET_S + np.log1p(until * rate / s["frequency_Hz"]) / rate
        share = np.diff(at, prepend=start)
        t.append(at)
        v.append(s["voltage_V"] + s["amplitude_V"] * np.sin(2 * np.pi * (phase - 0.5 / _ROWS_A_PERIOD)))
        w.append(share * rate_Hz * (stop - start) / (at[-1] - start))
        last = float(at[-1])
    return Rows(np.concatenate(t), np.concatenate(v), np.concatenate(w))


def _periodic_rows(pattern: str, s: Settings, rate_Hz: float) -> Rows:
    """The first periods and the last ones row by row, the last with the weight of those left out.

    Between them acts one constant value: that with the mean square of the wave (for plates its mean).
    """
    period = 1.0 / s["frequency_Hz"]
    n = _ROWS_A_PERIOD
    whole = s["duration_s"] / period
    phase = np.arange(1, n + 1) / n
    periods = max(1, round(whole))
    many = periods > 2 * _PERIODS
    shown = [*range(_PERIODS), *range(periods - _PERIODS, periods)] if many else list(range(periods))
    t, w = [np.array([0.0, QUIET_S])], [np.array([0.0, QUIET_S * rate_Hz])]
    for k in shown:
        t.append(QUIET_S + (k + phase) * period)
        weight = 1.0 if not many or k < _PERIODS else (periods - _PERIODS) / _PERIODS
        w.append(np.full(n, weight * period / n * rate_Hz))
    time, weight_ = np.concatenate(t), np.concatenate(w)
    mechanical = pattern == "compression"
    # a held value is that of the middle of its interval, where plates go in straight lines that of its end
    back = 0.0 if mechanical else 0.5 * period / n
    values = np.where(time > QUIET_S + 1e-12, _wave(pattern, s, time - QUIET_S - back), 0.0)
    if many:
        at = 2 + _PERIODS * n
        gap = QUIET_S + (periods - _PERIODS) * period
        if mechanical:
            inner = np.array([0.25, 0.5, 0.75]) * (gap - time[at - 1]) + time[at - 1]
            fill = np.full(3, 0.5 * s["amplitude_m"])
        else:
            square = {"sine": 0.5, "triangle": 1.0 / 3.0, "rectangle": 1.0}[pattern]
            inner = np.array([gap])
            fill = np.array([np.sqrt(s["voltage_V"] ** 2 + square * s["amplitude_V"] ** 2)])
        time = np.insert(time, at, inner)
        values = np.insert(values, at, fill)
        weight_ = np.insert(weight_, at, np.zeros(inner.size))
    return Rows(time, values, weight_)


def _wave(pattern: str, s: Settings, since: Array) -> Array:
    if pattern == "compression":
        return s["amplitude_m"] * (1 - np.abs(2 * ((since * s["frequency_Hz"]) % 1.0) - 1))
    return s["voltage_V"] + s["amplitude_V"] * _WAVES[pattern](since * s["frequency_Hz"])

"""Whether recordings that are said to be of one specimen can be: strokes at the same voltage that are too far apart.

What is compared: two recordings of one specimen and the same geometry, both begun at rest, of the same kind, their
largest voltages equal within 2 %, and either a held step from rest (the stroke at the same time after it, so that creep
does not count) or a wave between the same voltages at the same frequency within 10 % (the span of the later half of its
swings). A gain is common to a sensor, offsets drop out of a stroke. What is too far: more than a factor of 1.5 and more
than six standard errors of either reading. Warmth, rest and softening change a silicone or acrylic film by less between
two recordings; another specimen that is closer than that cannot be told apart, and nothing is said. Strokes at other
voltages are never compared: the law between them is what a calibration is to find.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.plausibility import dominant_frequency, swings
from bayes_dea.campaign.schema import Recording, Sensor
from bayes_dea.campaign.scratch import computed

_SAME_VOLTAGE, _SAME_FREQUENCY = 0.02, 0.10
FACTOR = 1.5
_STANDARD_ERRORS = 6.0
#: a stroke is read where the step was held at least this many samples
_LEAST_SAMPLES = 20
#: samples of a long recording that quantiles are taken of, and rows before a step that are looked at
_ENOUGH, _SEEN_BEFORE = 1_000_000, 5_000_000


def _some(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Enough of a long column for its quantiles."""
    return values[:: max(1, values.size // _ENOUGH)]


@dataclass(frozen=True)
class _Step:
    """The first long hold of a recording: `rest` is the reading before, (n,) time from the step on and displacement."""

    volts: float
    rest: float
    time: NDArray[np.float64]
    reading: NDArray[np.float64]

    def stroke(self, until_s: float) -> float:
        """Median over the later 40 % of the first `until_s` of the hold, less the reading at rest."""
        begin = float(self.time[0])
        first = int(np.searchsorted(self.time, begin + 0.6 * until_s))
        last = int(np.searchsorted(self.time, begin + until_s, side="right"))
        held = _some(self.reading[first:last])
        held = held[np.isfinite(held)]
        return float(np.median(held)) - self.rest if held.size else float("nan")

    @property
    def length_s(self) -> float:
        """How long it was held."""
        return float(self.time[-1] - self.time[0])


@dataclass(frozen=True)
class _Wave:
    """A wave and its swings: lowest voltage of them, first and last row. Rests before and after lie at another."""

    frequency_Hz: float
    lowest: float
    first: int
    last: int


def check_specimens(recordings: Sequence[Recording], sensors: Mapping[str, Sensor]) -> list[str]:
    """A text for the worst pair of each specimen that cannot be one and the same; empty where nothing can be said."""
    sensor = sensors.get("displacement", Sensor())
    noise = max(sensor.fluctuation or 0.0, sensor.resolution or 0.0)
    problems = []
    candidates = [r for r in recordings if r.is_voltage and r.rested]
    for specimen in dict.fromkeys(r.specimen for r in candidates):
        members = [r for r in candidates if r.specimen == specimen]
        worst: tuple[float, str] = (FACTOR, "")
        steps = {r.name: _held_step(r) for r in members}
        waves = {r.name: _wave(r) if steps[r.name] is None else None for r in members}
        for i, b in enumerate(members):
            for a in members[:i]:
                found = _compare(a, b, steps, waves, noise)
                if found is not None and found[0] > worst[0]:
                    worst = found
        if worst[1]:
            problems.append(worst[1])
    return problems


def _compare(a: Recording, b: Recording, steps: Mapping[str, _Step | None], waves: Mapping[str, _Wave | None],
             noise: float) -> tuple[float, str] | None:
    """(factor between the two strokes, text), None where they cannot be compared or agree."""
    if a.kind != b.kind or a.actuator != b.actuator:
        return None
    one, two, here, there = steps[a.name], steps[b.name], waves[a.name], waves[b.name]
    if one is not None and two is not None:
        volts = (one.volts, two.volts)
        until = min(one.length_s, two.length_s)
        strokes = (one.stroke(until), two.stroke(until))
        what = f"{until:.3g} s after the step"
    elif here is not None and there is not None:
        if abs(np.log(here.frequency_Hz / there.frequency_Hz)) > _SAME_FREQUENCY:
            return None
        volts = (_largest(a), _largest(b))
        if abs(here.lowest - there.lowest) > _SAME_VOLTAGE * volts[0]:
            return None
        strokes = (_later_span(a, here), _later_span(b, there))
        what = f"peak to peak at {here.frequency_Hz:.3g} Hz"
    else:
        return None
    if abs(np.log(volts[0] / volts[1])) > _SAME_VOLTAGE or not np.all(np.isfinite(strokes)):
        return None
    small, large = sorted(np.abs(strokes))
    # the scatter of a median of 20 readings, twice, and that of a baseline
    error = noise * np.sqrt(2.0 * 1.57 / _LEAST_SAMPLES)
    if large - FACTOR * small <= _STANDARD_ERRORS * error:
        return None
    factor = float(large / max(small, error, 1e-300))
    return factor, (
        f'{a.name} and {b.name} are both said to be of specimen "{a.specimen}", but at {volts[0]:.4g} V the stroke is '
        f"{strokes[0]:.3g} m in the one and {strokes[1]:.3g} m in the other ({what}). If they are two, say so: "
        f'specimen = "..." on those of the other. If one is damaged or in another unit, take it out or map it.')


def _largest(r: Recording) -> float:
    volts = r.columns["voltage_V"]
    return max(float(np.nanmax(volts)), -float(np.nanmin(volts)))


def _held_step(r: Recording) -> _Step | None:
    """The longest hold at the largest voltage that begins from rest within 2 % of its length."""
    t, v, y = r.time_s, r.columns["voltage_V"], r.columns["displacement_m"]
    top = _largest(r)
    if top <= 0.0:
        return None
    on = computed(lambda x: np.abs(x) >= 0.98 * top, v, dtype=np.bool_)
    changes = 1 + np.flatnonzero(on[1:] != on[:-1])
    edges = np.concatenate([[0] if on[0] else [], changes, [on.size] if on[-1] else []]).astype(np.int64)
    begins, ends = edges[::2], edges[1::2]
    if begins.size == 0 or begins.size > 1000:
        return None
    k = int(np.argmax(t[ends - 1] - t[begins]))
    begin, end = int(begins[k]), int(ends[k])
    length = float(t[end - 1] - t[begin])
    if end - begin < 2 * _LEAST_SAMPLES or length < 0.2 * float(t[-1] - t[0]):
        return None
    # the last rows before it at rest, and not a ramp that took its time
    early = max(0, begin - _SEEN_BEFORE)
    off = early + np.flatnonzero(np.abs(v[early:begin]) <= 0.02 * top)
    if off.size < _LEAST_SAMPLES or float(t[begin] - t[off[-1]]) > 0.02 * length:
        return None
    rest = y[off[-_LEAST_SAMPLES:]]
    time, reading = t[begin:end], y[begin:end]
    if not np.isfinite(rest).any() or np.isfinite(reading[:_ENOUGH]).sum() < 2 * _LEAST_SAMPLES:
        return None
    return _Step(top, float(np.nanmedian(rest)), time, reading)


def _wave(r: Recording) -> _Wave | None:
    v = r.columns["voltage_V"]
    frequency = dominant_frequency(v, r.time_s)
    if frequency <= 0.0:
        return None
    _, first, last = swings(v)
    return _Wave(frequency, float(np.nanmin(v[first : last + 1])), first, last)


def _later_span(r: Recording, wave: _Wave) -> float:
    y = _some(r.columns["displacement_m"][(wave.first + wave.last) // 2 : wave.last + 1])
    if np.isfinite(y).sum() < _LEAST_SAMPLES:
        return float("nan")
    low, high = np.nanpercentile(y, [5, 95])
    return float(high - low)

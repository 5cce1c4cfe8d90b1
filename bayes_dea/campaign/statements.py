"""Whether a sensor's statements can be meant as they stand: off by a factor of a thousand, in one place or another.

A fluctuation is a statement, not a truth, and may be wrong by a factor of several. Only what contradicts the recordings
or itself is an error: the scatter of quiet stretches, and the largest thing that a sensor has seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.plausibility import usual_span
from bayes_dea.campaign.schema import Recording, Sensor
from bayes_dea.campaign.vocabulary import SENSOR_UNITS

#: a scatter this many times the stated one is no matter of conditions any more
_FAR_OFF = 100.0
#: an accuracy this many times the largest signal says nothing about it
_LARGER_THAN_ALL = 10.0
#: scatter below this share of the signal: a simulation without noise
_NO_NOISE = 1e-4
#: different readings that may stand within one resolution step by rounding alone
_FEW_LEVELS = 10
#: samples over which the scatter is judged at a time, and how many of such stretches there must be
_WINDOW, _WINDOWS = 64, 4


def check_statements(recordings: Sequence[Recording], sensors: Mapping[str, Sensor]) -> list[str]:
    """What is wrong with `[sensor.X]`, as texts that name the key, the numbers and the remedy; empty where nothing is.

    Looks at the columns `displacement_m`, `force_N` and `position_m` of all recordings of a sensor. The sensors hold
    numbers in the SI unit of their channel.
    """
    problems = []
    for channel, sensor in sensors.items():
        unit = SENSOR_UNITS.get(channel)
        name = f"{channel}_{unit}"
        if name not in ("displacement_m", "force_N", "position_m"):
            continue
        columns = [(r, r.columns[name]) for r in recordings if name in r.columns]
        spans = [(usual_span(values), r) for r, values in columns]
        largest, seen_in = max(spans, key=lambda pair: pair[0], default=(0.0, None))
        if seen_in is not None and largest > 0.0:
            problems += _one(f"[sensor.{channel}]", unit or "", name, sensor, largest, seen_in.name, columns)
    return problems


def _one(where: str, unit: str, name: str, sensor: Sensor, largest: float, seen_in: str,
         columns: Sequence[tuple[Recording, NDArray[np.float64]]]) -> list[str]:
    problems = []
    power = f"Is it off by a power of ten? The unit is {unit}; correct it in campaign.toml."
    fluctuation, accuracy, resolution = sensor.fluctuation, sensor.accuracy, sensor.resolution
    moved = f"{name} ever moved ({largest:.3g} {unit}, in {seen_in})"
    if resolution is not None and resolution > largest and any(_levels(values) > _FEW_LEVELS for _, values in columns):
        problems.append(f"campaign.toml, {where}: resolution_{unit} = {resolution:g} is more than {moved}, but "
                        f"there are more than {_FEW_LEVELS} different readings. {power}")
    if accuracy is not None and accuracy > _LARGER_THAN_ALL * largest:
        problems.append(f"campaign.toml, {where}: accuracy_{unit} = {accuracy:g} is {accuracy / largest:.2g} times as "
                        f"much as {moved}. {power}")
    if accuracy is not None and resolution is not None and accuracy < 0.4 * resolution:
        problems.append(f"campaign.toml, {where}: accuracy_{unit} = {accuracy:g} is less than half of one resolution "
                        f"step, resolution_{unit} = {resolution:g}, which no sensor can promise. {power}")
    if fluctuation is not None:
        scatters = [(s, r.name) for r, values in columns if (s := quiet_scatter(values, r)) is not None]
        quietest, name_of = min(scatters, default=(0.0, ""))
        if quietest > _FAR_OFF * max(fluctuation, resolution or 0.0):
            problems.append(f"campaign.toml, {where}: fluctuation_{unit} = {fluctuation:g}, but {name} scatters by "
                            f"{quietest:.3g} {unit} even in the quietest stretches ({name_of}), "
                            f"{quietest / fluctuation:.2g} times as much. {power}")
        loudest, name_of = max(scatters, default=(0.0, ""))
        # simulated without noise is no contradiction
        contradicted = largest > loudest > max(_NO_NOISE * largest, 0.1 * (resolution or 0.0))
        if fluctuation > _LARGER_THAN_ALL * largest or (contradicted and fluctuation > _FAR_OFF * loudest):
            seen = f"it scatters by {loudest:.3g} {unit} in quiet stretches ({name_of})" if scatters else "not more"
            problems.append(f"campaign.toml, {where}: fluctuation_{unit} = {fluctuation:g}, but {largest:.3g} {unit} "
                            f"is all that {name} ever moved (in {seen_in}), and {seen}. {power}")
    return problems


def _levels(values: NDArray[np.float64]) -> int:
    some = values[:: max(1, values.size // 1000)]
    return int(np.unique(some[np.isfinite(some)]).size)


def quiet_scatter(values: NDArray[np.float64], recording: Recording) -> float | None:
    """Standard deviation of the noise in the quietest quarter of the stretches of constant drive; None without any.

    From second differences (a drift and a slow creep drop out), their median absolute deviation, in windows of 64
    samples of the (n,) `values`.
    """
    drive = recording.columns.get("voltage_V", recording.columns.get("position_m"))
    if drive is None or values.size < _WINDOW:
        return None
    # a long recording is judged by stretches from all over it
    starts = np.arange(0, values.size - _WINDOW + 1, _WINDOW)
    starts = starts[:: max(1, starts.size // 2000)]
    rows = starts[:, None] + np.arange(_WINDOW)
    y, u = values[rows], drive[rows]
    moves = 0.002 * (np.nanmax(drive) - np.nanmin(drive)) if np.isfinite(drive).any() else 0.0
    still = np.isfinite(y).all(axis=1) & np.isfinite(u).all(axis=1) & (np.ptp(u, axis=1) <= max(moves, 0.0))
    if still.sum() < _WINDOWS:
        return None
    second = np.diff(y[still], n=2, axis=1)
    sd = 1.4826 * np.median(np.abs(second), axis=1) / np.sqrt(6.0)
    return float(np.percentile(sd, 25))

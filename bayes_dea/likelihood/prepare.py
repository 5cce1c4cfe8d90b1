"""A recording made ready for a likelihood: what was observed, what disturbs it, how large its noise is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Campaign, Recording, Sensor
from ..errors import InputError
from ..models.electrostatics import filled_input

if TYPE_CHECKING:
    from ..noise.mains import Mains

CHANNELS = {"displacement_m": "displacement", "force_N": "force"}


@dataclass(frozen=True)
class Prepared:
    """One recording with its masks and its disturbances.

    y (n,): observed column, NaN where not observed. observed (n,) bool: neither gap nor drop-out.
    """

    recording: Recording
    channel: str
    sensor: Sensor
    y: NDArray[np.float64]
    observed: NDArray[np.bool_]
    dropouts: int
    mains: Mains | None
    quiet_sd: float
    quiet_rho: float

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.recording.name

    @property
    def n(self) -> int:
        """Number of observed samples."""
        return int(self.observed.sum())

    def signal(self) -> float:
        """Span of the observed column between its 0.1 and 99.9 % quantiles."""
        low, high = np.quantile(self.y[self.observed][:: max(1, self.n // 200_000)], [0.001, 0.999])
        return float(high - low)

    def nuisance(self) -> NDArray[np.float64]:
        """Columns that each recording adds linearly (n, m): one, and cosine and sine of each mains line."""
        t = self.recording.time_s
        columns = [np.ones(t.size)]
        for line in self.mains.lines if self.mains is not None else ():
            phase = 2 * np.pi * line.frequency_Hz * (t - t[0])
            columns += [np.cos(phase), np.sin(phase)]
        return np.stack(columns, axis=1)


def prepare(campaign: Campaign, recording: Recording) -> Prepared:
    """Masks, mains line and quiet noise of one recording.

    Raises InputError when the sensor of its output is not stated or too little was observed.
    """
    from ..noise.dropouts import find_dropouts
    from ..noise.mains import find_mains
    from ..noise.quiet import quiet_noise

    channel = CHANNELS.get(recording.output)
    if channel is None:
        raise InputError(f"{recording.name}: recordings of kind '{recording.kind}' cannot be calibrated on")
    sensor = campaign.sensors.get(channel)
    if sensor is None:
        unit = "m" if channel == "displacement" else "N"
        raise InputError(
            f"[sensor.{channel}] is missing in campaign.toml: the noise of {recording.name} is built from "
            f"its stated fluctuation, accuracy and resolution; copy them from the data sheet, as fluctuation_"
            f"{unit}, accuracy_{unit}, resolution_{unit}"
        )
    y = np.asarray(recording.columns[recording.output], float)
    drive = filled_input(recording.columns["voltage_V" if recording.is_voltage else "position_m"])
    # drop-outs are a fault of laser sensors; a force that leaps for a sample may be real
    if channel == "displacement":
        dropouts = find_dropouts(y, drive, resolution=sensor.resolution)
    else:
        dropouts = np.zeros(y.size, dtype=bool)
    observed = np.isfinite(y) & ~dropouts
    if observed.sum() < 20:
        raise InputError(
            f"{recording.name}: only {int(observed.sum())} samples of {recording.output} were observed; "
            "a recording needs at least 20"
        )
    clean = np.where(observed, y, np.nan)
    quiet = quiet_noise(clean, drive, recording.time_s)
    mains = find_mains(clean, recording.time_s, drive)
    return Prepared(recording, channel, sensor, y, observed, int(dropouts.sum()), mains, quiet.sd, quiet.rho)


def prepare_all(
    campaign: Campaign,
    recordings: tuple[Recording, ...],
    workers: int = 1,
    report: Callable[[float, float, str], None] | None = None,
) -> tuple[Prepared, ...]:
    """`prepare` for several recordings, on threads. report: called with (done, of, name) after each."""
    from concurrent.futures import ThreadPoolExecutor

    out = []
    with ThreadPoolExecutor(max(1, workers)) as pool:
        for r, done in zip(recordings, pool.map(lambda r: prepare(campaign, r), recordings), strict=True):
            out.append(done)
            if report is not None:
                report(len(out), len(recordings), r.name)
    return tuple(out)


@dataclass(frozen=True)
class RateClasses:
    """Sampling steps of one sensor: each has a noise correlation of its own, stated per step.

    Whether a sensor's noise is correlated in time (a filter) or from sample to sample (processing) is not known;
    recordings at one rate share a rho, those at another rate have another.
    """

    steps_s: tuple[float, ...]

    def of(self, prepared: Prepared) -> int:
        """Index of the class of a recording."""
        step = median_step(prepared.recording)
        return int(np.argmin([abs(np.log(step / s)) for s in self.steps_s]))


def median_step(recording: Recording) -> float:
    """Median time between rows in s."""
    return float(np.median(np.diff(recording.time_s)))


def rate_classes(prepared: tuple[Prepared, ...], tolerance: float = 0.2) -> RateClasses:
    """Classes of sampling steps that differ by more than `tolerance` (in the logarithm), finest first."""
    steps: list[float] = []
    for step in sorted(median_step(p.recording) for p in prepared):
        if not steps or abs(np.log(step / steps[-1])) > tolerance:
            steps.append(step)
    return RateClasses(tuple(steps))

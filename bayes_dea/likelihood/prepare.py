"""A recording made ready for a likelihood: what was observed, what disturbs it, how large its noise is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..campaign.pace import pace_of
from ..campaign.rhythm import reading_every, with_a_reading
from ..campaign.schema import Campaign, Recording, Sensor
from ..campaign.scratch import BLOCK, beside, computed, pieces, rows_where
from ..errors import InputError
from ..models.missing_drive import drive_values, driven
from ..noise.stated import signal_size

if TYPE_CHECKING:
    from ..noise.mains import Mains

CHANNELS = {"displacement_m": "displacement", "force_N": "force"}
#: readings at rest that say how large the noise is and how correlated (to 3 %, and to 0.05)
_AT_REST = 512
#: readings in a row whose absence ends no block, as long as no more than this share of all is missing like that: the
#: variance of a block's mean then comes out too large by about that share where noise is correlated
_SHORT_GAP, _RARE = 20, 0.1
#: share of the largest voltage that a recording may begin with and count as begun at rest: its square is nothing
_AT_NOTHING = 0.01


@dataclass(frozen=True)
class Prepared:
    """One recording with its masks and its disturbances.

    y (n,): observed column, NaN where not observed and where a sensor had lost its target. observed (n,) bool: neither
    gap nor drop-out, nor a reading that a sensor holds for a while (`stuck` of them), nor one that answers a drive that
    was not recorded, nor the first one of a recording that begins under voltage.
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
    quiet_n: int = 0  # readings at rest that the two are from; without any they are those of white noise
    stuck: int = 0

    @property
    def name(self) -> str:
        """Name of the recording."""
        return self.recording.name

    @property
    def n(self) -> int:
        """Number of observed samples."""
        return int(np.count_nonzero(self.observed))

    @cached_property
    def step_s(self) -> float:
        """Time between rows in s: the median one, of a sampler that changes its pace that of the finest."""
        return pace_of(self.recording.time_s).step_s

    @cached_property
    def masked(self) -> NDArray[np.bool_]:
        """Rows (n,) that do not count in the block that they lie in: recorded ones that are not observed, what a slow
        sensor was not read at, and readings that are missing here and there."""
        out = computed(lambda y, seen: ~seen & np.isfinite(y), self.y, self.observed, dtype=np.bool_)
        unread = beside(self.y, np.bool_)
        unread[:] = True
        read = with_a_reading(self.y)
        unread[read] = False
        out |= unread
        _mark_short_gaps(out[read], self.y[read])
        return out

    @cached_property
    def reading_step_s(self) -> float:
        """Median time between readings in s: those of a slow sensor come at every k-th row."""
        return reading_every(self.y)[1] * self.step_s

    def signal(self) -> float:
        """Size of what was observed, noise apart (`signal_size`)."""
        low, high = np.quantile(self.some(200_000), [0.001, 0.999])
        return signal_size(float(high - low), self.quiet_sd)

    def some(self, count: int) -> NDArray[np.float64]:
        """Every k-th of the observed readings, of a recording with more than twice `count` of them; at most 2 count."""
        every = max(1, self.n // count)
        out, seen = [], 0
        for part in pieces(self.y.size, BLOCK):
            here = self.y[part][self.observed[part]]
            out.append(here[-seen % every :: every])
            seen += here.size
        return np.concatenate(out)

    def nuisance(self) -> NDArray[np.float64]:
        """Columns that each recording adds linearly (n, m): one, and cosine and sine of each mains line."""
        t = self.recording.time_s
        lines = self.mains.lines if self.mains is not None else ()
        out = beside(t, n=t.size * (1 + 2 * len(lines))).reshape(t.size, -1)
        for part in pieces(t.size, BLOCK):
            out[part, 0] = 1.0
            for k, line in enumerate(lines):
                phase = 2 * np.pi * line.frequency_Hz * (t[part] - t[0])
                out[part, 1 + 2 * k], out[part, 2 + 2 * k] = np.cos(phase), np.sin(phase)
        return out


def rested(prepared: Sequence[Prepared], others: Sequence[Prepared] = ()) -> list[Prepared]:
    """Those that tell the noise because they were at rest for long enough; else for a while; else those of `others`.

    All where none was at rest. A wave that begins at once tells what noise scatters by from reading to reading: of
    correlated noise that is half and less.
    """
    for some in (prepared, others):
        for least in (_AT_REST, 1):
            found = [p for p in some if p.quiet_n >= least]
            if found:
                return found
    return list(prepared)


def prepare(campaign: Campaign, recording: Recording) -> Prepared:
    """Masks, mains line and quiet noise of one recording.

    Raises InputError when the sensor of its output is not stated or too little was observed.
    """
    from ..noise.dropouts import find_dropouts
    from ..noise.flat import stuck_rows
    from ..noise.lost import find_lost, without_lost
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
    course = driven(recording)
    drive = course.values
    # drop-outs are a fault of laser sensors; a force that leaps for a sample may be real
    if channel == "displacement":
        off_target = find_lost(y, drive, resolution=sensor.resolution)
        y = without_lost(y, off_target)
        single = find_dropouts(y, drive, resolution=sensor.resolution)
        dropouts = computed(np.logical_or, off_target, single, dtype=np.bool_)
    else:
        dropouts = beside(y, np.bool_)
    observed = computed(lambda a, out: np.isfinite(a) & ~out, y, dropouts, dtype=np.bool_)
    if course.unknown is not None:
        observed = computed(lambda seen, out: seen & ~out, observed, course.unknown, dtype=np.bool_)
    if recording.is_voltage and begins_under_voltage(drive):
        observed[0] = False
    if np.count_nonzero(observed) < 20:
        lost = 0 if course.unknown is None else int(np.count_nonzero(course.unknown))
        why = f", and in {lost} rows what drives the actuator is not known; fill it in where it is" if lost else ""
        raise InputError(
            f"{recording.name}: only {np.count_nonzero(observed)} samples of {recording.output} were observed; "
            f"a recording needs at least 20{why}"
        )
    clean = computed(lambda a, seen: np.where(seen, a, np.nan), y, observed)
    mains = find_mains(clean, recording.time_s, drive)
    unseen = computed(np.logical_not, observed, dtype=np.bool_)
    quiet = quiet_noise(y, drive, recording.time_s, mask=unseen, lines_Hz=_lines_Hz(mains))
    held = 0
    if channel == "displacement":
        stuck = beside(y, np.bool_)
        read = with_a_reading(clean)
        stuck[read] = stuck_rows(clean[read], quiet.sd, rho=quiet.rho, resolution=sensor.resolution)
        held = int(np.count_nonzero(stuck))
        observed = computed(lambda seen, out: seen & ~out, observed, stuck, dtype=np.bool_) if held else observed
    masked = int(np.count_nonzero(dropouts))
    return Prepared(recording, channel, sensor, y, observed, masked, mains, quiet.sd, quiet.rho, quiet.n, held)


def _mark_short_gaps(out: NDArray[np.bool_], y: NDArray[np.float64]) -> None:
    """Set out (n,) where a few readings of y (n,) are missing between others.

    A block that ended at each of them would begin with single readings behind it: 1 % missing made hundreds of times as
    many blocks of a creep. Where many are missing, blocks of correlated noise would be less certain than they are.
    """
    turns = rows_where(lambda a, b: np.isfinite(a) != np.isfinite(b), y[1:], y[:-1]) + 1
    first = turns[int(y.size > 0 and not np.isfinite(y[0])) :]  # a gap that the recording begins with ends there
    gaps = [(a, b) for a, b in zip(first[::2], first[1::2], strict=False) if b - a <= _SHORT_GAP]
    if sum(b - a for a, b in gaps) > _RARE * y.size:
        return
    for a, b in gaps:
        out[a:b] = True


def begins_under_voltage(drive: NDArray[np.float64]) -> bool:
    """Whether a voltage (n,) [V] is on from the first row: above a hundredth of its largest.

    An actuator that was at rest before it was read just before the voltage acted or just after: no convention says
    which, and a step that one reading lacks is tens of its noise: a mode or a lag would be bent to explain it.
    """
    return bool(abs(drive[0]) > _AT_NOTHING * max(abs(float(np.max(drive))), abs(float(np.min(drive)))))


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
    return _with_site_lines(out)


def _with_site_lines(prepared: list[Prepared]) -> tuple[Prepared, ...]:
    """Recordings of the displacement with the mains lines of their place; other sensors as they are."""
    from ..noise.quiet import quiet_noise
    from ..noise.site_frequency import in_this_recording
    from ..noise.site_lines import frequencies, site_lines

    own = [i for i, p in enumerate(prepared) if p.channel == "displacement"]
    found = [prepared[i].mains for i in own]
    lines = site_lines(found, [0.5 / prepared[i].reading_step_s for i in own])
    for i, mains in zip(own, lines, strict=True):
        p = prepared[i]
        if mains is not None and mains is not p.mains:
            clean = computed(lambda a, seen: np.where(seen, a, np.nan), p.y, p.observed)
            drive = drive_values(p.recording)
            known = p.mains.lines if p.mains is not None else ()
            read = p.recording.time_s, clean, drive
            mains = mains.with_lines(
                line if line in known else in_this_recording(line, frequencies(found, mains.base_Hz, line), *read)
                for line in mains.lines
            )
            unseen = computed(np.logical_not, p.observed, dtype=np.bool_)
            quiet = quiet_noise(p.y, drive, p.recording.time_s, mask=unseen, lines_Hz=_lines_Hz(mains))
            prepared[i] = replace(p, mains=mains, quiet_sd=quiet.sd, quiet_rho=quiet.rho, quiet_n=quiet.n)
    return tuple(prepared)


def _lines_Hz(mains: Mains | None) -> list[float]:
    """Frequencies of its lines: what they add is no noise."""
    return [line.frequency_Hz for line in mains.lines] if mains is not None else []


@dataclass(frozen=True)
class RateClasses:
    """Steps between readings of one sensor: each has a noise correlation of its own, stated per step.

    Whether a sensor's noise is correlated in time (a filter) or from sample to sample (processing) is not known;
    recordings at one rate share a rho, those at another rate have another.
    """

    steps_s: tuple[float, ...]

    def of(self, prepared: Prepared) -> int:
        """Index of the class of a recording."""
        return int(np.argmin([abs(np.log(prepared.reading_step_s / s)) for s in self.steps_s]))


def rate_classes(prepared: tuple[Prepared, ...], tolerance: float = 0.2) -> RateClasses:
    """Classes of steps between readings that differ by more than `tolerance` (in the logarithm), finest first."""
    steps: list[float] = []
    for step in sorted(p.reading_step_s for p in prepared):
        if not steps or abs(np.log(step / steps[-1])) > tolerance:
            steps.append(step)
    return RateClasses(tuple(steps))

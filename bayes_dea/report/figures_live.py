"""Pictures of a live run: the course of the parameters, and the samples, over one time axis for all sessions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import digits, style
from .data import ResultData
from .style import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

NONE: Array = np.empty(0)
_COLUMNS = 2
#: samples that are drawn: read one by one from files that may hold days
_POINTS = 1500
_LONGEST = 200
_Z90 = 1.645
#: a band that spans more than this factor is drawn on a logarithmic axis
_WIDE = 6.0
#: the first updates, which know little, may leave the picture
_EARLY = 0.1


@dataclass(frozen=True)
class Course:
    """One time axis (s since the first sample) for all sessions. shift_s: what to add to a session's device time;
    begins_s: of each session after the first; rows (n, 3): some of the samples, in order of time; alarms_s (a,)."""

    shift_s: Mapping[int, float]
    begins_s: tuple[float, ...]
    length_s: float
    rows: Array = field(repr=False)
    alarms_s: Array = field(repr=False)

    @classmethod
    def of(cls, s: Mapping[str, Any], folder: Path) -> Course:
        """From live.json and the sessions' files beside it, as far as they are there."""
        shift: dict[int, float] = {}
        begins, parts = [], []
        at = length = 0.0
        for number, session in enumerate(s["sessions"], start=1):
            rows = some_rows(folder / str(session["file"]))
            times = [u["time_s"] for u in s["updates"] if u["session"] == number]
            t = rows[:, 0] if len(rows) else np.array(times)
            if not t.size:
                continue
            if shift:
                at += float(session.get("elapsed_s") or 0.0)
                begins.append(at)
            shift[number] = at - float(t[0])
            at = float(t[-1]) + shift[number]
            length += float(t[-1] - t[0])
            parts.append(rows + np.array([shift[number], 0.0, 0.0]))
        alarms = [a["time_s"] + shift[a["session"]] for a in s["alarms"] if a.get("session") in shift]
        return cls(shift, tuple(begins), length, np.concatenate(parts) if parts else np.empty((0, 3)),
                   np.array(alarms))


def some_rows(path: Path, most: int = _POINTS) -> Array:
    """Rows (n, 3) of a session's file, first and last among them: all, or about `most` at even distances in it."""
    if not path.is_file():
        return np.empty((0, 3))
    size = path.stat().st_size
    out = []
    with path.open("rb") as file:
        file.readline()  # the header
        body = file.tell()
        if size <= body:
            return np.empty((0, 3))
        every = size - body > 40 * most
        while not every and (line := file.readline()):
            out.append(line)
        for place in np.linspace(body, max(body, size - _LONGEST), most if every else 0).astype(np.int64):
            file.seek(int(place))
            if place > body:
                file.readline()  # into the middle of a line
            out.append(file.readline())
        if every:
            out.append(file.read().rstrip(b"\n").rpartition(b"\n")[2])
    rows = [r for line in out if (r := _numbers(line)) is not None]
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return table[np.concatenate([[True], np.diff(table[:, 0]) > 0])] if len(table) else table


def _numbers(line: bytes) -> list[float] | None:
    try:
        row = [float(x) for x in line.split(b",")]
    except ValueError:
        return None
    return row if len(row) == 3 else None


def band_of(mean: Array, sd: Array, positive: bool) -> tuple[Array, Array, Array]:
    """Middle and 90 % band (n,) of what mean and sd (n,) say: log-normal where `positive`, else normal."""
    if not positive:
        return mean, mean - _Z90 * sd, mean + _Z90 * sd
    s = np.sqrt(np.log1p((sd / mean) ** 2))
    middle = mean * np.exp(-(s**2) / 2)
    return middle, middle * np.exp(-_Z90 * s), middle * np.exp(_Z90 * s)


def course_picture(s: Mapping[str, Any], course: Course, data: ResultData) -> Picture | None:
    """Every quantity over time with its band, and the evidence a sample; None where nothing was learned."""
    updates = [u for u in s["updates"] if u["session"] in course.shift_s and u["parameters"]]
    names = list(updates[-1]["parameters"]) if len(updates) > 1 else []
    if not names:
        return None
    t = np.array([u["time_s"] + course.shift_s[u["session"]] for u in updates])
    panels = -(-(len(names) + 1) // _COLUMNS)
    figure = style.new_figure(0.75 + 1.45 * panels, 8.4)
    axes = figure.subplots(panels, _COLUMNS, sharex=True, squeeze=False).ravel()
    for ax, name in zip(axes, names, strict=False):
        _quantity(ax, data, name, t, updates)
        _marks(ax, course)
    ax = axes[len(names)]
    count = np.diff([u["samples"] for u in updates])
    gained = np.array([u["incremental_log_evidence"] or math.nan for u in updates[1:]], dtype=float)
    ax.plot(t[1:], gained / np.where(count > 0, count, np.nan), color=style.BLUE, linewidth=1.0)
    ax.set_title("log evidence a sample", loc="left")
    _marks(ax, course)
    for empty in axes[len(names) + 1 :]:
        empty.set_axis_off()
    for each in axes[max(0, len(names) + 1 - _COLUMNS) : len(names) + 1]:
        each.set_xlabel("time since the first sample / s")
        each.tick_params(labelbottom=True)
    figure.tight_layout()
    return style.picture(
        figure,
        "What was known after each update: middle and 90 % band (log-normal where a quantity is positive, from mean "
        "and standard deviation). The dot with its bar at the right: median and 90 % interval of the final draws. "
        + _legend(course),
        "course of the parameters over time",
    )


def signal_picture(course: Course) -> Picture | None:
    """Displacement and voltage of the samples; None where there are none."""
    if len(course.rows) < 2:
        return None
    t, volts, y = course.rows.T
    figure = style.new_figure(3.6, 8.4)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    scale = digits.scale_for(float(np.nanmax(np.abs(y))) if np.isfinite(y).any() else None, "m")
    style.dots(top, t, y / scale.factor, 1.8)
    if np.isfinite(y).any():
        low, high = (float(f(y)) / scale.factor for f in (np.nanmin, np.nanmax))
        room = 0.05 * (high - low) or 1.0
        top.set_ylim(low - room, high + room)
    top.set_ylabel(f"displacement / {scale.unit}")
    style.dots(bottom, t, volts, 1.8)
    low, high = min(float(volts.min()), 0.0), max(float(volts.max()), 1.0)
    bottom.set_ylim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    bottom.set_ylabel("voltage / V")
    bottom.set_xlabel("time since the first sample / s")
    top.set_xlim(t[0], t[-1])
    for ax in (top, bottom):
        _marks(ax, course)
    figure.align_ylabels()
    figure.tight_layout()
    return style.picture(
        figure,
        f"What the device reported: {digits.fixed(len(t))} of the samples, at even distances. " + _legend(course),
        "displacement and voltage over time",
    )


def _legend(course: Course) -> str:
    out = "Vermilion lines: alarms." if course.alarms_s.size else "There was no alarm."
    return out + (" Dashed: a new clock of the device, after a reset or a new start." if course.begins_s else "")


def _marks(ax: Axes, course: Course) -> None:
    for at in course.begins_s:
        ax.axvline(at, color=style.GREY, linewidth=0.9, linestyle="--", zorder=0)
    for at in course.alarms_s[:100]:
        ax.axvline(at, color=style.VERMILLION, linewidth=0.9, zorder=0)


def _quantity(ax: Axes, data: ResultData, name: str, t: Array, updates: list[Any]) -> None:
    given = [u["parameters"].get(name) or {} for u in updates]
    mean, sd = (np.array([math.nan if g.get(k) is None else g[k] for g in given], dtype=float) for k in ("mean", "sd"))
    last = data.entry(name)
    ends = np.array([last.get(k) if digits.is_number(last.get(k)) else math.nan for k in ("q05", "q50", "q95")])
    ax.set_xlim(0.0, max(float(t[-1]) * 1.02, 1e-9))
    ax.set_title(name, loc="left")
    if not np.isfinite(mean + sd).any():
        return
    positive = bool(np.all(mean[np.isfinite(mean)] > 0)) and not ends[0] <= 0
    middle, low, high = band_of(mean, sd, positive)
    unit = data.unit(name) if last else "m" if name.endswith("_m") else "1"  # of noise, while the run lasts
    scale = digits.scale_for(float(abs(mean[np.isfinite(mean)][-1])), unit)
    middle, low, high, ends = middle / scale.factor, low / scale.factor, high / scale.factor, ends / scale.factor
    ax.fill_between(t, low, high, color=style.BAND_90, linewidth=0)
    ax.plot(t, middle, color=style.BLUE)
    if np.isfinite(ends).all():
        ax.errorbar(t[-1], ends[1], [[ends[1] - ends[0]], [ends[2] - ends[1]]], fmt="o", color=style.BLACK,
                    markersize=3.5, linewidth=1.2, clip_on=False)
    seen = slice(int(_EARLY * len(t)), None)
    bottom, top = float(np.nanmin([*low[seen], ends[0]])), float(np.nanmax([*high[seen], ends[2]]))
    if positive and top > _WIDE * bottom:
        ax.set_yscale("log")
        ticks = style.log_ticks(bottom / 1.2, top * 1.2, 4)
        ax.set_yticks(ticks, [style.tick_text(v) for v in ticks])
        ax.minorticks_off()
        ax.set_ylim(bottom / 1.2, top * 1.2)
    elif top > bottom:
        ax.set_ylim(bottom - 0.06 * (top - bottom), top + 0.06 * (top - bottom))
    if scale.unit:
        ax.set_title(f"{name} / {scale.unit}", loc="left")

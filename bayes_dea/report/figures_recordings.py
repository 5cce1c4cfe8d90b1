"""Pictures of one recording: measured against predicted with bands, and what is left over."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from . import digits, style, svg_sheet
from .data import RecordingData
from .style import Picture
from .svg_sheet import Key, Panel

Z50, Z90 = 0.6745, 1.6449  # half-widths of the central normal bands
_MOST_POINTS = 700  # in one panel: more than its pixels can show, and all that a page of twenty recordings can carry
_WIDTH, _HEIGHT = 643, 394  # px
_LEFT, _RIGHT = 66.0, 622.0
_KEYS = (
    Key("dot", style.BLACK, "measured"),
    Key("line", style.BLUE, "predicted"),
    Key("area", style.BAND_50, "50 % band"),
    Key("area", style.BAND_90, "90 % band"),
)


@dataclass(frozen=True)
class Detail:
    """What the right column of a recording's picture shows: time since `origin` (log), or a linear window."""

    low: float
    high: float
    origin: float = 0.0
    log: bool = False
    words: str = ""


def detail_of(time_s: NDArray, drive: NDArray) -> Detail:
    """A long hold at the end is shown over the logarithm of the time since its beginning, anything else enlarged."""
    t0, t1 = float(time_s[0]), float(time_s[-1])
    steps = np.diff(time_s)
    step = float(np.min(steps[steps > 0])) if np.any(steps > 0) else 1.0
    low, high = float(np.nanmin(drive)), float(np.nanmax(drive))
    if high > low:
        final = float(np.median(drive[time_s >= t1 - 0.1 * (t1 - t0)]))
        away = np.flatnonzero(np.abs(drive - final) > 0.05 * (high - low))
        if away.size and away[-1] + 1 < len(time_s):
            origin = float(time_s[away[-1] + 1]) - step
            if t1 - origin > 0.3 * (t1 - t0) and t1 - origin > 20 * step:
                return Detail(step, t1 - origin, origin, True, "time since the last edge (logarithmic)")
        above = drive > 0.5 * (low + high)
        rising = np.flatnonzero(above[1:] & ~above[:-1]) + 1
        if rising.size >= 3:
            period = float(np.median(np.diff(time_s[rising])))
            start = float(time_s[rising[-2]]) - 0.25 * period
            return Detail(start, min(start + 1.75 * period, t1), words="the last periods enlarged")
    return Detail(t1 - 0.15 * (t1 - t0), t1, words="the end enlarged")


def fit_picture(r: RecordingData) -> Picture:
    """Measured against predicted with 50 and 90 % bands, and the residuals in units of their own band."""
    detail = detail_of(r.time_s, r.input)
    scale = digits.scale_for(float(np.nanmax(np.abs(r.observed))), r.unit)
    observed, mean, sd = r.observed / scale.factor, r.mean / scale.factor, r.sd_sample / scale.factor
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (r.observed - r.mean) / r.sd_block
    limit = max(3.6, 1.08 * float(np.nanmax(np.abs(z))))
    gap = 52.0 if detail.log else 26.0
    wide = (_RIGHT - _LEFT - gap) / 2.25
    panels = []
    for column in (0, 1):
        inside, x = np.ones(len(r.time_s), bool), r.time_s
        limits = (float(x[0]), float(x[-1]))
        if column == 1:
            x = x - detail.origin
            limits = (detail.low, detail.high)
            inside = (x >= detail.low) & (x <= detail.high)
        shown = np.flatnonzero(inside)
        dots, curve = thinned_dots(shown, z), thinned_line(shown, mean)
        # the hold has its own range: creep is a small part of the stroke
        within = shown if detail.log and column else np.arange(len(x))
        y_limits = svg_sheet.limits_of((mean - 2.2 * sd)[within], (mean + 2.2 * sd)[within], observed[within])
        left, width = (_LEFT, 1.25 * wide) if column == 0 else (_LEFT + 1.25 * wide + gap, wide)
        log = detail.log and column == 1
        top = Panel(left, 34, width, 198, limits, y_limits, log_x=log)
        bottom = Panel(left, 246, width, 102, limits, (-limit, limit), log_x=log)
        for z_, color in ((Z90, style.BAND_90), (Z50, style.BAND_50)):
            top.band(x[curve], (mean - z_ * sd)[curve], (mean + z_ * sd)[curve], color)
            bottom.span(-z_, z_, color)
        top.line(x[curve], mean[curve], style.BLUE, 1.6)
        bottom.level(0.0, style.BLUE)
        top.dots(x[dots], observed[dots])
        bottom.dots(x[dots], z[dots])
        top.x_axis(labelled=False)
        bottom.x_axis("time since last edge / s" if log else "time / s")
        top.y_axis(f"{r.channel} / {scale.unit}" if column == 0 else "", labelled=column == 0 or detail.log)
        bottom.y_axis("residual / sd" if column == 0 else "", labelled=column == 0)
        panels += [top, bottom]
    inside_90 = float(np.mean(np.abs(z[np.isfinite(z)]) <= Z90))
    word = "fitted" if r.fitted else "never fitted"
    caption = (
        f"Measured (dots; {word}) and predicted (line with bands) over time; right: {detail.words}. Below, each "
        f"block's residual over the sd of its mean: {digits.percent(inside_90, 0)} % of the blocks lie in the "
        f"light band, where 90 % should; the largest departure is {largest_departure(r)}."
    )
    svg = svg_sheet.sheet(_WIDTH, _HEIGHT, panels, _KEYS)
    return style.picture_of(
        svg, _WIDTH, _HEIGHT, caption, f"{r.name}: measured against predicted over time, and residuals"
    )


def largest_departure(r: RecordingData) -> str:
    """The block farthest from its prediction in units of the sd of its mean, and how far chance takes it, in words."""
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (r.observed - r.mean) / r.sd_block
    worst, count = int(np.nanargmax(np.abs(z))), int(np.isfinite(z).sum())
    # the median of the farthest of so many independent normal numbers
    usual = -NormalDist().inv_cdf(-0.5 * math.expm1(math.log(0.5) / count))
    return (
        f"{digits.fixed(float(z[worst]), 1)} sd at {digits.significant(float(r.time_s[worst]), 3)} s (the farthest of "
        f"{digits.fixed(count)}; by chance alone it is about ±{digits.fixed(usual, 1)})"
    )


def thinned_dots(shown: NDArray, z: NDArray, most: int = _MOST_POINTS) -> NDArray:
    """Those of the blocks `shown` (indices) that are drawn: evenly spaced ones, and the five farthest out."""
    if len(shown) <= most:
        return shown
    even = shown[np.linspace(0, len(shown) - 1, most - 5).astype(int)]
    size = np.nan_to_num(np.abs(z[shown]))
    return np.union1d(even, shown[np.argsort(size)[-5:]])


def thinned_line(shown: NDArray, y: NDArray, most: int = _MOST_POINTS) -> NDArray:
    """Those of the blocks `shown` (indices) through which a line is drawn: lowest and highest of each stretch."""
    if len(shown) <= most:
        return shown
    pieces = np.array_split(shown, most // 2)
    ends = [i for p in pieces for i in (p[np.argmin(y[p])], p[np.argmax(y[p])])]
    return np.unique([shown[0], *ends, shown[-1]])


def residual_picture(r: RecordingData) -> Picture:
    """Residuals in units of noise sd by time and by input, their spectrum against white, and the PIT histogram."""
    word, unit = r.input_column
    drive = digits.scale_for(float(np.nanmax(np.abs(r.input))) or None, unit)
    places = [(x, y) for y in (26.0, 222.0) for x in (_LEFT, _LEFT + 318.0)]
    panels = [
        _binned(places[0], r.by_time, 1.0, "time / s", "over time"),
        _binned(places[1], r.by_input, drive.factor, f"{word} / {drive.unit}", f"by {word}", marks=True),
        _spectrum(places[2], r),
        _pit(places[3], r),
    ]
    caption = (
        f"Residuals of single samples in units of the noise sd. Means (dots, with two standard errors; 0 "
        f"expected) stay within {_largest_mean(r.by_time)} over time and {_largest_mean(r.by_input)} by {word}; "
        f"dashed: RMS, 1 expected. {_spectrum_words(r)} PIT: {_pit_words(r)}."
    )
    svg = svg_sheet.sheet(_WIDTH, _HEIGHT, panels)
    alt = f"{r.name}: residuals over time and by {word}, spectrum, PIT histogram"
    return style.picture_of(svg, _WIDTH, _HEIGHT, caption, alt)


def _small(place: tuple[float, float], x: tuple[float, float], y: tuple[float, float], log: bool = False) -> Panel:
    return Panel(*place, 238.0, 126.0, x, y, log_x=log, log_y=log)


def _binned(
    place: tuple[float, float],
    table: Mapping[str, NDArray],
    factor: float,
    label: str,
    title: str,
    marks: bool = False,
) -> Panel:
    edges, mean = table["edges"] / factor, table["mean"]
    rms, se, count = table["rms"], table["mean_se"], table["count"]
    centre = (edges[1:] + edges[:-1]) / 2
    good = (count >= 8) & np.isfinite(rms)  # fewer have no error bar worth the name
    largest = float(np.max(np.concatenate([(np.abs(mean) + 2 * se)[good], rms[good], [1.0]]))) if good.any() else 1.0
    smallest = float(np.min((mean - 2 * se)[good])) if good.any() else 0.0
    panel = _small(
        place, svg_sheet.limits_of(edges, pad=0.02), (min(-0.35, 1.15 * smallest), max(1.35, 1.15 * largest))
    )
    panel.level(0.0)
    panel.level(1.0, dash="1.5 2.5")
    panel.bars(centre[good], (mean - 2 * se)[good], (mean + 2 * se)[good], style.BLUE)
    panel.dots(centre[good], mean[good], 4.0, style.BLUE)
    panel.line(centre[good], rms[good], style.VERMILLION, 1.4, "5 3")
    if marks:
        panel.squares(centre[good], rms[good])
    panel.x_axis(label)
    panel.y_axis("residual / sd")
    panel.title(f"{title}: mean and RMS (dashed)")
    return panel


def _spectrum(place: tuple[float, float], r: RecordingData) -> Panel:
    f, density = r.spectrum.get("frequency_Hz", np.empty(0)), r.spectrum.get("density", np.empty(0))
    white = float(r.spectrum["white"][0]) if r.spectrum.get("white", np.empty(0)).size else float("nan")
    ratio = density / white if white > 0 else np.empty(0)
    positive = ratio[ratio > 0]
    if f.size < 2 or not positive.size:
        panel = _small(place, (0.0, 1.0), (0.0, 1.0))
        panel.x_axis("frequency / Hz", [])
        panel.y_axis("", [])
        panel.message("too few samples for a spectrum")
    else:
        low, high = max(min(0.3, 0.8 * float(positive.min())), 1e-6), max(3.0, 1.25 * float(positive.max()))
        panel = _small(place, (float(f[0]), float(f[-1])), (low, high), log=True)
        panel.level(1.0, dash="1.5 2.5")
        panel.line(f[ratio > 0], positive, style.BLUE, 1.4)
        panel.x_axis("frequency / Hz")
        panel.y_axis("ratio")
    panel.title("spectrum over that of white noise")
    return panel


def _pit(place: tuple[float, float], r: RecordingData) -> Panel:
    counts, p = r.pit_histogram, r.entry.get("pit_p_value")
    height = counts / counts.mean() if counts.sum() > 0 else np.empty(0)
    panel = _small(place, (0.0, 1.0), (0.0, max(1.5, 1.1 * float(height.max())) if height.size else 1.5))
    if height.size:
        panel.stairs(np.linspace(0, 1, height.size + 1), height, style.BAND_50, style.BLUE)
        panel.level(1.0, style.BLACK, 1.2, "1.5 2.5")
    panel.x_axis("predicted cumulative probability")
    panel.y_axis("density")
    panel.title("PIT histogram" + (f", p = {digits.significant(p, 2)}" if digits.is_number(p) else ""))
    return panel


def _largest_mean(table: Mapping[str, NDArray]) -> str:
    mean = np.abs(table["mean"][(table["count"] >= 8) & np.isfinite(table["mean"])])
    return f"±{digits.significant(float(mean.max()), 2)}" if mean.size else digits.MISSING


def _spectrum_words(r: RecordingData) -> str:
    density, white = r.spectrum.get("density", np.empty(0)), r.spectrum.get("white", np.empty(0))
    if density.size < 2 or not (white.size and white[0] > 0 and density.max() > 0):
        return "Spectrum: too few samples."
    top = int(np.argmax(density))
    return (
        f"Spectrum: at most {digits.significant(float(density[top] / white[0]), 2)} times that of white noise, at "
        f"{digits.quantity(float(r.spectrum['frequency_Hz'][top]), 'Hz', 2)}."
    )


def _pit_words(r: RecordingData) -> str:
    counts = r.pit_histogram
    if not counts.sum() > 0:
        return "no samples"
    height = counts / counts.mean()
    return (
        f"between {digits.fixed(float(height.min()), 2)} and {digits.fixed(float(height.max()), 2)}, 1 expected in "
        "every bin"
    )

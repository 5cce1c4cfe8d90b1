"""Pictures of one recording: measured against predicted with bands, and what is left over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import digits, style
from .data import RecordingData
from .style import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Z50, Z90 = 0.6745, 1.6449  # half-widths of the central normal bands
_MOST_POINTS = 700  # in one panel: more than its pixels can show, and all that a page of twenty recordings can carry


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
    figure = style.new_figure(4.1)
    grid = figure.add_gridspec(
        2,
        2,
        left=0.1,
        right=0.965,
        top=0.915,
        bottom=0.115,
        hspace=0.14,
        wspace=0.2 if detail.log else 0.13,
        width_ratios=(1.25, 1),
        height_ratios=(1.9, 1),
    )
    observed, mean, sd = r.observed / scale.factor, r.mean / scale.factor, r.sd_sample / scale.factor
    with np.errstate(divide="ignore", invalid="ignore"):
        z = (r.observed - r.mean) / r.sd_block
    limit = max(3.6, 1.08 * float(np.nanmax(np.abs(z))))
    for column in (0, 1):
        inside = np.ones(len(r.time_s), bool)
        x = r.time_s
        if column == 1:
            x = x - detail.origin
            inside = (x >= detail.low) & (x <= detail.high)
        top, bottom = figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])
        shown = np.flatnonzero(inside)
        chosen = thinned_dots(shown, z)
        _bands(top, x, mean, sd, thinned_line(shown, mean))
        style.dots(top, x[chosen], observed[chosen], 1.8)
        # the hold has its own range: creep is a small part of the stroke
        within = shown if detail.log else np.arange(len(x))
        low = min(np.nanmin((mean - 2.2 * sd)[within]), np.nanmin(observed[within]))
        high = max(np.nanmax((mean + 2.2 * sd)[within]), np.nanmax(observed[within]))
        top.set_ylim(low - 0.03 * (high - low), high + 0.03 * (high - low))
        bottom.axhspan(-Z90, Z90, color=style.BAND_90, lw=0)
        bottom.axhspan(-Z50, Z50, color=style.BAND_50, lw=0)
        bottom.axhline(0, color=style.BLUE, lw=0.8)
        style.dots(bottom, x[chosen], z[chosen], 1.8)
        bottom.set_ylim(-limit, limit)
        for ax in (top, bottom):
            if column == 1 and detail.log:
                style.set_log_x(ax, detail.low, detail.high)
            elif column == 1:
                ax.set_xlim(detail.low, detail.high)
                ax.locator_params(axis="x", nbins=5)
            else:
                ax.set_xlim(float(x[0]), float(x[-1]))
        top.tick_params(labelbottom=False)
        bottom.set_xlabel("time since last edge / s" if column and detail.log else "time / s")
        if column == 1:
            top.tick_params(labelleft=detail.log)
            bottom.tick_params(labelleft=False)
        else:
            top.set_ylabel(f"{r.channel} / {scale.unit}")
            bottom.set_ylabel("residual / sd")
            figure.align_ylabels([top, bottom])
    _legend(figure)
    inside_90 = float(np.mean(np.abs(z[np.isfinite(z)]) <= Z90))
    worst = int(np.nanargmax(np.abs(z)))
    word = "fitted" if r.fitted else "never fitted"
    caption = (
        f"Measured (dots; {word}) and predicted (line with bands) over time; right: {detail.words}. Below, each "
        f"block's residual over the sd of its mean: {digits.percent(inside_90, 0)} % of the blocks lie in the "
        f"light band, where 90 % should; the largest departure is {digits.fixed(float(z[worst]), 1)} sd at "
        f"{digits.significant(float(r.time_s[worst]), 3)} s."
    )
    return style.picture(figure, caption, f"{r.name}: measured against predicted over time, and residuals")


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


def _bands(ax: Axes, x: NDArray, mean: NDArray, sd: NDArray, at: NDArray) -> None:
    x, mean, sd = x[at], mean[at], sd[at]
    ax.fill_between(x, mean - Z90 * sd, mean + Z90 * sd, color=style.BAND_90, lw=0)
    ax.fill_between(x, mean - Z50 * sd, mean + Z50 * sd, color=style.BAND_50, lw=0)
    ax.plot(x, mean, color=style.BLUE, lw=1.2, zorder=4)


def _legend(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=style.BLACK, marker="o", markersize=2.5, lw=0),
        Line2D([], [], color=style.BLUE),
        Patch(color=style.BAND_50),
        Patch(color=style.BAND_90),
    ]
    figure.legend(
        handles,
        ["measured", "predicted", "50 % band", "90 % band"],
        loc="upper left",
        ncols=4,
        bbox_to_anchor=(0.085, 1.005),
        borderaxespad=0.2,
        columnspacing=1.4,
    )


def residual_picture(r: RecordingData) -> Picture:
    """Residuals in units of noise sd by time and by input, their spectrum against white, and the PIT histogram."""
    figure = style.new_figure(4.1)
    grid = figure.add_gridspec(2, 2, left=0.1, right=0.965, top=0.93, bottom=0.115, hspace=0.5, wspace=0.28)
    word, unit = r.input_column
    drive = digits.scale_for(float(np.nanmax(np.abs(r.input))) or None, unit)
    _binned(figure.add_subplot(grid[0, 0]), r.by_time, 1.0, "time / s", "over time")
    _binned(
        figure.add_subplot(grid[0, 1]), r.by_input, drive.factor, f"{word} / {drive.unit}", f"by {word}", marks=True
    )
    _spectrum(figure.add_subplot(grid[1, 0]), r)
    _pit(figure.add_subplot(grid[1, 1]), r)
    caption = (
        f"Residuals of single samples in units of the noise sd. Means (dots, with two standard errors; 0 "
        f"expected) stay within {_largest_mean(r.by_time)} over time and {_largest_mean(r.by_input)} by {word}; "
        f"dashed: RMS, 1 expected. {_spectrum_words(r)} PIT: {_pit_words(r)}."
    )
    return style.picture(figure, caption, f"{r.name}: residuals over time and by {word}, spectrum, PIT histogram")


def _binned(
    ax: Axes, table: Mapping[str, NDArray], factor: float, xlabel: str, title: str, marks: bool = False
) -> None:
    edges, mean = table["edges"] / factor, table["mean"]
    rms, se, count = table["rms"], table["mean_se"], table["count"]
    centre = (edges[1:] + edges[:-1]) / 2
    good = (count >= 8) & np.isfinite(rms)  # fewer have no error bar worth the name
    ax.axhline(0, color=style.GREY, lw=0.8)
    ax.axhline(1, color=style.GREY, lw=0.8, ls=":")
    ax.vlines(centre[good], (mean - 2 * se)[good], (mean + 2 * se)[good], color=style.BLUE, lw=1.0)
    style.dots(ax, centre[good], mean[good], 3.0, style.BLUE)
    if marks:
        ax.plot(
            centre[good], rms[good], color=style.VERMILLION, ls="--", lw=0.9, marker="s", ms=3, mfc="white", mew=0.9
        )
    else:
        ax.plot(centre[good], rms[good], color=style.VERMILLION, ls="--", lw=1.1)
    largest = float(np.max(np.concatenate([(np.abs(mean) + 2 * se)[good], rms[good], [1.0]]))) if good.any() else 1.0
    smallest = float(np.min((mean - 2 * se)[good])) if good.any() else 0.0
    ax.set_ylim(min(-0.35, 1.15 * smallest), max(1.35, 1.15 * largest))
    if np.isfinite(edges).all():
        pad = 0.02 * float(edges[-1] - edges[0])
        ax.set_xlim(edges[0] - pad, edges[-1] + pad)
    ax.set_xlabel(xlabel, labelpad=2)
    ax.set_ylabel("residual / sd")
    ax.set_title(f"{title}: mean and RMS (dashed)", loc="left")


def _spectrum(ax: Axes, r: RecordingData) -> None:
    f, density = r.spectrum.get("frequency_Hz", np.empty(0)), r.spectrum.get("density", np.empty(0))
    white = float(r.spectrum["white"][0]) if r.spectrum.get("white", np.empty(0)).size else float("nan")
    ax.set_title("spectrum over that of white noise", loc="left")
    ax.set_xlabel("frequency / Hz", labelpad=2)
    if f.size < 2 or not white > 0:
        ax.text(0.5, 0.5, "too few samples for a spectrum", ha="center", transform=ax.transAxes)
        ax.set_xticks([])
        ax.set_yticks([])
        return
    ratio = density / white
    style.set_log_x(ax, float(f[0]), float(f[-1]), 6)
    ax.set_yscale("log")
    ax.axhline(1, color=style.GREY, lw=0.9, ls=":")
    ax.plot(f, ratio, color=style.BLUE, lw=1.1)
    positive = ratio[ratio > 0]
    low, high = min(0.3, 0.8 * float(positive.min())), max(3.0, 1.25 * float(positive.max()))
    ax.set_ylim(max(low, 1e-6), high)
    ticks = style.log_ticks(max(low, 1e-6), high, 4)
    ax.set_yticks(ticks, [style.tick_text(t) for t in ticks])
    ax.minorticks_off()
    ax.set_ylabel("ratio")


def _pit(ax: Axes, r: RecordingData) -> None:
    counts = r.pit_histogram
    p = r.entry.get("pit_p_value")
    ax.set_title("PIT histogram" + (f", p = {digits.significant(p, 2)}" if digits.is_number(p) else ""), loc="left")
    ax.set_xlabel("predicted cumulative probability", labelpad=2)
    ax.set_ylabel("density")
    ax.set_xlim(0, 1)
    if not counts.sum() > 0:
        return
    height = counts / counts.mean()
    ax.stairs(height, np.linspace(0, 1, len(counts) + 1), fill=True, color=style.BAND_50)
    ax.stairs(height, np.linspace(0, 1, len(counts) + 1), color=style.BLUE, lw=0.9)
    ax.axhline(1, color=style.BLACK, lw=0.9, ls=":")
    ax.set_ylim(0, max(1.5, 1.1 * float(height.max())))


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

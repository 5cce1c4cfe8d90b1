"""Pictures of parameters: prior against posterior, pairs, traces and ranks, prior predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import digits, style
from .data import ResultData
from .style import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_CORNER_MOST = 13
_MOST = 30  # quantities in one picture


def _axis(data: ResultData, name: str) -> tuple[str, digits.Scale]:
    q05, q50, q95 = (float(q) for q in np.quantile(data.posterior[name], [0.05, 0.5, 0.95]))
    scale = digits.scale_of(q05, q50, q95, data.unit(name))
    symbol = data.plain(name)
    return (f"{symbol} / {scale.unit}" if scale.unit else symbol), scale


def _varying(data: ResultData, names: Sequence[str]) -> list[str]:
    return [n for n in names if n in data.posterior and np.ptp(data.posterior[n]) > 0]


def density_picture(data: ResultData, columns: int = 3) -> Picture | None:
    """Prior and posterior density of every quantity that has both; None when there is none."""
    names = [n for n in _varying(data, list(data.posterior)) if (p := data.prior_of(n)) is not None and np.ptp(p) > 0]
    names = names[:_MOST]
    if not names:
        return None
    rows = -(-len(names) // columns)
    height = 1.4 * rows + 0.1
    figure = style.new_figure(height)
    grid = figure.add_gridspec(
        rows, columns, left=0.03, right=0.965, top=1 - 0.25 / height, bottom=0.52 / height, hspace=1.15, wspace=0.16
    )
    for i, name in enumerate(names):
        ax = figure.add_subplot(grid[i // columns, i % columns])
        label, scale = _axis(data, name)
        before_draws = data.prior_of(name)
        assert before_draws is not None
        prior, draws = before_draws / scale.factor, data.posterior[name].ravel() / scale.factor
        log = bool(np.all(prior > 0) and np.all(draws > 0) and np.quantile(prior, 0.99) > 5 * np.quantile(prior, 0.01))
        a, b = (np.log10(prior), np.log10(draws)) if log else (prior, draws)
        low = min(np.quantile(a, 0.005), np.quantile(b, 0.001))
        high = max(np.quantile(a, 0.995), np.quantile(b, 0.999))
        coarse, fine = (
            np.linspace(low, high, 200),
            np.linspace(b.min() - 0.1 * np.ptp(b), b.max() + 0.1 * np.ptp(b), 140),
        )
        before, after = style.smooth_density(a, coarse, 1.3, mirror=True), style.smooth_density(b, fine, 1.2)
        x_before, x_after = (10.0**coarse, 10.0**fine) if log else (coarse, fine)
        ax.fill_between(x_before, before, color=style.PRIOR_AREA, lw=0)
        ax.plot(x_before, before, color=style.PRIOR, ls="--", lw=1.1)
        ax.fill_between(x_after, after, color=style.BLUE, alpha=0.35, lw=0)
        ax.plot(x_after, after, color=style.BLUE, lw=1.2)
        if log:
            style.set_log_x(ax, 10.0**low, 10.0**high, 4)
        else:
            ax.set_xlim(low, high)
            ax.locator_params(axis="x", nbins=4)
        ax.set_ylim(0, 1.06)
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
        ax.set_title(label, loc="left", pad=3)
        narrower = np.std(a) / np.std(b) if np.std(b) > 0 else float("nan")
        if np.isfinite(narrower):
            words = f"{digits.significant(narrower, 2)} × narrower" if narrower >= 1.15 else "as wide as the prior"
            ax.set_xlabel(words, loc="right", labelpad=1, color="#555555", fontsize=8)
    caption = (
        "Prior (dashed, filled) and posterior (blue) of every parameter, each drawn to the same height. A blue "
        "needle in a wide prior: the recordings speak. Blue as wide as the prior: they say nothing, and what "
        "you read off is the prior. The number is how many times narrower the posterior is."
    )
    return style.picture(figure, caption, "Prior and posterior densities of all parameters")


def corner_picture(data: ResultData) -> Picture | None:
    """Pairs of material parameters: 50 and 90 % regions; None for fewer than two."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    names = _varying(data, list(data.summary["parameters"]))[:_CORNER_MOST]
    n = len(names)
    if n < 2:
        return None
    side = 8.4
    figure = style.new_figure(side, side)
    # one pair of axes for all panels: n(n + 1)/2 of them would take longer than the rest of the page
    ax = figure.add_axes((0.12, 0.115, 0.875, 0.88))
    ax.set_axis_off()
    gap, bins = 0.06, 48
    draws, spans, labels = [], [], []
    for name in names:
        label, scale = _axis(data, name)
        v = data.posterior[name].ravel() / scale.factor
        span = _Span.of(v)
        draws.append(span.place(v))
        spans.append(span)
        labels.append(label)
    font = 9.0 if n <= 8 else 7.5
    segments, size = [], 1 - gap
    for row in range(n):
        for column in range(row + 1):
            x0, y0 = float(column), float(n - 1 - row)
            ax.add_patch(Rectangle((x0, y0), size, size, fill=False, ec="#bbbbbb", lw=0.6))
            for value in spans[column].ticks():
                x = x0 + size * spans[column].place(value)
                segments.append([(x, y0), (x, y0 + 0.03)])
            if row != column:
                for value in spans[row].ticks():
                    y = y0 + size * spans[row].place(value)
                    segments.append([(x0, y), (x0 + 0.03, y)])
                _region(ax, draws[column], draws[row], x0, y0, size, bins)
            else:
                centre = np.linspace(0, 1, 80)
                density = style.smooth_density(draws[row], centre, 1.2)
                xs, ys = x0 + size * centre, y0 + 0.9 * size * density
                ax.fill_between(xs, y0, ys, color=style.BAND_50, lw=0)
                ax.plot(xs, ys, color=style.BLUE, lw=1.1)
    for row in range(n):
        for column in range(row + 1, n):
            r = float(np.corrcoef(draws[row], draws[column])[0, 1])
            # the mirror image of each panel holds its correlation, heavier where it is stronger
            ax.text(
                column + size / 2,
                n - 1 - row + size / 2,
                f"{r:+.2f}".replace("-", "−"),
                ha="center",
                va="center",
                fontsize=font + 1,
                color=style.BLACK if abs(r) > 0.5 else style.GREY,
                fontweight="bold" if abs(r) > 0.8 else "normal",
            )
    ax.add_collection(LineCollection(segments, colors="#555555", linewidths=0.6))
    for i, name in enumerate(names):
        ticks = spans[i].ticks()
        for value, text in zip(ticks, _tick_texts(ticks), strict=True):
            at = size * spans[i].place(value)
            ax.text(i + at, -0.008 * n, text, ha="right", va="top", fontsize=font, rotation=40, rotation_mode="anchor")
            if i > 0:
                ax.text(-0.008 * n, n - 1 - i + at, text, ha="right", va="center", fontsize=font)
        ax.text(i + size / 2, -0.085 * n, labels[i], ha="center", va="top", fontsize=font + 1)
        if i > 0:
            ax.text(
                -0.105 * n, n - 1 - i + size / 2, labels[i], ha="center", va="center", rotation=90, fontsize=font + 1
            )
        best = data.entry(name).get("map")
        if digits.is_number(best):
            _mark_map(ax, data, names, spans, i, size, n)
    ax.set_xlim(-0.02, n)
    ax.set_ylim(-0.02, n)
    cut = "" if n == len(data.summary["parameters"]) else f" The first {n} parameters are shown."
    caption = (
        "Pairs of material parameters: the dark region holds 50 % of the posterior, the light one 90 %; the "
        "cross is the MAP; the mirror image gives the correlation. Long thin regions mean that the recordings "
        "fix a combination better than either parameter." + cut
    )
    return style.picture(figure, caption, "Corner plot of the material parameters")


@dataclass(frozen=True)
class _Span:
    """Axis of one parameter, from 0 to 1; logarithmic where the posterior spans a factor of six."""

    low: float
    high: float
    log: bool

    @classmethod
    def of(cls, v: NDArray) -> _Span:
        q05, q95 = np.quantile(v, [0.05, 0.95])
        log = bool(v.min() > 0 and q95 > 6 * q05)
        low, high = np.quantile(np.log10(v) if log else v, [0.001, 0.999])
        pad = 0.08 * (high - low)
        return cls(float(low - pad), float(high + pad), log)

    def place(self, value: Any) -> Any:
        return ((np.log10(value) if self.log else value) - self.low) / (self.high - self.low)

    def ticks(self) -> NDArray[np.float64]:
        """Two round values well inside."""
        if not self.log:
            return _inner_ticks(self.low, self.high)
        pad = 0.14 * (self.high - self.low)
        inside = style.log_ticks(10.0 ** (self.low + pad), 10.0 ** (self.high - pad), 9)
        return np.array([inside[0], inside[-1]])


def _inner_ticks(low: float, high: float) -> NDArray[np.float64]:
    """Two round values well inside the limits."""
    span = high - low
    for step in sorted({m * 10.0**e for e in range(-15, 16) for m in (1, 2, 2.5, 5)}, reverse=True):
        if step > span:
            continue
        values = step * np.arange(np.ceil((low + 0.14 * span) / step), np.floor((high - 0.14 * span) / step) + 1)
        if len(values) >= 2:
            return np.array([values[0], values[-1]])
    return np.array([low + 0.2 * span, high - 0.2 * span])


def _tick_texts(values: NDArray) -> list[str]:
    decimals = digits.decimals_for(min(float(np.ptp(values)), float(np.abs(values).min()) or np.inf), 1)
    for more in range(4):
        texts = [digits.fixed(float(v), decimals + more) for v in values]
        if all(abs(round(float(v), decimals + more) - v) < 0.02 * np.ptp(values) for v in values):
            return texts
    return texts


def _region(ax: Axes, x: NDArray, y: NDArray, x0: float, y0: float, size: float, bins: int) -> None:
    from scipy.ndimage import gaussian_filter

    counts = np.histogram2d(x, y, bins, ((0, 1), (0, 1)))[0]
    density = gaussian_filter(counts, 1.6, mode="constant")
    ordered = np.sort(density.ravel())[::-1]
    mass = np.cumsum(ordered) / ordered.sum()
    inner, outer = (float(ordered[np.searchsorted(mass, level)]) for level in (0.5, 0.9))
    if not density.max() > inner > outer > 0:
        return
    centre = size * (np.arange(bins) + 0.5) / bins
    ax.contourf(
        x0 + centre,
        y0 + centre,
        density.T,
        levels=[outer, inner, density.max() * 1.01],
        colors=[style.BAND_90, style.BAND_50],
    )
    ax.contour(
        x0 + centre,
        y0 + centre,
        density.T,
        levels=[outer, inner],
        colors=[style.BLUE],
        linewidths=0.7,
    )


def _mark_map(ax: Axes, data: ResultData, names: list[str], spans: list[_Span], i: int, size: float, n: int) -> None:
    at = []
    for name, span in zip(names, spans, strict=True):
        best = data.entry(name).get("map")
        scale = _axis(data, name)[1]
        at.append(float(span.place(best / scale.factor)) if digits.is_number(best) else float("nan"))
    xs = [c + size * at[c] for c in range(i)]
    ys = [n - 1 - i + size * at[i]] * i
    inside = [k for k in range(i) if 0 <= at[k] <= 1 and 0 <= at[i] <= 1]
    ax.plot(
        [xs[k] for k in inside],
        [ys[k] for k in inside],
        ls="",
        marker="+",
        ms=7,
        mew=1.1,
        color=style.VERMILLION,
        zorder=5,
    )


def trace_picture(data: ResultData) -> Picture | None:
    """Draws in the order in which they were made, by ensemble, of every quantity that was sampled."""
    names = _sampled(data)
    if not names:
        return None
    height = 0.5 * len(names) + 0.75
    figure = style.new_figure(height)
    grid = figure.add_gridspec(
        len(names), 1, left=0.2, right=0.965, top=1 - 0.3 / height, bottom=0.42 / height, hspace=0.22
    )
    for i, name in enumerate(names):
        ax = figure.add_subplot(grid[i, 0])
        values = data.lp if name == "lp" else data.posterior[name]
        thin = max(1, values.shape[1] // 400)
        x = np.arange(values.shape[1])[::thin]
        for chain, (color, line) in zip(values, _styles(len(values)), strict=True):
            ax.plot(x, chain[::thin], color=color, ls=line, lw=0.55, alpha=0.85)
        ax.set_xlim(0, values.shape[1])
        ax.set_yticks([])
        ax.tick_params(labelbottom=i == len(names) - 1)
        text = "log posterior" if name == "lp" else data.plain(name)
        ax.set_ylabel(text, rotation=0, ha="right", va="center", fontsize=9)
        if i == len(names) - 1:
            ax.set_xlabel("draw")
    _chain_legend(figure, data.posterior[names[0]].shape[0])
    caption = (
        "Draws in the order in which they were made, one line an ensemble. They should look like the same grass "
        "everywhere: no drift, no stretch in which one ensemble stays away from the other."
    )
    return style.picture(figure, caption, "Traces of the sampled quantities by ensemble")


def rank_picture(data: ResultData, columns: int = 3, bins: int = 20) -> Picture | None:
    """Rank histograms by ensemble of every quantity that was sampled."""
    names = _sampled(data)
    if not names or data.posterior[names[0]].shape[0] < 2:
        return None
    rows = -(-len(names) // columns)
    height = 1.1 * rows + 0.75
    figure = style.new_figure(height)
    grid = figure.add_gridspec(
        rows, columns, left=0.02, right=0.98, top=1 - 0.52 / height, bottom=0.42 / height, hspace=0.55, wspace=0.1
    )
    for i, name in enumerate(names):
        ax = figure.add_subplot(grid[i // columns, i % columns])
        values = data.lp if name == "lp" else data.posterior[name]
        order = np.argsort(np.argsort(values.ravel(), kind="stable"), kind="stable").reshape(values.shape)
        expected = values.shape[1] / bins
        ess = data.entry(name).get("ess_bulk")
        # dependent draws scatter more than independent ones
        inflation = max(1.0, values.size / ess) if data.converged and digits.is_number(ess) and ess > 0 else 1.0
        spread = 2 * np.sqrt(inflation / expected * (1 - 1 / bins))
        ax.axhspan(1 - spread, 1 + spread, color="#e8e8e8", lw=0)
        ax.axhline(1, color=style.GREY, lw=0.7, ls=":")
        reach = 1.6 * spread
        for chain, (color, line) in zip(order, _styles(len(order)), strict=True):
            counts = np.histogram(chain, bins, (0, values.size))[0] / expected
            reach = max(reach, 1.1 * float(np.max(np.abs(counts - 1))))
            ax.stairs(counts, np.linspace(0, 1, bins + 1), color=color, ls=line, lw=1.1, baseline=None)
        ax.set_ylim(1 - reach, 1 + reach)
        ax.set_xlim(0, 1)
        ax.set_yticks([])
        ax.set_xticks([0.25, 0.5, 0.75] if i + columns >= len(names) else [])
        ax.set_title("log posterior" if name == "lp" else data.plain(name), loc="left", pad=3)
        if i + columns >= len(names):
            ax.set_xlabel("rank among all draws", labelpad=2)
    _chain_legend(figure, data.posterior[names[0]].shape[0])
    caption = (
        "Where each ensemble's draws rank among all draws. Both lines should wander about 1 inside the grey "
        "band; a slope or a hump says that one ensemble has been elsewhere."
    )
    return style.picture(figure, caption, "Rank histograms of the sampled quantities by ensemble")


def _sampled(data: ResultData) -> list[str]:
    # gains are drawn afterwards, independently: their traces say nothing about the sampler
    names = [n for n in _varying(data, list(data.posterior)) if not n.startswith("gain_")]
    if len(names) > _MOST:  # the ones most in doubt
        doubt = sorted(names, key=lambda n: -(data.entry(n).get("rhat") or 0.0))[:_MOST]
        names = [n for n in names if n in doubt]
    return [*names, "lp"] if data.lp.ndim == 2 and data.lp.size and np.isfinite(data.lp).all() else names


def _styles(count: int) -> list[tuple[str, Any]]:
    return [style.CHAIN_STYLES[i % len(style.CHAIN_STYLES)] for i in range(count)]


def _chain_legend(figure: Figure, chains: int) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], color=color, ls=line, lw=1.3) for color, line in _styles(chains)]
    figure.legend(
        handles,
        [f"ensemble {i + 1}" for i in range(chains)],
        loc="upper right",
        ncols=min(chains, 4),
        bbox_to_anchor=(0.985, 1.0),
        borderaxespad=0.15,
    )


def prior_predictive_picture(data: ResultData) -> Picture | None:
    """Largest output of each recording that draws from the prior predict, beside the largest measured one."""
    shown = [r for r in data.recordings if r.prior_largest.size >= 3 and np.any(r.prior_largest > 0)]
    if not shown:
        return None
    height = 0.62 * len(shown) + 0.75
    figure = style.new_figure(height)
    grid = figure.add_gridspec(
        len(shown), 1, left=0.26, right=0.97, top=1 - 0.32 / height, bottom=0.12 / height + 0.1, hspace=1.1
    )
    for i, r in enumerate(shown):
        ax = figure.add_subplot(grid[i, 0])
        peaks = r.prior_largest[r.prior_largest > 0]
        measured = float(np.nanmax(np.abs(r.observed)))
        scale = digits.scale_for(measured, r.unit)
        low, high = min(peaks.min(), measured) / 1.6 / scale.factor, max(peaks.max(), measured) * 1.6 / scale.factor
        interval = np.quantile(peaks, [0.05, 0.95]) / scale.factor
        ax.hlines(0, *interval, color="#f0c878", lw=7, zorder=1)
        ax.vlines(peaks / scale.factor, -0.35, 0.35, color="#7a5200", lw=0.8, zorder=2)
        ax.plot([measured / scale.factor], [0], marker="D", ms=7, color=style.BLUE, mec="white", mew=0.8, zorder=3)
        style.set_log_x(ax, low, high, 6)
        ax.set_ylim(-0.6, 0.6)
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
        name = r.name if len(r.name) <= 24 else r.name[:22] + "…"
        ax.set_ylabel(f"{name}\n/ {scale.unit}", rotation=0, ha="right", va="center", fontsize=8.5)
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color="#7a5200", marker="|", ms=8, lw=0),
        Line2D([], [], color="#f0c878", lw=6),
        Line2D([], [], color=style.BLUE, marker="D", ms=6, lw=0),
    ]
    figure.legend(
        handles,
        ["draw from the prior", "90 % of them", "measured"],
        loc="upper right",
        ncols=3,
        bbox_to_anchor=(0.985, 1.0),
        borderaxespad=0.1,
    )
    caption = (
        "Largest output of a recording as draws from the prior predict it, before any recording was seen, and "
        "as measured. The diamond should lie among the ticks: if it does not, the prior or a unit is wrong; if "
        "the ticks span many powers of ten, the prior is vaguer than it need be."
    )
    return style.picture(figure, caption, "Prior predictions of the largest output beside the measured one")

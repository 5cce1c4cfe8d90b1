"""report.html of a prediction: what the actuator will do under a command, in three pictures and two tables."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import digits, style
from .own_page import write_page
from .style import Picture
from .templating import environment

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
#: points of a line: more than its pixels can show
_POINTS = 1200
_INPUTS = {"voltage_V": ("command", "V"), "position_m": ("position", "m")}


@dataclass(frozen=True)
class PredictionView:
    """What the page is drawn from: prediction.json and the columns of prediction.csv, arrays (n,)."""

    summary: Mapping[str, Any]
    columns: Mapping[str, Array] = field(repr=False)
    channel: str
    unit: str
    input: str

    def band(self, what: str, level: int) -> Array | None:
        """A quantile column of `what`: the channel itself, or "reading"."""
        return self.columns.get(f"{what}_q{level:02d}_{self.unit}")

    @property
    def time_s(self) -> Array:
        """Time (n,)."""
        return self.columns["time_s"]

    @property
    def mean(self) -> Array:
        """Mean answer (n,)."""
        return self.columns[f"{self.channel}_mean_{self.unit}"]

    @property
    def wanted(self) -> Array | None:
        """The stroke that was asked for."""
        return self.columns.get(f"wanted_{self.channel}_{self.unit}")


def write_prediction_page(path: Path, view: PredictionView, report: style.Report | None = None) -> Path:
    """Draw the page; the file is replaced whole or not at all. report: called with (done, of, text)."""
    html = render(view, report)
    return write_page(path, "prediction", html)


def render(view: PredictionView, report: style.Report | None = None) -> str:
    """The page as HTML. report: called with (done, of, text) as pictures are drawn."""
    s = view.summary
    with style.looks():
        drawings = {"overview": overview_picture, "detail": detail_picture, "miss": miss_picture,
                    "width": width_picture}  # fmt: skip
        pictures = style.drawn({name: partial(draw, view) for name, draw in drawings.items()}, report)
    origin = str(s.get("origin") or "")
    return environment().from_string(_PAGE).render(
        model=s["model"],
        signal=s["signal"],
        wanted=(s.get("wanted") or {}).get("file"),
        calibration=s.get("calibration") or "",
        campaign=s.get("campaign") or "campaign",
        version=s["version"],
        origin=origin,
        simulated=any(w in origin.lower() for w in ("simulat", "virtual bench", "synthetic")),
        sentence=sentence(s),
        level="check" if s["warnings"] else "good",
        warnings=[digits.page_text(str(w)) for w in s["warnings"]],
        pictures=[p for p in pictures.values() if p is not None],
        rows=_rows(s),
        unmet=_unmet_rows(s),
        more=max(0, int((s.get("wanted") or {}).get("unmet_count") or 0) - 20),
        inputs=[(i["file"], _size(int(i["size"])), str(i["sha256"])[:16]) for i in s["inputs"]],
        command=" ".join(str(w) for w in s.get("command") or ()),
        seconds=digits.significant(s["seconds"], 3),
    )


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count >= 1e6 else f"{count / 1e3:.3g} kB"


def sentence(s: Mapping[str, Any]) -> str:
    """What comes out, in a sentence or three."""
    top, unit = s["largest"], s["unit"]
    scale = digits.scale_for(abs(top["mean"]) or None, unit)
    spread = (top["q95"] - top["q05"]) / scale.factor
    d = digits.decimals_for(spread) if spread > 0 else 2
    low, mean, high = (digits.fixed(scale(top[k]), d) for k in ("q05", "mean", "q95"))
    what = "stroke" if s["channel"] == "displacement" else "force"
    text = (
        f"The largest {what} is {mean} {scale.unit} (90 %: {low} to {high}), "
        f"at {digits.significant(top['time_s'], 4)} s."
    )
    wanted = s.get("wanted")
    if wanted is not None:
        if wanted["unmet_count"]:
            late = sum(e["seconds"] for e in wanted["unmet_by"].values())
            text += (
                f" The mean of the prediction meets the wanted stroke except in {digits.significant(late, 3)} s of "
                f"{digits.significant(s['duration_s'], 4)} s, by up to "
                f"{digits.quantity(wanted['largest_miss_m'], 'm')}."
            )
        else:
            close = digits.quantity(wanted.get("met_to_m") or 1e-9, "m")
            text += f" The mean of the prediction meets the wanted stroke everywhere, to {close}."
    if any("extrapolation" in w for w in s["warnings"]):
        text += " In part this is an extrapolation beyond what the calibration has seen."
    return text


def terminal_summary(summary: Mapping[str, Any], width: int = 80) -> str:
    """The same for a terminal, in lines of at most `width` columns."""
    lines = textwrap.wrap(
        f"{summary['model']} of {summary['calibration']}: {summary['signal']}, {summary['n']} rows, "
        f"{summary['draws']} draws", width
    )
    lines += ["", *textwrap.wrap(digits.ascii_text(sentence(summary)), width)]
    notes = summary["warnings"]
    if notes:
        lines += ["", f"{len(notes)} warning{'' if len(notes) == 1 else 's'}:"]
        for w in notes:
            lines += textwrap.wrap(
                digits.ascii_text(str(w)), width, initial_indent="- ", subsequent_indent="  "
            )
    return "\n".join(lines)


def _before(about: Mapping[str, Any]) -> str:
    """What the offset of a recording rests on."""
    return "zeroed just before" if about.get("zeroed") else "that was not zeroed before (--zeroed: it will be)"


def _rows(s: Mapping[str, Any]) -> list[tuple[str, str]]:
    about, unit = s.get("sensor") or {}, s["unit"]
    rows = [
        ("Input", f"{s['signal']}: {digits.fixed(s['n'])} rows, {digits.significant(s['duration_s'], 4)} s"),
        ("Draws", digits.fixed(s["draws"])),
        ("Specimen", str(s["specimen"])),
        ("Starts", "rested: no memory of what was played before"),
        ("Between rows", f"hold = {s['hold']}"),
    ]
    if about:
        gain = f"{digits.percent(about['gain_mean'], 2)} ± {digits.percent(about['gain_sd'], 2)} %"
        rows += [
            ("Sensor, noise of one sample", digits.quantity(about["noise_sd"], unit)),
            (
                f"Sensor, offset of a recording {_before(about)}",
                f"± {digits.quantity(about['offset_sd'], unit)} (one sd)",
            ),
            ("Sensor, error of its gain", f"{gain} ({about['source']})"),
        ]
    for key, value in (s.get("limits") or {}).items():
        name, unit = key.rsplit("_", 1)
        rows.append((f"{name.replace('_', ' ').capitalize()} stated", f"{value:g} {unit}" if value else "none"))
    seen = s.get("seen") or {}
    if seen:
        rows.append(
            (
                "Seen by the calibration",
                f"up to {digits.quantity(seen.get('largest_' + s['input']), _INPUTS[s['input']][1])}, "
                f"{digits.significant(seen.get('duration_s'), 3)} s, {digits.significant(seen.get('frequency_Hz'), 3)} "
                "repetitions a second",
            )
        )
    return rows


def _unmet_rows(s: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    return [
        (
            digits.fixed(u["t_start_s"], 3),
            digits.fixed(u["t_end_s"], 3),
            digits.quantity(u["miss_m"], "m"),
            u["why"],
        )
        for u in (s.get("wanted") or {}).get("unmet", [])[:20]
    ]


# ---------------------------------------------------------------- pictures


def _pieces(n: int) -> NDArray[np.int64]:
    """Starts of at most half as many pieces as a line may have points."""
    return np.unique(np.linspace(0, n, min(n, _POINTS // 2) + 1).astype(np.int64))[:-1]


def _line(ax: Axes, t: Array, y: Array, **how: Any) -> None:
    """A line through lowest and highest of each piece: no peak is lost."""
    if t.size <= _POINTS:
        ax.plot(t, y, **how)
        return
    at = _pieces(t.size)
    ends = np.column_stack([np.minimum.reduceat(y, at), np.maximum.reduceat(y, at)])
    falling = y[np.append(at[1:], t.size) - 1] < y[at]
    ends[falling] = ends[falling][:, ::-1]
    ax.plot(np.repeat(t[at], 2), ends.ravel(), **how)


def _fill(ax: Axes, t: Array, low: Array, high: Array, color: str, label: str) -> None:
    if t.size > _POINTS:
        at = _pieces(t.size)
        t, low, high = t[at], np.minimum.reduceat(low, at), np.maximum.reduceat(high, at)
    ax.fill_between(t, low, high, color=color, lw=0, label=label)


def _panels(view: PredictionView, inside: slice, height: float) -> tuple[Any, Any]:
    """Answer with bands over the command, of some rows."""
    figure = style.new_figure(height)
    grid = figure.add_gridspec(2, 1, left=0.115, right=0.975, top=0.86, bottom=0.125, hspace=0.12, height_ratios=(2, 1))
    top, bottom = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    t = view.time_s[inside]
    mean = view.mean[inside]
    low, high = view.band("reading", 5), view.band("reading", 95)
    scale = digits.scale_for(float(np.max(np.abs(mean))) or None, view.unit)
    word = "stroke" if view.channel == "displacement" else "force"
    if low is not None and high is not None:
        _fill(top, t, low[inside] / scale.factor, high[inside] / scale.factor, style.BAND_90, "one reading, 90 %")
    p_low, p_high = view.band(view.channel, 5), view.band(view.channel, 95)
    assert p_low is not None
    assert p_high is not None
    _fill(top, t, p_low[inside] / scale.factor, p_high[inside] / scale.factor, style.BAND_50, f"{word} itself, 90 %")
    if view.wanted is not None:
        _line(top, t, view.wanted[inside] / scale.factor, color=style.VERMILLION, lw=1.1, ls="--", label="wanted")
    _line(top, t, mean / scale.factor, color=style.BLUE, lw=1.0, label=f"{word}, mean")
    name, unit = _INPUTS[view.input]
    own = digits.scale_for(float(np.max(np.abs(view.columns[view.input]))) or None, unit)
    _line(bottom, t, view.columns[view.input][inside] / own.factor, color=style.BLACK, lw=1.0)
    for ax in (top, bottom):
        ax.set_xlim(float(t[0]), float(t[-1]))
        ax.locator_params(axis="x", nbins=7)
    top.locator_params(axis="y", nbins=6)
    bottom.locator_params(axis="y", nbins=4)
    top.tick_params(labelbottom=False)
    top.set_ylabel(f"{word} / {scale.unit}")
    bottom.set_ylabel(f"{name} / {own.unit}")
    bottom.set_xlabel("time / s")
    figure.align_ylabels([top, bottom])
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.1, 0.995), ncols=len(labels))
    return figure, top


def overview_picture(view: PredictionView) -> Picture:
    """The whole command and its answer."""
    figure, top = _panels(view, slice(None), 4.0)
    shaded = _shade(top, view)
    caption = (
        "Above: the answer to the command below. Dark band: where the "
        f"{'stroke' if view.channel == 'displacement' else 'force'} itself lies with 90 % probability (uncertainty of "
        "the parameters alone); it may be no wider than the line. Light band: where 9 of 10 single readings of the "
        "sensor will fall; it adds the sensor's own gain, the offset of a new recording "
        f"{_before(view.summary['sensor'])}, and noise."
    )
    if view.band("reading", 5) is None:
        caption = caption.split(" Light band")[0]
    if shaded:
        caption += " Grey: the wanted stroke (dashed) cannot be met there."
    return style.picture(figure, caption, "The whole command and the predicted answer with bands over time")


def _shade(ax: Axes, view: PredictionView) -> bool:
    unmet = (view.summary.get("wanted") or {}).get("unmet") or []
    for u in unmet:
        ax.axvspan(u["t_start_s"], u["t_end_s"], color="#dddddd", lw=0, zorder=0)
    return bool(unmet)


def window(time_s: Array, values: Array) -> slice:
    """Rows around the largest change of the command: two periods where it repeats, else up to two seconds."""
    n = time_s.size
    if n < 50 or np.ptp(values) == 0:
        return slice(0, n)
    span = float(time_s[-1] - time_s[0])
    reach = max(1, round(0.002 * n))
    change = np.abs(values[reach:] - values[:-reach])
    at = int(np.argmax(change)) + reach // 2
    middle = 0.5 * (values.max() + values.min())
    rises = np.flatnonzero((values[1:] >= middle) & (values[:-1] < middle))
    length = min(2.0, 0.1 * span)
    if rises.size >= 3:
        length = 2.2 * float(np.median(np.diff(time_s[rises])))
    length = max(length, 20 * float(np.median(np.diff(time_s))))
    start = max(float(time_s[0]), float(time_s[at]) - 0.35 * length)
    a, b = np.searchsorted(time_s, [start, start + length])
    return slice(int(a), int(min(max(b, a + 20), n)))


def detail_picture(view: PredictionView) -> Picture | None:
    """The largest change of the command, enlarged."""
    inside = window(view.time_s, view.columns[view.input])
    if inside.stop - inside.start >= 0.9 * view.time_s.size:
        return None
    figure, top = _panels(view, inside, 3.6)
    _shade(top, view)
    top.set_xlim(float(view.time_s[inside][0]), float(view.time_s[inside][-1]))
    caption = (
        "The same, enlarged around the largest change of the command: how fast the answer follows, and how it creeps "
        "after."
    )
    return style.picture(figure, caption, "Command and predicted answer, enlarged around the largest change")


def miss_picture(view: PredictionView) -> Picture | None:
    """Predicted minus wanted stroke."""
    if view.wanted is None:
        return None
    figure = style.new_figure(2.3)
    ax = figure.add_axes((0.115, 0.21, 0.86, 0.72))
    miss = view.mean - view.wanted
    scale = digits.scale_for(max(float(np.max(np.abs(miss))), 1e-9), "m")
    _shade(ax, view)
    _line(ax, view.time_s, miss / scale.factor, color=style.BLUE, lw=1.0)
    ax.axhline(0, color=style.GREY, lw=0.7)
    ax.set_xlim(float(view.time_s[0]), float(view.time_s[-1]))
    ax.set_xlabel("time / s")
    ax.set_ylabel(f"predicted − wanted / {scale.unit}")
    caption = (
        "How far the predicted stroke is from the wanted one. Zero: the command meets the wish. Grey: it cannot, for "
        "the reasons listed below."
    )
    return style.picture(figure, caption, "Predicted minus wanted stroke over time")


def width_picture(view: PredictionView) -> Picture:
    """Half-widths of both bands over time."""
    figure = style.new_figure(2.6)
    ax = figure.add_axes((0.115, 0.19, 0.86, 0.66))
    widths = []
    word = "stroke" if view.channel == "displacement" else "force"
    for what, label, color, line in (
        ("reading", "one reading", style.ORANGE, "--"),
        (view.channel, f"{word} itself", style.BLUE, "-"),
    ):
        low, high = view.band(what, 5), view.band(what, 95)
        if low is not None and high is not None:
            widths.append((0.5 * (high - low), label, color, line))
    scale = digits.scale_for(max(float(np.max(w)) for w, *_ in widths) or None, view.unit)
    for width, label, color, line in widths:
        _line(ax, view.time_s, width / scale.factor, color=color, ls=line, lw=1.1, label=label)
    ax.set_xlim(float(view.time_s[0]), float(view.time_s[-1]))
    ax.set_ylim(bottom=0)
    ax.locator_params(axis="y", nbins=5)
    ax.set_xlabel("time / s")
    ax.set_ylabel(f"half-width / {scale.unit}")
    figure.legend(*ax.get_legend_handles_labels(), loc="upper left", bbox_to_anchor=(0.1, 0.995), ncols=2)
    top = float(np.max(widths[-1][0]))
    caption = (
        f"How sure the prediction is: half-width of the 90 % bands. That of the {word} itself grows with the {word}, "
        f"up to {digits.quantity(top, view.unit)}"
        + ("; that of a reading is mostly noise and offset of the sensor." if len(widths) > 1 else ".")
    )
    return style.picture(figure, caption, "Half-widths of the 90 % bands over time")


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="bayes-dea {{ version }}">
<title>{{ signal }}: prediction of {{ model }}</title>
<style>
{% include "report.css" %}
</style>
</head>
<body>
<header>
{% if simulated %}
<p class="simulated"><strong>Simulated data.</strong> The calibration used no measurements. Origin: {{ origin }}.</p>
{% elif origin %}
<p class="origin"><strong>Origin of the calibration's data:</strong> {{ origin }}</p>
{% endif %}
{% if wanted %}
<h1>Command for <span class="name">{{ wanted }}</span>, found with <span class="name">{{ model }}</span></h1>
{% else %}
<h1>Prediction of <span class="name">{{ model }}</span> for <span class="name">{{ signal }}</span></h1>
{% endif %}
<p class="verdict {{ level }}">{{ sentence }}</p>
</header>
<main>
{% if warnings %}
<section id="warnings">
<h2>Warnings</h2>
<ul class="warnings">
{% for w in warnings %}
<li>{{ w }}</li>
{% endfor %}
</ul>
</section>
{% endif %}
<section id="answer">
<h2>The answer</h2>
<div class="columns pictures">
{% for p in pictures %}
<figure>
<img src="{{ p.source }}" width="{{ p.width }}" height="{{ p.height }}" alt="{{ p.alt }}">
<figcaption>{{ p.caption }}</figcaption>
</figure>
{% endfor %}
</div>
</section>
{% if unmet %}
<section id="unmet">
<h2>Where the wanted stroke cannot be met</h2>
<div class="scroll"><table class="numbers">
<thead><tr><th class="keep">from / s</th><th class="keep">to / s</th><th>largest miss</th>
<th class="words">why</th></tr></thead>
<tbody>
{% for a, b, miss, why in unmet %}
<tr><td>{{ a }}</td><td>{{ b }}</td><td class="keep">{{ miss }}</td><td class="words">{{ why }}</td></tr>
{% endfor %}
</tbody></table></div>
{% if more %}
<p class="note">and {{ more }} further interval{{ "" if more == 1 else "s" }}; see prediction.json.</p>
{% endif %}
</section>
{% endif %}
<section id="what">
<h2>What was assumed</h2>
<dl>
{% for name, text in rows %}
<dt>{{ name }}</dt><dd>{{ text }}</dd>
{% endfor %}
</dl>
<p class="note">The gain of the sensor and the stiffness of the actuator were calibrated together: a gain that is off
widens the dark band (the true stroke) but not the light one, because the same sensor will read the same.</p>
</section>
<section id="repeat">
<h2>To repeat it</h2>
<p>Calibration: <span class="name">{{ calibration }}</span> (campaign <span class="name">{{ campaign }}</span>).</p>
{% if command %}
<pre>{{ command }}</pre>
{% endif %}
<div class="scroll"><table class="numbers">
<thead><tr><th>file</th><th>size</th><th class="words">SHA-256 begins with</th></tr></thead>
<tbody>
{% for file, size, short in inputs %}
<tr><th scope="row" class="file">{{ file }}</th><td class="keep">{{ size }}</td><td class="mono">{{ short }}</td></tr>
{% endfor %}
</tbody></table></div>
<p class="note">Every row with its bands is in prediction.csv; computed in {{ seconds }} s.</p>
</section>
</main>
<footer><p>Written by bayes-dea {{ version }}.</p></footer>
</body>
</html>
"""

"""The plot that is zoomed in the browser: one Bokeh layout, filled for each recording by templates/viewer.js.

The layout is stored once in the page, whatever the number of recordings; the script gives each copy its axes, ranges
and data by the names of the models. Bokeh's own script is put into the page as it is: no network is needed.
"""

from __future__ import annotations

import base64
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import digits, style
from .data import RecordingData
from .figures_recordings import Z50, Z90, detail_of, largest_departure

HEIGHTS = (205, 105, 112)  # measured and predicted, residual, input; in CSS pixels
_LEFT = 66


@dataclass(frozen=True)
class Live:
    """What the page holds of one recording: caption, settings as JSON, data as base64 text."""

    caption: str
    settings: str
    data: str


def bokeh_script() -> str:
    """BokehJS as text that may stand inside a script tag."""
    import bokeh

    path = Path(bokeh.__file__).parent / "server" / "static" / "js" / "bokeh.min.js"
    return path.read_text(encoding="utf-8").replace("</script", "<\\/script")


def layout_json() -> str:
    """The layout as JSON for a script tag; the same text every time."""
    from bokeh.embed import json_item

    return _in_script(_renumbered(json.dumps(json_item(_layout()), separators=(",", ":"))))  # type: ignore[no-untyped-call]


def live_of(r: RecordingData) -> Live | None:
    """Data and words for one recording; None where the result holds nothing to zoom into."""
    if r.page is None:
        return None
    shown = digits.scale_for(float(np.nanmax(np.abs(r.observed))), r.unit)
    word, unit = r.input_column
    drive = digits.scale_for(float(np.nanmax(np.abs(r.input))) or None, unit)
    detail = detail_of(r.time_s, r.input)
    settings = {
        "columns": [dict(c) for c in r.page.packed.columns],
        "edges": list(r.page.edges_s),
        "step": r.page.step_s,
        "rows": r.page.rows_per_bin,
        "factor": shown.factor,
        "unit": shown.unit,
        "channel": r.channel,
        "input": word,
        "inputFactor": drive.factor,
        "inputUnit": drive.unit,
        "hold": detail.origin if detail.log else None,
        "z": [Z50, Z90],
    }
    return Live(_caption(r), _in_script(json.dumps(settings)), base64.b64encode(r.page.packed.data).decode())


def _caption(r: RecordingData) -> str:
    assert r.page is not None
    if r.page.reach_s is None:
        kept = "Zoomed in far enough, every sample is a dot."
    else:
        bins = f"at best the range and mean of {r.page.rows_per_bin} samples"
        kept = f"Zoomed in, every sample within {r.page.reach_s:.2g} s of an edge is shown; elsewhere {bins}."
        if not r.page.edges_s:
            kept = f"It has no edges; zoomed in, it shows {bins}."
    word = "fitted" if r.fitted else "never fitted"
    cover, worst = r.entry.get("coverage_90"), largest_departure(r)
    return (
        f"Measured ({word}) and predicted over time; below, the residual and the {r.input_column[0]}. The light band "
        f"holds {digits.percent(cover)} % of the single samples, where 90 % should lie in it; the largest departure of "
        f"a mean is {worst}. {kept}"
    )


def _layout() -> Any:
    from bokeh.layouts import column
    from bokeh.models import (
        BasicTicker,
        BoxZoomTool,
        ColumnDataSource,
        CustomJS,
        HoverTool,
        PanTool,
        Range1d,
        WheelZoomTool,
    )
    from bokeh.plotting import figure

    x_range = Range1d(start=0, end=1, name="x_range")
    redraw = CustomJS(code="if (window.bayesDeaRedraw) window.bayesDeaRedraw(cb_obj)")
    for end in ("start", "end"):
        x_range.js_on_change(end, redraw)
    source = {
        name: ColumnDataSource({c: [] for c in columns.split()}, name=name)
        for name, columns in (
            ("bars", "left right middle y_min y_max y_mean r_min r_max r_mean u_min u_max"),
            ("dots", "x t y p r"),
            ("curve", "x p p_min p_max low50 high50 low90 high90 r50 r90 R50 R90 u"),
        )
    }
    plots = []
    for name, height in zip(("main", "residual", "input"), HEIGHTS, strict=True):
        plot = figure(
            name=name,
            height=height,
            sizing_mode="stretch_width",
            x_range=x_range,
            y_range=Range1d(start=0, end=1),
            tools=[
                PanTool(dimensions="width"),
                zoom := BoxZoomTool(dimensions="width"),
                WheelZoomTool(dimensions="width", modifiers={"ctrl": True}),
            ],
            toolbar_location=None,
            min_border_left=_LEFT,
            min_border_right=14,
            min_border_top=6,
            min_border_bottom=4,
            outline_line_color=None,
            output_backend="canvas",
        )
        plot.toolbar.active_drag = zoom
        plot.toolbar.logo = None
        plot.grid.grid_line_color = "#e6e6e6"
        for axis in (plot.xaxis[0], plot.yaxis[0]):
            axis.axis_label_text_font_style = "normal"
            axis.axis_label_text_font_size = "12px"
            axis.major_label_text_font_size = "12px"
            axis.axis_label_text_color = axis.major_label_text_color = "#333333"
            axis.axis_line_color = axis.major_tick_line_color = "#555555"
            axis.minor_tick_line_color = None
        plot.yaxis[0].ticker = BasicTicker(desired_num_ticks=5 if name == "main" else 3)
        plot.xaxis[0].visible = name == "input"
        plots.append(plot)
    main, residual, drive = plots
    # bars first and see-through bands over them: either can be read where both are
    for plot, letter, bands in (
        (main, "y", (("low90", "high90"), ("low50", "high50"))),
        (residual, "r", (("r90", "R90"), ("r50", "R50"))),
    ):
        plot.quad(
            "left",
            "right",
            f"{letter}_max",
            f"{letter}_min",
            source=source["bars"],
            color=style.BAR,
            line_color=None,
        )
        for (below, above), alpha in zip(bands, (style.ALPHA_90, style.ALPHA_50), strict=True):
            plot.varea("x", below, above, source=source["curve"], fill_color=style.BLUE, fill_alpha=alpha)
    residual.line([-1e12, 1e12], [0, 0], color=style.BLUE, line_width=1)
    main.varea("x", "p_min", "p_max", source=source["curve"], color=style.BLUE)
    main.line("x", "p", source=source["curve"], color=style.BLUE, line_width=2)
    for plot, letter in ((main, "y"), (residual, "r")):
        plot.scatter("middle", f"{letter}_mean", source=source["bars"], size=2.6, color=style.BLACK, line_color=None)
        dots = plot.scatter("x", letter, source=source["dots"], size=3, color=style.BLACK, line_color=None)
        hover = HoverTool(
            renderers=[dots],
            tooltips=[
                ("time", "@t{0.000000} s"),
                ("measured", "@y{0.000}"),
                ("predicted", "@p{0.000}"),
                ("residual", "@r{0.000}"),
            ],
            limit=1,
            visible=False,
        )
        plot.add_tools(hover)
    drive.quad("left", "right", "u_max", "u_min", source=source["bars"], color=style.BLACK, line_width=1)
    drive.line("x", "u", source=source["curve"], color=style.BLACK, line_width=1.2)
    return column(*plots, sizing_mode="stretch_width", spacing=2, name="viewer")


def _renumbered(text: str) -> str:
    """The same JSON whatever Bokeh models the process made before: ids counted from one."""
    ids: dict[str, str] = {}
    text = re.sub(r'"p\d{4,}"', lambda m: ids.setdefault(m.group(0), f'"m{len(ids) + 1}"'), text)
    return re.sub(r'"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}"', '"document"', text)


def _in_script(text: str) -> str:
    """JSON that may stand inside a script tag: nothing in it can end the tag or open a comment."""
    return text.replace("<", "\\u003c")

"""How pictures look, and how they get into the page as self-contained SVG."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: called with (done, of, text) as a page is drawn
Report = Callable[[float, float, str], None]
Drawn = TypeVar("Drawn")

# Okabe and Ito's colours, dark and light alternating so that they differ in grey as well
BLUE, VERMILLION, ORANGE, GREEN, BLACK, GREY = "#0072B2", "#D55E00", "#E69F00", "#009E73", "#1a1a1a", "#8a8a8a"
PRIOR, PRIOR_AREA = "#c78a00", "#f7e3bd"
BAND_90, BAND_50 = "#d9eaf5", "#a6cde6"
#: what lies over something else: the same two bands as blue that lets through, the inner one upon the outer one
ALPHA_90, ALPHA_50 = 0.15, 0.235
BAR = "#c2c2c2"  # from the lowest to the highest of several samples
#: ensembles: colour and line style both differ
CHAIN_STYLES: tuple[tuple[str, Any], ...] = (
    (BLUE, "-"),
    (VERMILLION, "--"),
    (GREEN, "-."),
    (ORANGE, ":"),
    (BLACK, "-"),
    (GREY, (0, (6, 1, 1, 1, 1, 1))),
)
WIDTH_IN = 6.7  # 640 CSS pixels: shown at its own size from the narrowest screen on

_RC: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "font.family": "sans-serif",
    # the list goes into every text of a picture: three names instead of ten are a third of a page
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.edgecolor": "#555555",
    "axes.unicode_minus": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.use_mathtext": False,
    "lines.linewidth": 1.3,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "axes.grid": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "bayes-dea",
    "text.parse_math": False,  # a file may be called "$1.csv"
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
    "figure.dpi": 96.0,
}


@dataclass(frozen=True)
class Picture:
    """One picture of the page: source for an image tag, caption, words for who cannot see it, size in CSS pixels."""

    source: Markup  # as it stands in the attribute
    caption: str
    alt: str
    width: int
    height: int


@contextmanager
def looks() -> Iterator[None]:
    """The style of the report, for as long as the block lasts; the caller's settings stay as they are."""
    import matplotlib as mpl

    with mpl.rc_context(_RC):  # type: ignore[arg-type]
        yield


def drawn(drawings: Mapping[str, Callable[[], Drawn]], report: Report | None = None) -> dict[str, Drawn]:
    """What each of the drawings returns, by name, in their order."""
    out = {}
    for done, (name, draw) in enumerate(drawings.items(), start=1):
        out[name] = draw()
        if report is not None:
            report(done, len(drawings), name)
    return out


def new_figure(height_in: float, width_in: float = WIDTH_IN) -> Figure:
    """A figure that no global list knows: gone when it is no longer used."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in))
    FigureCanvasSVG(figure)
    return figure


def picture(figure: Figure, caption: str, alt: str) -> Picture:
    """Embed a figure as a data URI."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    # a tenth of a point is finer than a screen shows; it halves the page
    text = re.sub(
        r' d="([^"]+)"',
        lambda m: ' d="' + _short_path(m.group(1)) + '"',
        buffer.getvalue(),
    )
    width, height = figure.get_size_inches() * 96
    return picture_of(text, round(width), round(height), caption, alt)


def picture_of(svg: str, width: int, height: int, caption: str, alt: str) -> Picture:
    """Embed SVG text, shown in so many CSS pixels."""
    source = Markup("data:image/svg+xml,") + Markup(quote(_one_line(svg), safe=" =:/,;()+!*@'<>?[]{}|^~`-_."))
    return Picture(source, caption, alt, width, height)


def _one_line(svg: str) -> str:
    """The picture without prolog and comments, on one line and with single quotes: few signs to escape in a tag."""
    svg = re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.S)
    return re.sub(r">\s+<", "><", svg).replace("\n", " ").replace("'", "&apos;").replace('"', "'")


def _short_path(d: str) -> str:
    """A path in fewer bytes: tenths of a point, no spaces between commands, a dot as a step of no length."""
    d = re.sub(r"(\.\d)\d+", r"\1", d).replace(".0 ", " ").replace("\n", "")
    d = re.sub(r"M (\S+ \S+) L \1(?= |$)", r"M\1h0", d)
    return re.sub(r" ?([MLCQZz]) ?", r"\1", d)


def dots(ax: Axes, x: NDArray, y: NDArray, size: float = 2.2, color: str = BLACK, zorder: float = 3) -> None:
    """Round dots as one path: a tenth of the bytes of markers, which matters with twenty recordings on a page."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    good = np.isfinite(x) & np.isfinite(y)
    points = np.repeat(np.column_stack([x[good], y[good]]), 2, axis=0)
    if not len(points):
        return
    # a stroke of no length with round ends is a dot
    codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=np.uint8), len(points) // 2)
    path = Path(points, codes)
    path.should_simplify = False
    patch = PathPatch(
        path, fill=False, edgecolor=color, linewidth=size, capstyle="round", zorder=zorder, transform=ax.transData
    )
    ax.add_artist(patch)  # unlike add_patch it leaves the limits alone, which every caller sets


def log_ticks(low: float, high: float, most: int = 5) -> NDArray[np.float64]:
    """Ticks for a logarithmic axis: decades, thinned to `most`, or 1-2-5 steps within few decades."""
    first, last = int(np.ceil(np.log10(low) - 1e-9)), int(np.floor(np.log10(high) + 1e-9))
    decades = np.power(10.0, np.arange(first, last + 1))
    if len(decades) >= 3:
        return np.asarray(decades[:: max(1, -(-len(decades) // most))], dtype=np.float64)
    series = np.array([m * 10.0**e for e in range(first - 1, last + 1) for m in (1, 2, 5)])
    inside = series[(series >= low) & (series <= high)]
    if len(inside) >= 2:
        return inside[:: max(1, -(-len(inside) // most))]
    return np.unique([float(f"{low:.2g}"), float(f"{high:.2g}")])


def tick_text(value: float) -> str:
    """A tick label in plain digits where they are short, powers of ten otherwise."""
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        exponent = int(np.floor(np.log10(abs(value)) + 1e-9))
        sign = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        head = value / 10.0**exponent
        return f"10{sign}" if abs(head - 1) < 1e-6 else f"{head:g}·10{sign}"
    return f"{value:g}".replace("-", "−")


def set_log_x(ax: Axes, low: float, high: float, most: int = 5) -> None:
    """Logarithmic x axis between two limits with labels that any font can show."""
    from matplotlib.ticker import NullLocator

    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ticks = log_ticks(low, high, most)
    ax.set_xticks(ticks, [tick_text(t) for t in ticks])
    ax.xaxis.set_minor_locator(NullLocator())


def smooth_density(values: NDArray, grid: NDArray, factor: float = 1.0, mirror: bool = False) -> NDArray[np.float64]:
    """Gaussian kernel density of values on an even grid, largest value one. Silverman's width times `factor`.

    mirror: reflect at the extremes, so that a uniform density does not sink at its ends.
    """
    v = values[np.isfinite(values)]
    low, high = float(v.min()), float(v.max())
    if v.size < 2 or np.ptp(v) == 0:
        return np.zeros_like(grid)
    q = np.quantile(v, [0.25, 0.75])
    spread = min(float(np.std(v)), float(q[1] - q[0]) / 1.349) or float(np.std(v))
    step = float(grid[1] - grid[0])
    width = max(0.9 * factor * spread * v.size**-0.2, 0.75 * step)
    reach = int(np.ceil(4 * width / step))
    edges = grid[0] + step * (np.arange(-reach, len(grid) + reach + 1) - 0.5)
    counts = np.histogram(np.concatenate([v, 2 * low - v, 2 * high - v]) if mirror else v, edges)[0].astype(float)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * step / width) ** 2)
    smooth = np.convolve(counts, kernel, mode="valid")
    if mirror:
        smooth[(grid < low - step) | (grid > high + step)] = 0.0
    smooth /= max(float(smooth.max()), 1e-300)
    return np.array(smooth, dtype=np.float64)

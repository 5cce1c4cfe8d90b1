"""Panels with axes as SVG text: what a page draws twice a recording, a fifty times quicker than a plotting library."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import digits, style

_FONT = 12  # px
_INK, _FRAME = "#1a1a1a", "#555555"


@dataclass
class Panel:
    """One pair of axes: place on the sheet in px, limits in data; what is drawn is cut off at its frame."""

    x: float
    y: float
    width: float
    height: float
    x_limits: tuple[float, float]
    y_limits: tuple[float, float]
    log_x: bool = False
    log_y: bool = False
    inside: list[str] = field(default_factory=list, repr=False)
    outside: list[str] = field(default_factory=list, repr=False)

    def px(self, x: ArrayLike) -> NDArray[np.float64]:
        """Abscissa in px from the panel's left."""
        return _place(x, self.x_limits, self.log_x) * self.width

    def py(self, y: ArrayLike) -> NDArray[np.float64]:
        """Ordinate in px from the panel's top."""
        return (1 - _place(y, self.y_limits, self.log_y)) * self.height

    def band(self, x: NDArray, low: NDArray, high: NDArray, color: str) -> None:
        """Area between two curves (n,)."""
        good = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        there, back = self._points(x[good], high[good]), self._points(x[good][::-1], low[good][::-1])
        self.inside.append(f'<path d="M{_joined([*there, *back])}z" fill="{color}"/>')

    def span(self, low: float, high: float, color: str) -> None:
        """Area between two ordinates, over the whole width."""
        top, bottom = float(self.py(high)), float(self.py(low))
        self.inside.append(
            f'<path d="M0 {_num(top)}H{_num(self.width)}V{_num(bottom)}H0z" fill="{color}"/>'
        )

    def line(self, x: NDArray, y: NDArray, color: str, width: float = 1.4, dash: str = "") -> None:
        """Curve (n,) through what is finite."""
        good = np.isfinite(x) & np.isfinite(y)
        if good.any():
            self._stroke("M" + _joined(self._points(x[good], y[good])), color, width, dash)

    def level(self, y: float, color: str = style.GREY, width: float = 1.1, dash: str = "") -> None:
        """Horizontal line over the whole width."""
        self._stroke(f"M0 {_num(float(self.py(y)))}H{_num(self.width)}", color, width, dash)

    def dots(self, x: NDArray, y: NDArray, size: float = 2.4, color: str = style.BLACK) -> None:
        """Round dots (n,): strokes of no length with round ends."""
        good = np.isfinite(x) & np.isfinite(y)
        if good.any():
            d = "".join(f"M{p}h0" for p in self._points(x[good], y[good]))
            self.inside.append(
                f'<path d="{d}" fill="none" stroke="{color}" stroke-width="{size:g}" stroke-linecap="round"/>'
            )

    def squares(self, x: NDArray, y: NDArray, size: float = 4.0, color: str = style.VERMILLION) -> None:
        """Open squares (n,)."""
        half = size / 2
        d = "".join(
            f"M{_num(a - half)} {_num(b - half)}h{size:g}v{size:g}h{-size:g}z"
            for a, b in zip(self.px(x), self.py(y), strict=True)
        )
        self.inside.append(f'<path d="{d}" fill="#fff" stroke="{color}"/>')

    def bars(self, x: NDArray, low: NDArray, high: NDArray, color: str, width: float = 1.3) -> None:
        """Vertical strokes (n,) from low to high."""
        d = "".join(
            f"M{_num(a)} {_num(b)}V{_num(c)}" for a, b, c in zip(self.px(x), self.py(low), self.py(high), strict=True)
        )
        self._stroke(d, color, width)

    def stairs(self, edges: NDArray, heights: NDArray, fill: str, color: str) -> None:
        """Histogram: edges (b + 1,), heights (b,)."""
        d = f"M{_num(float(self.px(edges[0])))} {_num(float(self.py(0.0)))}" + "".join(
            f"V{_num(v)}H{_num(u)}" for u, v in zip(self.px(edges[1:]), self.py(heights), strict=True)
        )
        self.inside.append(f'<path d="{d}V{_num(float(self.py(0.0)))}z" fill="{fill}" stroke="{color}"/>')

    def x_axis(self, label: str = "", ticks: Sequence[float] | None = None, labelled: bool = True) -> None:
        """Axis below: ticks with plain labels, and what it is."""
        values, texts = _ticks(self.x_limits, self.log_x, ticks, max(2, int(self.width / 52)))
        bottom = self.y + self.height
        self._axis(f"M{_num(self.x)} {_num(bottom)}h{_num(self.width)}")
        for u, text in zip(self.px(values) + self.x, texts, strict=True):
            self._axis(f"M{_num(u)} {_num(bottom)}v4")
            if labelled:
                self.outside.append(_text(u, bottom + 16, text, "middle"))
        if label:
            self.outside.append(_text(self.x + self.width / 2, bottom + 33, label, "middle"))

    def y_axis(self, label: str = "", ticks: Sequence[float] | None = None, labelled: bool = True) -> None:
        """Axis at the left."""
        values, texts = _ticks(self.y_limits, self.log_y, ticks, max(2, int(self.height / 34)))
        self._axis(f"M{_num(self.x)} {_num(self.y)}v{_num(self.height)}")
        for v, text in zip(self.py(values) + self.y, texts, strict=True):
            self._axis(f"M{_num(self.x)} {_num(v)}h-4")
            if labelled:
                self.outside.append(_text(self.x - 7, v + 4, text, "end"))
        if label:
            at = f"{_num(self.x - 50)},{_num(self.y + self.height / 2)}"
            turned = f'transform="translate({at}) rotate(-90)" text-anchor="middle"'
            self.outside.append(f"<text {turned}>{escape(label)}</text>")

    def title(self, text: str) -> None:
        """Words above the panel, at its left."""
        self.outside.append(_text(self.x, self.y - 7, text, "start"))

    def message(self, text: str) -> None:
        """Words in the middle of an empty panel."""
        self.outside.append(_text(self.x + self.width / 2, self.y + self.height / 2, text, "middle"))

    def svg(self) -> str:
        """The panel as elements of a sheet."""
        frame = f'x="{_num(self.x)}" y="{_num(self.y)}" width="{_num(self.width)}" height="{_num(self.height)}"'
        return f'<svg {frame} overflow="hidden">{"".join(self.inside)}</svg>{"".join(self.outside)}'

    def _points(self, x: NDArray, y: NDArray) -> list[str]:
        u = np.clip(np.rint(10 * self.px(x)), -1e5, 1e5) / 10
        v = np.clip(np.rint(10 * self.py(y)), -1e5, 1e5) / 10
        return [f"{a:g} {b:g}" for a, b in zip(u.tolist(), v.tolist(), strict=True)]

    def _stroke(self, d: str, color: str, width: float, dash: str = "") -> None:
        dashes = f' stroke-dasharray="{dash}"' if dash else ""
        self.inside.append(f'<path d="{d}" fill="none" stroke="{color}" stroke-width="{width:g}"{dashes}/>')

    def _axis(self, d: str) -> None:
        self.outside.append(f'<path d="{d}" stroke="{_FRAME}"/>')


@dataclass(frozen=True)
class Key:
    """One entry of a legend: kind dot, line or area."""

    kind: str
    color: str
    text: str


def sheet(width: int, height: int, panels: Sequence[Panel], keys: Sequence[Key] = (), at: float = 66.0) -> str:
    """An SVG picture of panels, with a legend along its top."""
    out = [p.svg() for p in panels]
    for key in keys:
        mark = {
            "dot": f'<path d="M{_num(at + 8)} 14h0" stroke="{key.color}" stroke-width="4" stroke-linecap="round"/>',
            "line": f'<path d="M{_num(at)} 14h16" stroke="{key.color}" stroke-width="2"/>',
            "area": f'<path d="M{_num(at)} 10h16v8h-16z" fill="{key.color}"/>',
        }
        out.append(mark[key.kind] + _text(at + 22, 18, key.text, "start"))
        at += 44 + 6.9 * len(key.text)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        f'font-family="DejaVu Sans, Verdana, sans-serif" font-size="{_FONT}" fill="{_INK}">'
        f'<path d="M0 0h{width}v{height}h-{width}z" fill="#fff"/>{"".join(out)}</svg>'
    )


def _place(value: ArrayLike, limits: tuple[float, float], log: bool) -> NDArray[np.float64]:
    v = np.asarray(value, dtype=np.float64)
    low, high = limits
    if log:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray((np.log10(v) - np.log10(low)) / (np.log10(high) - np.log10(low)))
    return np.asarray((v - low) / (high - low))


def _num(value: float) -> str:
    return f"{round(float(value), 1):g}"


def _joined(points: list[str]) -> str:
    """Points one after the other, those that fall on the one before left out."""
    return "L".join(p for i, p in enumerate(points) if i == 0 or p != points[i - 1])


def _text(x: float, y: float, text: str, anchor: str) -> str:
    anchored = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text x="{_num(x)}" y="{_num(y)}"{anchored}>{escape(text)}</text>'


def _ticks(
    limits: tuple[float, float], log: bool, given: Sequence[float] | None, most: int
) -> tuple[NDArray[np.float64], list[str]]:
    if given is not None:
        values = np.asarray(given, dtype=np.float64)
        return values, [style.tick_text(float(v)) for v in values]
    if log:
        values = style.log_ticks(*limits, most)
        return values, [style.tick_text(float(v)) for v in values]
    return linear_ticks(*limits, most)


def linear_ticks(low: float, high: float, most: int) -> tuple[NDArray[np.float64], list[str]]:
    """Round values between two limits, at most so many, with labels of one number of decimals."""
    span = high - low
    rough = span / max(most, 1)
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(float(m * power) for m in (1, 2, 2.5, 5, 10) if m * power >= rough * (1 - 1e-9))
    values = step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    decimals = 0
    while decimals < 9 and abs(round(step, decimals) - step) > 1e-6 * step:
        decimals += 1
    if max(abs(low), abs(high)) >= 1e6 or decimals > 6:
        return values, [style.tick_text(float(f"{v:.3g}")) for v in values]
    return values, [digits.fixed(float(v), decimals) for v in values]


def limits_of(*values: Any, pad: float = 0.03) -> tuple[float, float]:
    """Limits that hold all finite values, a little widened."""
    every = np.concatenate([np.ravel(np.asarray(v, dtype=np.float64)) for v in values])
    every = every[np.isfinite(every)]
    if not every.size:
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    margin = pad * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin

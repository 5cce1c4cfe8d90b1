"""What a calibration found, for a terminal: plain ASCII, no colours, at most so many columns."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from . import digits, tables
from .data import rmse_of
from .verdict import verdict

_GAP = "  "


def terminal_summary(summary: Mapping[str, Any], width: int = 80) -> str:
    """Model, verdict, parameters, recordings and warnings of a calibration.json as text.

    No line is longer than `width` (at least 60); an ESS is given only when the sampler converged.
    """
    width = max(width, 60)
    lines = _wrapped(f"{summary['model']} on {summary.get('campaign') or 'campaign'}", width)
    origin = tables.origin_of(summary.get("meta") or {})
    if origin:
        lines += _wrapped(f"Origin of the data: {origin}", width)
    lines += ["", *_wrapped(digits.ascii_text(verdict(summary).sentence), width)]
    lines += ["", *_parameters(summary, width)]
    lines += ["", *_recordings(summary, width)]
    warnings = [str(w) for w in summary.get("warnings") or []]
    if warnings:
        lines += ["", f"{len(warnings)} warning{'' if len(warnings) == 1 else 's'}:"]
        for text in warnings:
            lines += _wrapped(text, width, "- ", "  ")
    return "\n".join(line.rstrip() for line in lines)


def _wrapped(text: str, width: int, first: str = "", rest: str = "") -> list[str]:
    text = digits.ascii_text(text)
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=rest) or [first.rstrip()]


def _parameters(summary: Mapping[str, Any], width: int) -> list[str]:
    converged = bool(summary["sampler"].get("converged"))
    head = ["parameter", "median", "90 % interval", "unit", "R-hat"] + (["ESS"] if converged else [])
    rows = []
    for name, e in {**summary["parameters"], **summary["noise"]}.items():
        scale, decimals = tables.reading(e)

        def of(key: str, e: Mapping[str, Any] = e, scale: digits.Scale = scale, decimals: int = decimals) -> str:
            return digits.fixed(scale(e[key]), decimals) if digits.is_number(e.get(key)) else digits.MISSING

        row = [
            _bare(name, str(e.get("unit", "1"))),
            of("q50"),
            f"{of('q05')} .. {of('q95')}",
            scale.unit,
            digits.fixed(e.get("rhat"), 3),
        ]
        if converged:
            row.append(digits.fixed(e.get("ess_bulk")))
        rows.append(row)
    return _table(head, rows, "lrrlrr", width)


def _bare(name: str, unit: str) -> str:
    """The name without its unit, which has a column of its own."""
    suffix = "_" + unit.replace(" ", "_")
    head, found, specimen = name.rpartition(suffix)
    return head + specimen if found and head and (not specimen or specimen.startswith("_")) else name


def _recordings(summary: Mapping[str, Any], width: int) -> list[str]:
    head = ["recording", "role", "samples", "RMSE", "noise", "unit", "chi^2", "in 90 %"]
    rows = []
    for r in summary["recordings"]:
        rmse, unit = rmse_of(r)
        scale = digits.scale_for(rmse, unit)

        def of(value: Any, scale: digits.Scale = scale) -> str:
            return digits.significant(scale(value), 3) if digits.is_number(value) else digits.MISSING

        rows.append(
            [
                str(r["recording"]),
                "fitted" if r.get("role") == "identify" else "kept",
                digits.fixed(r.get("n")),
                of(rmse),
                of(r.get("noise_floor")),
                scale.unit,
                digits.significant(r.get("chi2_reduced"), 3),
                digits.percent(r.get("coverage_90")),
            ]
        )
    return _table(head, rows, "llrrrlrr", width)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], sides: str, width: int) -> list[str]:
    """Columns set side by side; the first is shortened, in its middle, until the rest fits."""
    cells = [[digits.ascii_text(c) for c in row] for row in (head, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(head))]
    room = width - sum(widths[1:]) - len(_GAP) * (len(head) - 1)
    widths[0] = min(widths[0], max(room, 8))
    lines = []
    for row in cells:
        shown = [_short(row[0], widths[0]), *row[1:]]
        padded = [c.ljust(w) if s == "l" else c.rjust(w) for c, w, s in zip(shown, widths, sides, strict=False)]
        lines.append(_GAP.join(padded))
    # a unit or a number that is absurdly long must not break the promise
    return [line[:width] for line in lines]


def _short(text: str, width: int) -> str:
    if len(text) <= width:
        return text
    head = (width - 2) // 2
    return text[:head] + ".." + text[len(text) - (width - 2 - head) :]

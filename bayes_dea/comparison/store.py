"""What a comparison leaves in its folder, and what it prints at its end."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import Any

from ..results import write_json
from .run import Comparison
from .words import percent

COMPARISON_FILE = "comparison.json"
REPORT_FILE = "report.html"


def save_comparison(result: Comparison, out: Path) -> Path:
    """Write comparison.json and report.html into a folder; returns it."""
    from ..report.comparison_page import write_comparison_page

    out.mkdir(parents=True, exist_ok=True)
    write_json(out / COMPARISON_FILE, result.summary)
    write_comparison_page(out)
    return out


def terminal_summary(summary: dict[str, Any]) -> str:
    """The answer and the ranking in at most 80 columns."""
    lines = textwrap.wrap(summary["statement"], 78)
    lines += ["", f"{'model':<30} {'probability':>12} {'log evidence':>14} {'ELPD':>17}"]
    top = summary["ranking"][0]["log_evidence"]
    for e in summary["ranking"]:
        lines.append(
            f"{_cut(e['model'], 30):<30} {percent(e['probability']):>12} "
            f"{_relative(e['log_evidence'] - top, e['log_evidence_se']):>14} "
            f"{_relative(e['elpd_diff'], e['elpd_diff_se']):>17}"
        )
    lines += ["(log evidence and ELPD less those of the best)"]
    for p in summary["partners"]:
        lines += textwrap.wrap(f"Same function: {p['model']} = {p['same_as']}: {p['why']}.", 78,
                               subsequent_indent="  ")
    for q in summary["questions"]:
        lines += ["", *textwrap.wrap(f"{q['question']} {q['text']}", 78, subsequent_indent="  ")]
    for note in summary["notes"]:
        lines += ["", *textwrap.wrap(f"Note: {note}", 78, subsequent_indent="  ")]
    for warning in summary["warnings"]:
        lines += textwrap.wrap(f"Warning: {warning}", 78, subsequent_indent="  ")
    return "\n".join(lines)


def _cut(text: str, n: int) -> str:
    return text if len(text) <= n else text[: n - 3] + "..."


def _relative(value: float, se: float) -> str:
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 1000:
        return f"{value:,.0f}" + (f" +- {se:,.0f}" if math.isfinite(se) and se >= 1 else "")
    return f"{value:.1f}" + (f" +- {se:.1f}" if math.isfinite(se) else "")

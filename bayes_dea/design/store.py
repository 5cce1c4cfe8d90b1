"""What a proposal leaves in its folder, and what it prints at its end."""

from __future__ import annotations

import shutil
import textwrap
from pathlib import Path
from typing import Any

from ..experiments.costs import COSTS_FILE, costs_toml
from ..experiments.words import settings_in_words
from ..prediction.result import write_table
from ..results import write_json, write_text
from .propose import Proposals

NEXT_FILE = "next.json"
FOLDER = "next"
REPORT_FILE = "report.html"


def save_proposals(result: Proposals, out: Path, report: bool = True) -> Path:
    """Write next/*.csv (time_s, voltage_V or position_m), next/costs.toml, next.json and report.html."""
    shutil.rmtree(out / FOLDER, ignore_errors=True)  # commands of an earlier run would pass for proposals of this one
    s = result.summary
    pairs = [*zip(s["ranking"], result.ranking, strict=True), *zip(s["plan"]["experiments"], result.plan, strict=True)]
    for entry, proposal in pairs:
        if entry["file"] is not None and not (out / entry["file"]).exists():
            time_s, values = proposal.experiment.full()
            write_table(out / entry["file"], {"time_s": time_s, proposal.experiment.column: values})
    write_text(out / FOLDER / COSTS_FILE, costs_toml(result.costs))
    write_json(out / NEXT_FILE, s)
    if report:
        from ..report.next_page import write_next_page

        write_next_page(out)
    return out


def terminal_summary(summary: dict[str, Any], rows: int = 12) -> str:
    """The answer and the ranking in at most 80 columns."""
    lines = textwrap.wrap(summary["statement"], 78)
    lines += ["", f"{'experiment':<44} {'nats':>13} {'minutes':>8} {'nats/h':>9}"]
    for e in of_patterns(summary["ranking"], rows):
        lines.append(f"{_line(e['experiment'])[:44]:<44} {_nats(e):>13} {e['cost_s'] / 60:>8.1f} "
                     f"{e['gain_per_hour']:>9.3g}")
    lines.append(f"(the best two of each kind, of {len(summary['ranking'])} experiments)")
    plan = summary["plan"]["experiments"]
    if len(plan) > 1:
        lines += ["", "Plan:"]
        lines += [f"{i}. {_line(e['experiment'])[:60]:<60} {_nats(e):>13}" for i, e in enumerate(plan, 1)]
    for warning in summary["warnings"]:
        lines += textwrap.wrap(f"Warning: {warning}", 78, subsequent_indent="  ")
    return "\n".join(lines)


def of_patterns(ranking: list[dict[str, Any]], most: int, each: int = 2) -> list[dict[str, Any]]:
    """The first `each` of every pattern, in the order of the ranking."""
    count: dict[str, int] = {}
    out = []
    for e in ranking:
        key = e["experiment"].get("pattern", e["experiment"]["kind"])
        count[key] = count.get(key, 0) + 1
        if count[key] <= each:
            out.append(e)
    return out[:most]


def _nats(e: dict[str, Any]) -> str:
    return f"{e['expected_information_gain_nats']:.2f} +- {e['se']:.2f}"


def _line(e: dict[str, Any]) -> str:
    return f"{e.get('pattern', e['kind'])} {settings_in_words(e, brief=True, plus_minus='+-')}"

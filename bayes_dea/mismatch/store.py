"""What a diagnosis leaves in its folder, and what it prints at its end."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..experiments.words import recording_in_words
from ..results import not_said, write_bytes, write_json
from .diagnosis import Diagnosis
from .pictures import picture_data

DIAGNOSIS_FILE = "diagnosis.json"
DATA_FILE = "diagnosis.npz"
REPORT_FILE = "report.html"
_WIDTH = 80


def save_diagnosis(
    result: Diagnosis, out: Path, report: Callable[[float, float, str], None] | None = None
) -> Path:
    """Write diagnosis.json and report.html into a folder; returns it."""
    from ..report.diagnosis_page import write_diagnosis_page

    out.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **picture_data(result))  # type: ignore[arg-type]
    write_bytes(out / DATA_FILE, buffer.getvalue())
    write_json(out / DIAGNOSIS_FILE, result.summary)
    write_diagnosis_page(out, report)
    return out


def terminal_summary(summary: dict[str, Any]) -> str:
    """The verdict in at most 80 columns."""
    lines = [f"Verdict: {summary['verdict']} (confidence {summary['confidence']:.2f})", ""]
    lines += textwrap.wrap(summary["statement"], 78)
    lines.append("")
    for h in summary["hypotheses"][:5]:
        line = f"  {h['name'][:34]:<34} {h['probability']:8.2%}"
        for k, v in h["parameters"].items():
            more = f"{',' if '+-' in line else ' '} {k} {v['mean']:.3g} +- {v['sd']:.2g}"
            if len(line + more) > _WIDTH:
                break  # half a number is another number
            line += more
        lines.append(line)
    ask = summary["next_experiment"]
    if ask.get("recording"):
        what = recording_in_words(ask["recording"], "+-")
        lines += ["", *textwrap.wrap(f"Next experiment: {what}; {ask['why']}", 78)]
    for warning in not_said(summary):
        lines += textwrap.wrap(f"Warning: {warning}", 78, subsequent_indent="  ")
    return "\n".join(lines)

"""What a diagnosis leaves in its folder, and what it prints at its end."""

from __future__ import annotations

import io
import shlex
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..experiments.words import recording_in_words
from ..results import json_bytes, not_said, write_all_bytes
from .diagnosis import Diagnosis
from .pictures import picture_data
from .search.hypotheses import UNKNOWN

DIAGNOSIS_FILE = "diagnosis.json"
DATA_FILE = "diagnosis.npz"
REPORT_FILE = "report.html"
_WIDTH = 80
#: probability from which on an explanation that is not the first is shown
_WORTH_A_LINE = 5e-4


def save_diagnosis(
    result: Diagnosis, out: Path, report: Callable[[float, float, str], None] | None = None
) -> Path:
    """Write diagnosis.json and report.html into a folder; returns it."""
    from ..report.diagnosis_page import write_diagnosis_page

    out.mkdir(parents=True, exist_ok=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **picture_data(result))  # type: ignore[arg-type]
    write_all_bytes({out / DATA_FILE: buffer.getvalue(), out / DIAGNOSIS_FILE: json_bytes(result.summary)})
    write_diagnosis_page(out, report)
    return out


def terminal_summary(summary: dict[str, Any]) -> str:
    """The verdict in at most 80 columns."""
    lines = [f"Verdict: {summary['verdict']} (confidence {summary['confidence']:.2f})", ""]
    lines += textwrap.wrap(summary["statement"], 78)
    lines.append("")
    # of what is unknown the best partial explanation has numbers to be read, however improbable it is
    first = 2 if summary["verdict"] == UNKNOWN else 1
    for k, h in enumerate(summary["hypotheses"][:5]):
        if k < first or h["probability"] >= _WORTH_A_LINE:
            lines += _hypothesis(h)
    ask = summary["next_experiment"]
    if ask.get("recording"):
        what = recording_in_words(ask["recording"], "+-")
        lines += ["", *textwrap.wrap(f"Next experiment: {what}; {ask['why']}", 78)]
    command = summary.get("next_command")
    if command:
        lines += ["", "To go on with it:", *_command(command)]
    for warning in not_said(summary):
        lines += textwrap.wrap(f"Warning: {warning}", 78, subsequent_indent="  ")
    return "\n".join(lines)


def _command(command: str) -> list[str]:
    """A command over lines that a shell joins again."""
    kept = " ".join(shlex.quote(word).replace(" ", "\0") for word in shlex.split(command))
    lines = textwrap.wrap(kept, _WIDTH - 6, break_long_words=False, break_on_hyphens=False)
    lines = [line.replace("\0", " ") for line in lines]
    return [f"  {line}{end}" for line, end in zip(lines, [" \\"] * (len(lines) - 1) + [""], strict=True)]


def _hypothesis(h: dict[str, Any]) -> list[str]:
    """Probability, name and parameters, these below where a line does not hold all."""
    line = f"  {h['probability']:8.2%}  {h['name']}"
    values = ", ".join(f"{k} {v['mean']:.3g} +- {v['sd']:.2g}" for k, v in h["parameters"].items())
    if len(line) + 2 + len(values) <= _WIDTH:
        return [f"{line}  {values}".rstrip()]
    # a number stands with its name and its error
    kept = [v.replace(" ", "\0") for v in values.split(", ")]
    room = " " * 12
    below = textwrap.wrap(
        ", ".join(kept), _WIDTH, initial_indent=room, subsequent_indent=room, break_on_hyphens=False
    )
    return [line, *(text.replace("\0", " ") for text in below)]

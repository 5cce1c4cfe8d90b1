"""The command that goes on from a diagnosis."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from .search.hypotheses import UNKNOWN


def calibrate_command(summary: Mapping[str, Any]) -> str:
    """`bayes-dea calibrate` of the corrected model with its priors; empty where nothing was named that corrects it."""
    if summary["verdict"] == UNKNOWN or summary["corrected_model"] == summary["model"]:
        return ""
    words = ["bayes-dea", "calibrate", "CAMPAIGN", "--model", summary["corrected_model"]]
    for name, prior in (summary.get("corrected_priors") or {}).items():
        words += ["--prior", f"{name}={prior}"]
    return shlex.join([*words, "--out", "corrected"])

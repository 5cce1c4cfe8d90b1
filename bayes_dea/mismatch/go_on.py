"""The command that goes on from a diagnosis."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..priors import RELATIVE
from .search.hypotheses import UNKNOWN


def calibrate_command(
    summary: Mapping[str, Any], campaign: Sequence[str] = ("CAMPAIGN",), priors: Path | None = None
) -> str:
    """`bayes-dea calibrate` of the corrected model with its priors; empty where nothing was named that corrects it.

    campaign: the words that name it, with options that reading it takes. priors: the file that was given; it is named
    where it holds what --prior cannot say.
    """
    if summary["verdict"] == UNKNOWN or summary["corrected_model"] == summary["model"]:
        return ""
    words = ["bayes-dea", "calibrate", *campaign, "--model", summary["corrected_model"]]
    corrected = summary.get("corrected_priors") or {}
    relative = [name for name, prior in corrected.items() if RELATIVE in prior]
    if relative and priors is not None:
        words += ["--priors", str(priors)]
    for name, prior in corrected.items():
        if name not in relative:
            words += ["--prior", f"{name}={prior}"]
    return shlex.join([*words, "--out", "corrected"])

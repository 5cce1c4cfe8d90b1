"""What a run leaves in its folder while it works, so that it can be continued: a checkpoint named after the run."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import __version__
from .results import PARTIAL

_PREFIX = ".checkpoint-"


def checkpoint_for(folder: Path, identity: Mapping[str, Any]) -> Path:
    """Path of the sampler's checkpoint for this very run: same input, model, seed and settings, same name.

    Checkpoints of other runs are left alone: a slip in the command must not cost the hours of the run before.
    """
    text = json.dumps({**identity, "version": __version__}, sort_keys=True, default=str)
    return folder / f"{_PREFIX}{hashlib.sha256(text.encode()).hexdigest()[:20]}.npz"


def finished(folder: Path, keep: Path | None = None) -> None:
    """The results are written: checkpoints go, and what killed runs left behind; `keep` stays for a longer run."""
    for pattern in (f"{_PREFIX}*.npz", f"{PARTIAL}*"):
        for path in folder.glob(pattern):
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            elif path != keep:
                path.unlink(missing_ok=True)

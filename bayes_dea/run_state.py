"""What a run leaves in its folder while it works, so that it can be continued: a checkpoint and what it belongs to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import __version__
from .results import write_atomic

_CHECKPOINT = ".checkpoint.npz"
_IDENTITY = ".run.json"


def checkpoint_for(folder: Path, identity: Mapping[str, Any]) -> Path:
    """Path of the sampler's checkpoint for this very run; one that belongs to another run is thrown away."""
    text = json.dumps({**identity, "version": __version__}, sort_keys=True, default=str)
    key = hashlib.sha256(text.encode()).hexdigest()
    checkpoint, marker = folder / _CHECKPOINT, folder / _IDENTITY
    if not (marker.is_file() and marker.read_text(encoding="utf-8").strip() == key):
        checkpoint.unlink(missing_ok=True)
        write_atomic(marker, lambda p: p.write_text(key + "\n", encoding="utf-8"))
    return checkpoint


def finished(folder: Path) -> None:
    """The results are written: nothing is left to continue."""
    for name in (_CHECKPOINT, _IDENTITY):
        (folder / name).unlink(missing_ok=True)

"""Writing results: atomic files, JSON without NaN, hashes of what was read."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BayesDEAError


def plain(value: Any) -> Any:
    """A structure of plain JSON types; numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return [plain(v) for v in value.tolist()]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (date, datetime, Path)):
        return str(value)
    return value


#: how the names of temporary files begin: what a killed run left can be told from everything else
PARTIAL = ".part-"


def write_atomic(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, then put it in place; a kill leaves old or new, never half.

    The file has reached the disk before it takes its name. Raises BayesDEAError naming `path` where it cannot be
    written (a full disk, a folder that may not be written to); what was there before is then untouched.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=PARTIAL, suffix=f"-{path.name}")
        os.close(handle)
    except OSError as error:
        raise unwritable(path, error) from error
    temporary = Path(name)
    try:
        write(temporary)
        os.chmod(temporary, 0o644)
        _to_disk(temporary)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise unwritable(path, error) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    with contextlib.suppress(OSError):  # not every file system knows this of folders
        _to_disk(path.parent)


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def unwritable(path: Path, error: OSError) -> BayesDEAError:
    """What to raise where a file could not be written: it names the file and, for a full disk, what to do."""
    remedy = ""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        remedy = "; make room there and call it again, or choose another folder"
    return BayesDEAError(f"{path}: cannot be written: {error.strerror or error}{remedy}")


def write_bytes(path: Path, content: bytes) -> None:
    """A binary file, atomically."""
    write_atomic(path, lambda p: p.write_bytes(content))


def write_text(path: Path, content: str) -> None:
    """A text file in UTF-8 with its line ends as they are, atomically."""
    write_bytes(path, content.encode("utf-8"))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """JSON file, atomically."""
    text = json.dumps(plain(content), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file as a dictionary."""
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def not_said(summary: Mapping[str, Any]) -> list[str]:
    """Warnings of a summary that its statement does not say already; there a sentence begins with a capital letter."""
    return [str(w) for w in summary["warnings"] if str(w)[1:] not in str(summary["statement"])]

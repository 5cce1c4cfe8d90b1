"""Writing results: atomic files, JSON without NaN, hashes of what was read."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping
from datetime import date, time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .errors import BayesDEAError, InputError


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
    if isinstance(value, (date, time, Path)):  # TOML has times of day, dates and both in one
        return str(value)
    return value


#: how the names of temporary files begin: what a killed run left can be told from everything else
PARTIAL = ".part-"


def write_atomic(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file beside `path`, then put it in place; a kill leaves old or new, never half.

    The file has reached the disk before it takes its name. Raises BayesDEAError naming `path` where it cannot be
    written (a full disk, a folder that may not be written to); what was there before is then untouched.
    """
    write_together({path: write})


def write_together(files: Mapping[Path, Callable[[Path], object]]) -> None:
    """The same for files that belong together: all have reached the disk before the first takes its name.

    They take their names in the order given. Raises as `write_atomic` does; none is replaced where one cannot be
    made.
    """
    temporary: dict[Path, Path] = {}
    path = Path()
    try:
        for path, write in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=PARTIAL, suffix=f"-{path.name}")
            temporary[path] = Path(name)
            os.close(handle)
            write(temporary[path])
            os.chmod(temporary[path], 0o644)
            _to_disk(temporary[path])
        for path, made in temporary.items():
            os.replace(made, path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:  # of those that were put in place nothing is left to remove
        for made in temporary.values():
            made.unlink(missing_ok=True)
    for folder in {path.parent for path in files}:
        with contextlib.suppress(OSError):  # not every file system knows this of folders
            _to_disk(folder)


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
    write_bytes(path, json_bytes(content))


def json_bytes(content: Mapping[str, Any]) -> bytes:
    """A JSON file's content, as `plain` makes it."""
    return (json.dumps(plain(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode("utf-8")


def write_all_bytes(files: Mapping[Path, bytes]) -> None:
    """Files that belong together, whole or not at all, in the order given. Raises as `write_together` does."""
    write_together({path: partial(_fill, content) for path, content in files.items()})


def _fill(content: bytes, path: Path) -> None:
    path.write_bytes(content)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON file as a dictionary. Raises OSError where it cannot be read, ValueError where it is not an object."""
    content = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise ValueError(f"{path.name} holds no object of names and values")
    return content


def unreadable(path: Path, error: Exception, what: str, remedy: str) -> InputError:
    """What to raise where a result cannot be read; one that may not be read is whole, and asks for no new run.

    what: it was to be, e.g. "read as a posterior"; remedy: what to do about a file that is damaged.
    """
    if isinstance(error, PermissionError):
        return InputError(f"{path}: may not be read ({os.strerror(errno.EACCES)}); change its permissions, or call "
                          "this as who owns it")
    return InputError(f"{path}: cannot be {what} ({error}); {remedy}")


def not_said(summary: Mapping[str, Any]) -> list[str]:
    """Warnings of a summary that its statement does not say already; there a sentence begins with a capital letter."""
    return [str(w) for w in summary["warnings"] if str(w)[1:] not in str(summary["statement"])]

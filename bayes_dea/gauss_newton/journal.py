"""What a diagnosis has worked out so far, as lines of a file: interrupted, it goes on from there.

Kept are ends of descents and values of points tried, under a digest of all that they were worked out from. Everything
else is cheap, or follows from these to the last digit.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..results import unwritable


class Journal:
    """Values by key, in the file `path` or (None) nowhere."""

    def __init__(self, path: Path | None = None) -> None:
        """What is in the file already is known; a line that was cut off ends it.

        Raises OSError where it cannot be read, BayesDEAError where it cannot be written.
        """
        self._known: dict[str, Any] = {}
        self._file: IO[str] | None = None
        self._path = path
        if path is None:
            return
        whole = 0
        if path.exists():
            for line in path.read_bytes().splitlines(keepends=True):
                try:
                    key, value = json.loads(line)
                    ended = line.endswith(b"\n")
                except (ValueError, TypeError):
                    break
                if not ended:
                    break
                self._known[key] = value
                whole += len(line)
        try:
            self._file = path.open("r+" if path.exists() else "w", encoding="utf-8")
        except OSError as error:
            raise unwritable(path, error) from error
        self._file.truncate(whole)
        self._file.seek(whole)

    @property
    def kept(self) -> bool:
        """Whether anything is kept."""
        return self._file is not None

    def __contains__(self, key: str) -> bool:
        return key in self._known

    def __getitem__(self, key: str) -> Any:
        return self._known[key]

    def put(self, key: str, value: Any) -> None:
        """Add a value of plain types. Raises BayesDEAError where the file cannot be written."""
        if self._file is None or self._path is None:
            return
        self._known[key] = value
        # numbers keep all their digits in JSON; what is not finite is read again by the same reader
        try:
            self._file.write(json.dumps([key, value]) + "\n")
            self._file.flush()
        except OSError as error:
            with contextlib.suppress(OSError):  # it would write the rest of the line once more
                self.close()
            raise unwritable(self._path, error) from error

    def close(self) -> None:
        """No more is kept."""
        file, self._file = self._file, None
        if file is None:
            return
        file.close()
        if self._path is not None and not self._known:  # refused before anything was worked out
            with contextlib.suppress(OSError):
                self._path.unlink()


def digest(*parts: Any) -> str:
    """Key of numbers, texts, arrays, mappings and sequences of these."""
    h = hashlib.blake2b(digest_size=16)

    def add(x: Any) -> None:
        if isinstance(x, np.ndarray):
            h.update(f"a{x.dtype}{x.shape}".encode())
            h.update(np.ascontiguousarray(x).tobytes())
        elif isinstance(x, Mapping):
            add([(k, x[k]) for k in sorted(x)])
        elif isinstance(x, (list, tuple)):
            h.update(f"l{len(x)}".encode())
            for v in x:
                add(v)
        elif isinstance(x, float):  # of any make
            h.update(float(x).hex().encode())
        else:
            h.update(f"{type(x).__name__}:{x!r};".encode())

    add(parts)
    return h.hexdigest()

"""Room for columns that are longer than memory should hold: files in a temporary folder, mapped into memory.

Such a file has no name any more once it is open, so nothing is left of it when the process ends, by whatever: done,
Ctrl-C, or killed. The operating system keeps in memory what is being looked at, and writes the rest to the file.
"""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.errors import BayesDEAError, InputError

#: rows that are looked at or changed at a time, 2 MB of float64
PIECE = 1 << 18
#: the same where sums are taken, so that the last digits of a recording depend on the cut only where it is longer
BLOCK = 1 << 20
_BYTES = 8  # of a float64


@dataclass(frozen=True)
class ScratchSettings:
    """folder: where scratch files are made (None: the system's temporary folder, TMPDIR).

    memory_bytes: columns of a campaign up to this size stay in memory; what comes beyond goes to scratch files.
    """

    folder: Path | None = None
    memory_bytes: int = 256 * 2**20


def pieces(n: int, rows: int = PIECE) -> Iterator[slice]:
    """Slices that cover 0..n in order, of at most `rows` each."""
    for begin in range(0, n, rows):
        yield slice(begin, min(begin + rows, n))


class Scratch:
    """The room of one campaign: so many bytes in memory, shared by all of its readers, then files."""

    def __init__(self, settings: ScratchSettings | None = None) -> None:
        s = settings or ScratchSettings()
        self.folder = s.folder
        self._left = s.memory_bytes
        self._lock = threading.Lock()
        if s.folder is not None and not s.folder.is_dir():
            raise InputError(f"--scratch {s.folder}: there is no such folder; make it, or choose another.")

    def take(self, size: int) -> bool:
        """Whether `size` bytes more may be held in memory; they count from then on."""
        with self._lock:
            if size > self._left:
                return False
            self._left -= size
            return True

    def give_back(self, size: int) -> None:
        """Bytes that were taken and are not held any more."""
        with self._lock:
            self._left += size

    def file(self) -> IO[bytes]:
        """A new scratch file. Raises BayesDEAError where none can be made."""
        try:
            return tempfile.TemporaryFile(dir=self.folder, prefix="bayes-dea-", buffering=0)
        except OSError as error:
            raise self.failed(error) from error

    def failed(self, error: OSError) -> BayesDEAError:
        """The error for a scratch file that cannot be written."""
        where = self.folder if self.folder is not None else tempfile.gettempdir()
        return BayesDEAError(f"{where}: the recordings are longer than memory is to hold, and their columns cannot be "
                             f"kept there meanwhile: {error.strerror or error}. Make room there, or choose another "
                             "folder with --scratch DIR.")


class _Map(mmap.mmap):
    """A mapped scratch file that knows its folder, so that columns made from it find theirs (`beside`)."""

    folder: Path | None


def _mapped(file: IO[bytes], n: int, dtype: np.dtype[Any], folder: Path | None) -> NDArray[Any]:
    mapped = _Map(file.fileno(), n * dtype.itemsize)
    mapped.folder = folder
    return np.frombuffer(mapped, dtype, n)


def scratch_of(values: NDArray[Any]) -> Scratch | None:
    """Where the file of an array lies, as room for others like it; None for an array in memory."""
    at: Any = values
    while isinstance(at, np.ndarray):
        at = at.base
    if isinstance(at, memoryview):
        at = at.obj
    return Scratch(ScratchSettings(at.folder, 0)) if isinstance(at, _Map) else None


def beside(column: NDArray[Any], dtype: Any = np.float64, n: int | None = None) -> NDArray[Any]:
    """An array of zeros of the length of `column` (or n), in a scratch file where that column is in one.

    Raises BayesDEAError where that file cannot be written.
    """
    n = column.size if n is None else n
    room = scratch_of(column)
    kind = np.dtype(dtype)
    if room is None or n == 0:
        return np.zeros(n, kind)
    with room.file() as file:
        try:
            # the whole file now: a disk that is full must say so here, not when a page of it is touched
            if sys.platform == "linux":
                os.posix_fallocate(file.fileno(), 0, n * kind.itemsize)
            else:
                for part in pieces(n * kind.itemsize, PIECE * _BYTES):
                    _write(file, np.zeros(part.stop - part.start, np.uint8))
        except OSError as error:
            raise room.failed(error) from error
        return _mapped(file, n, kind, room.folder)


def computed(function: Callable[..., ArrayLike], *columns: NDArray[Any], dtype: Any = np.float64) -> NDArray[Any]:
    """`function` of columns (n,), row by row, taken piece by piece; where the first is in a scratch file, so is it."""
    out = beside(columns[0], dtype)
    for part in pieces(out.size):
        out[part] = function(*(c[part] for c in columns))
    return out


def copied(column: NDArray[Any]) -> NDArray[Any]:
    """A copy of a column (n,), in a scratch file where that is in one."""
    out = beside(column, column.dtype)
    out[:] = column
    return out


def all_finite(column: NDArray[np.float64]) -> bool:
    """Whether every cell of a column (n,) is finite."""
    return all(bool(np.isfinite(column[part]).all()) for part in pieces(column.size, BLOCK))


def kept(column: NDArray[Any], keep: NDArray[np.bool_]) -> NDArray[Any]:
    """The rows of a column (n,) for which `keep` (n,) holds; the column itself where all are."""
    n = int(np.count_nonzero(keep))
    if n == column.size:
        return column
    out = beside(column, column.dtype, n)
    at = 0
    for part in pieces(column.size, BLOCK):
        piece = column[part][keep[part]]
        out[at : at + piece.size] = piece
        at += piece.size
    return out


def rows_where(test: Callable[..., NDArray[np.bool_]], *columns: NDArray[Any]) -> NDArray[np.int64]:
    """Rows at which a test of columns (n,) holds, rising; held in memory, so of few rows only."""
    found = [part.start + np.flatnonzero(test(*(c[part] for c in columns))) for part in pieces(columns[0].size, BLOCK)]
    return np.concatenate(found) if found else np.empty(0, np.int64)


def numbered(keep: NDArray[np.bool_]) -> NDArray[np.int64]:
    """All rows at which a mask (n,) holds, rising; in a scratch file where the mask is in one."""
    out = beside(keep, np.int64, int(np.count_nonzero(keep)))
    at = 0
    for part in pieces(keep.size, BLOCK):
        rows = np.flatnonzero(keep[part])
        out[at : at + rows.size] = part.start + rows
        at += rows.size
    return out


def joined(*arrays: NDArray[Any]) -> NDArray[np.float64]:
    """Arrays one after the other; in a scratch file where one of them is in one."""
    room = next((a for a in arrays if scratch_of(a) is not None), arrays[0])
    out = beside(room, n=sum(a.size for a in arrays))
    at = 0
    for a in arrays:
        out[at : at + a.size] = a
        at += a.size
    return out


class Gathering:
    """Columns that come in pieces. They are held in memory while there is room, else in scratch files."""

    def __init__(self, columns: int, scratch: Scratch) -> None:
        self.rows = 0
        self._scratch = scratch
        self._held: list[list[NDArray[np.float64]]] = [[] for _ in range(columns)]
        self._taken = 0
        self._files: list[IO[bytes]] = []

    def __enter__(self) -> Gathering:
        return self

    def __exit__(self, failed: object, *_: object) -> None:
        if failed is not None and not self._files:
            self._scratch.give_back(self._taken)
        for file in self._files:
            file.close()

    def add(self, values: Sequence[ArrayLike]) -> None:
        """One piece (k,) of every column. Raises BayesDEAError where a scratch file cannot be written."""
        arrays = [np.ascontiguousarray(v, dtype=np.float64) for v in values]
        size = sum(a.nbytes for a in arrays)
        self.rows += arrays[0].size
        if not self._files and self._scratch.take(size):
            self._taken += size
            for held, array, given in zip(self._held, arrays, values, strict=True):
                # what is a view of a reader's piece would keep all of that piece
                held.append(array.copy() if array is given or array.base is not None else array)
            return
        try:
            if not self._files:
                self._files = [self._scratch.file() for _ in arrays]
                for file, held in zip(self._files, self._held, strict=True):
                    for array in held:
                        _write(file, array)
                    held.clear()
                self._scratch.give_back(self._taken)
            for file, array in zip(self._files, arrays, strict=True):
                _write(file, array)
        except OSError as error:
            raise self._scratch.failed(error) from error

    def columns(self) -> list[NDArray[np.float64]]:
        """The columns (n,), writable."""
        if self._files:
            kind = np.dtype(np.float64)
            return [_mapped(file, self.rows, kind, self._scratch.folder) for file in self._files]
        out = []
        for held in self._held:
            column = np.empty(self.rows)
            at = 0
            while held:
                piece = held.pop(0)
                column[at : at + piece.size] = piece
                at += piece.size
            out.append(column)
        return out


def _write(file: IO[bytes], array: NDArray[Any]) -> None:
    left = memoryview(np.ascontiguousarray(array).view(np.uint8).data)
    while left:
        left = left[file.write(left) :]

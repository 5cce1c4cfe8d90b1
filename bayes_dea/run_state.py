"""What a run leaves in its folder while it works: a checkpoint to continue from, and a lock that keeps others out."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from . import __version__
from .errors import InputError
from .results import PARTIAL

_PREFIX = ".checkpoint-"
LOCK_FILE = ".lock"


@dataclass(frozen=True)
class Checkpoints:
    """A folder for checkpoints, which notes in `own` those that one run asked for: it alone may take them away."""

    folder: Path
    own: list[Path] = field(default_factory=list)


def checkpoint_for(folder: str | Path | Checkpoints, identity: Mapping[str, Any]) -> Path:
    """Path of the sampler's checkpoint for this very run: same input, model, seed and settings, same name.

    Checkpoints of other runs are left alone: a slip in the command must not cost the hours of the run before.
    """
    text = json.dumps({**identity, "version": __version__}, sort_keys=True, default=str)
    name = f"{_PREFIX}{hashlib.sha256(text.encode()).hexdigest()[:20]}.npz"
    if not isinstance(folder, Checkpoints):
        return Path(folder) / name
    folder.own.append(folder.folder / name)
    return folder.own[-1]


def further(checkpoint: Path, k: int) -> Path:
    """Checkpoint of the k-th run that began again where the one of `checkpoint` had learned enough."""
    return checkpoint.with_name(f"{checkpoint.stem}_{k}{checkpoint.suffix}")


def discard(checkpoint: Path) -> None:
    """Take a checkpoint away, with those of the runs that began again from it."""
    for path in checkpoint.parent.glob(f"{checkpoint.stem}*{checkpoint.suffix}"):
        path.unlink(missing_ok=True)


def finished(folder: Path, own: Iterable[Path] = ()) -> None:
    """The results are written: the run's own checkpoints go, and half-written files that killed runs left behind.

    Those of other runs stay: a diagnosis that ends must not cost the hours of an interrupted calibration.
    """
    for checkpoint in own:
        discard(checkpoint)
    for path in folder.glob(f"{PARTIAL}*"):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def locked(folder: Path, what: str = "") -> Iterator[None]:
    """Nobody else writes into the folder meanwhile; it is made if it is not there, and goes again if it stays empty.

    The lock is one of the operating system on the file `.lock`, which ends with the process however that ends; the
    file says who holds it (pid, since when, `what`). A file that a killed run left is taken over. Raises InputError
    where another run holds it.
    """
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK_FILE
    handle = _lock(path, folder)
    try:
        with contextlib.suppress(OSError):  # on a full disk the lock holds all the same
            os.ftruncate(handle, 0)
            text = json.dumps({"pid": os.getpid(), "since": time.strftime("%Y-%m-%d %H:%M:%S"), "what": what})
            os.write(handle, text.encode())
        yield
    finally:
        with contextlib.suppress(OSError):  # unlinked first: who opens the name from now on gets a file of its own
            path.unlink()
        os.close(handle)
        if made:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _lock(path: Path, folder: Path) -> int:
    """An open file that this process alone has locked, under this very name."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            if not _try(handle):
                raise InputError(f"--out {folder}: another run is writing there ({_holder(path)}); wait for it to end, "
                                 "stop it, or choose another folder")
            # the one before may have removed the name between our opening it and locking it
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _try(handle: int) -> bool:
    """Whether the file could be locked; True, too, on a file system that knows no locks."""
    try:
        import fcntl
    except ImportError:  # Windows: an open file is locked by its first byte
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
            return False
        if error.errno not in (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP):
            raise
    return True


def _holder(path: Path) -> str:
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        return f"process {said['pid']}, {said['what']}, since {said['since']}".replace(", ,", ",")
    except (OSError, ValueError, KeyError, TypeError):
        return "it has only just begun"

"""What a live run leaves on disk while it runs: nothing is counted before it is here.

`session_N.csv` holds the valid samples of one clock of the device, as a recording of CONTRACT 1; it only ever grows.
`campaign.toml` makes a campaign of them, for every other verb. `bad_lines.txt` keeps what could not be trusted, with
the reason. A line that a kill has cut is taken off at the next start; it was never counted.
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import BayesDEAError, InputError
from ..results import write_bytes
from .learner import Session
from .setup import Bench

HEADER = b"time_s,voltage_V,displacement_m\n"
BAD_FILE = "bad_lines.txt"
#: how often what was written is pressed through to the disk (s)
_SYNC_S = 1.0


@dataclass
class Journal:
    """The files of a run in a folder."""

    folder: Path
    bench: Bench
    sessions: list[Session] = field(default_factory=list)
    bad_lines: int = 0
    last_bad: str = ""  # the last line that could not be read, and why
    _file: BinaryIO | None = None
    _bad: BinaryIO | None = None
    _synced: float = 0.0

    def path(self, number: int) -> Path:
        """File of a session."""
        return self.folder / f"session_{number}.csv"

    # ------------------------------------------------------------ what is there
    def recover(self) -> list[tuple[Session, NDArray[np.float64]]]:
        """Sessions and rows (n, 3) of a run that ended; what a kill cut is taken off the files.

        Raises InputError where the folder holds something else.
        """
        import tomllib

        out = []
        toml = self.folder / "campaign.toml"
        entries = tomllib.loads(toml.read_text(encoding="utf-8")).get("recording", []) if toml.exists() else []
        for number, entry in enumerate(entries, start=1):
            path = self.path(number)
            if entry.get("file") != path.name:
                raise InputError(f"{toml}: is not the campaign of a live run; choose another --out")
            session = Session(number, bool(entry.get("zeroed", False)), float(entry.get("rest_before_s", 0.0)))
            self.sessions.append(session)
            out.append((session, _rows(path)))
        bad = self.folder / BAD_FILE
        if bad.exists():
            with bad.open("rb") as file:
                self.bad_lines = sum(not line.startswith(b"#") for line in file)
        if self.sessions:
            self._file = self._open(self.path(self.sessions[-1].number))
        return out

    def idle_s(self) -> float:
        """Time since the last sample was written."""
        if not self.sessions:
            return 0.0
        return max(0.0, time.time() - self.path(self.sessions[-1].number).stat().st_mtime)

    # ------------------------------------------------------------ what comes
    def begin(self, zeroed: bool, elapsed_s: float) -> Session:
        """A new session: its file, and its place in the campaign."""
        session = Session(len(self.sessions) + 1, zeroed, elapsed_s if self.sessions else 0.0)
        self.sync()
        if self._file is not None:
            self._file.close()
        _without_header(self.path(session.number))
        self._file = self._open(self.path(session.number))
        self._write(self._file, HEADER)
        self.sessions.append(session)
        self._campaign()
        return session

    def append(self, rows: Sequence[tuple[float, float, float]]) -> None:
        """Samples of the present session, handed to the operating system before this returns."""
        assert self._file is not None
        self._write(self._file, "".join(f"{t!r},{v!r},{y!r}\n" for t, v, y in rows).encode())
        if time.monotonic() - self._synced > _SYNC_S:
            self.sync()

    def reject(self, line: bytes, why: str, counted: bool = True) -> None:
        """A line that cannot be trusted."""
        if self._bad is None:
            self._bad = self._open(self.folder / BAD_FILE)
        self.bad_lines += counted
        if counted:
            self.last_bad = f"{line[:80].decode('ascii', 'replace')!r} ({why})"
        sign = "" if counted else "# "
        self._write(self._bad, f"{sign}{time.time():.3f}\t{why}\t{line[:500]!r}\n".encode())

    def sync(self) -> None:
        """Press what was written through to the disk."""
        self._synced = time.monotonic()
        if self._file is not None:
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                raise self._failed(error) from error

    def close(self) -> None:
        """Sync and close."""
        try:
            self.sync()
        finally:
            for file in (self._file, self._bad):
                if file is not None:
                    file.close()
            self._file = self._bad = None

    # ------------------------------------------------------------ inside
    def _open(self, path: Path) -> BinaryIO:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return path.open("ab", buffering=0)
        except OSError as error:
            raise self._failed(error) from error

    def _write(self, file: BinaryIO, data: bytes) -> None:
        try:
            while data:
                data = data[file.write(data) :]
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> BayesDEAError:
        return BayesDEAError(f"{self.folder}: samples cannot be written ({error.strerror or error}); what came until "
                             "now is there. Make room and go on with --resume.")

    def _campaign(self) -> None:
        import tomli_w

        kept = {k: v for k, v in self.bench.document.items() if k not in ("recording", "format", "share")}
        entries: list[dict[str, Any]] = []
        for s in self.sessions:
            entry: dict[str, Any] = {"file": self.path(s.number).name, "kind": "voltage", "role": "identify"}
            if s.zeroed:
                entry["zeroed"] = True
            if s.number > 1:
                entry |= {"rested": False, "rest_before_s": s.elapsed_s}
            entries.append(entry)
        write_bytes(self.folder / "campaign.toml", tomli_w.dumps({**kept, "recording": entries}).encode())


def set_aside(folder: Path) -> Path | None:
    """Move a run's files into `folder`/before_N: samples are measurements, and nothing deletes them. None: no run.

    Lines that could not be read are a run, too: a new one would count them as its own.
    """
    found = [p for pattern in ("session_*.csv", "campaign.toml", BAD_FILE, "live.json", "posterior.nc")
             for p in sorted(folder.glob(pattern))]
    if not any(p.name.startswith("session_") or p.name == BAD_FILE for p in found):
        return None
    number = 1
    while (folder / f"before_{number}").exists():
        number += 1
    aside = folder / f"before_{number}"
    aside.mkdir()
    for path in found:
        path.rename(aside / path.name)
    return aside


def _without_header(path: Path) -> None:
    """Empty a file that a run killed before it stood in the campaign left: it holds a header, or a part of one.

    Raises InputError where it holds more.
    """
    if not path.exists():
        return
    if not HEADER.startswith(path.read_bytes().replace(HEADER, b"")):
        raise InputError(f"{path}: holds samples that {path.with_name('campaign.toml')} knows nothing of; move it away")
    os.truncate(path, 0)


def _rows(path: Path) -> NDArray[np.float64]:
    """Rows (n, 3) of a session's file, whose cut end is taken off. Raises InputError where a row cannot be read."""
    if not path.exists():
        return np.empty((0, 3))
    with path.open("rb+") as file:
        content = file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            file.truncate(whole)
    if not content.startswith(HEADER):
        if whole:
            raise InputError(f"{path}: is not the file of a live session; choose another --out")
        path.write_bytes(HEADER)
        return np.empty((0, 3))
    body = content[len(HEADER) : whole]
    while body.startswith(HEADER):  # earlier versions wrote a second one where they were killed after the first
        body = body.removeprefix(HEADER)
        write_bytes(path, HEADER + body)
    if not body:
        return np.empty((0, 3))
    try:
        return np.loadtxt(body.decode("ascii").splitlines(), delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: {error}; it was changed after it was written. Take that row out") from error

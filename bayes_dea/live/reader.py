"""The thread that reads the port: verifies lines, keeps all of them on disk, and connects again after a break."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import BayesDEAError, InputError
from .journal import Journal
from .learner import Session
from .lines import LineFormat, format_of_header, header_columns, own_format, parse_sample

#: a word to the device at least so often: after two seconds of silence it ramps the voltage down
_KEEPALIVE_S = 0.5
#: without a sample for so long, the device is asked to start again: it may have been reset
_SILENCE_S = 1.0
_READ_S = 0.05
#: a header after so long without a sample was not asked for
_BOOT_SILENCE_S = 0.2
#: device and world may differ by this share about how long a silence was
_ALIKE = 0.25
#: the longest line that is waited for
_LONGEST = 4096


def _there() -> str:
    """The serial ports of this machine, for who has mistyped one."""
    from serial.tools.list_ports import comports

    names = sorted(port.device for port in comports())
    return f" Here are {', '.join(names)}." if names else " No serial port is to be seen here."


@dataclass(frozen=True)
class Batch:
    """Samples (n, 3) of one session that were on disk at `arrived` (s, monotonic clock)."""

    session: Session
    rows: NDArray[np.float64]
    arrived: float


class Reader(threading.Thread):
    """Reads `url` (anything that pyserial opens) until `finish`.

    zeroed: the sensor is zeroed first, and samples count from `count` on. Samples go to `batches`, answers (OK ..,
    ERR ..) to `answers`. `lost`: set at the first lost connection, never cleared. `ended`: the device's programme has
    come to its end. `error`: what ended the thread. `foreign`: the device is of another make; what is not told to it,
    it does not do.
    """

    def __init__(self, url: str, baud: int, form: LineFormat | None, journal: Journal, zeroed: bool = False,
                 patience_s: float = 30.0, last_time_s: float | None = None) -> None:
        super().__init__(name="live reader", daemon=True)
        self.url, self.baud, self.journal, self.patience_s = url, baud, journal, patience_s
        self.form = form or own_format()
        self.foreign = form is not None
        self.zeroed = zeroed
        self._counts = not zeroed  # a device that streams by itself shows its old zero until it is told
        self.batches: queue.SimpleQueue[Batch] = queue.SimpleQueue()
        self.answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.ended, self.lost, self._finish = threading.Event(), threading.Event(), threading.Event()
        self.error: BaseException | None = None
        self.connects = 0
        self.time_s = -np.inf if last_time_s is None else last_time_s  # of the device, last sample
        self.sample_at = time.monotonic()  # when the last sample came
        self.wanted = False  # whether the device ought to stream
        self.driven = False  # whether we command it
        self._session = journal.sessions[-1] if journal.sessions else None
        self._elapsed_before = journal.idle_s()
        self._pending: tuple[float, float, float] | None = None
        self._buffer = b""
        self._fragment = True
        self._booted = False
        self._step_s = 0.0  # between the last two samples
        self._opened_at = self._broken_at = time.monotonic()
        self._lock = threading.Lock()
        self._port = self._open(first=True)

    # ------------------------------------------------------------ for others
    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def say(self, words: str) -> bool:
        """Send one line; False where it did not go out: the connection is broken, or takes nothing."""
        with self._lock:
            if self._port is None:
                return False
            try:
                self._port.write(words.encode("ascii") + b"\n")
                return True
            except (OSError, ValueError):  # pyserial's errors are OSErrors
                return False

    def ask(self, words: str, timeout_s: float = 2.0) -> str:
        """Send one line and wait for its answer. Raises BayesDEAError where the device refuses or keeps silent.

        A device of another make is not expected to answer.
        """
        while not self.answers.empty():
            self.answers.get()
        if not self.say(words):
            raise BayesDEAError(f"{self.url}: the connection broke as '{words}' was sent")
        if self.foreign:
            return ""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until and self.error is None:
            try:
                answer = self.answers.get(timeout=0.05)
            except queue.Empty:
                continue
            said = answer.split(" ", 2)
            if said[0] == "ERR":
                raise BayesDEAError(f"the device refuses '{words}': {answer}")
            if len(said) > 1 and words.startswith(said[1]):
                return answer
        raise BayesDEAError(f"{self.url}: no answer to '{words}' within {timeout_s:g} s; is it the right port and baud "
                            "rate?")

    def count(self) -> None:
        """Samples count from now on. Until then those of a reader that was told `zeroed` are passed over."""
        self._counts = True

    def finish(self) -> None:
        """End the thread and close the port."""
        self._finish.set()
        if self.is_alive():
            self.join(timeout=5.0)
        self._close()

    # ------------------------------------------------------------ the thread
    def run(self) -> None:
        """See the class."""
        try:
            said = time.monotonic()
            while not self._finish.is_set():
                if self._port is None and not self._again():
                    continue
                try:
                    data = self._read()
                except (OSError, TypeError, AttributeError):  # unplugged, or closed by another thread
                    self._break()
                    continue
                now = time.monotonic()
                if data:
                    self._take(data, now)
                if self.form.ask and now - said > _KEEPALIVE_S:
                    said = now
                    self.say(self.form.ask)
                if self.wanted and self.form.start and now - self.sample_at > _SILENCE_S:
                    self.sample_at = now  # one attempt a second
                    self.say(self.form.start)
        except BaseException as error:
            self.error = error

    def _open(self, first: bool = False):  # type: ignore[no-untyped-def]
        import serial

        address = self.url.removeprefix("socket://")
        if first and address != self.url and not address.rpartition(":")[2].split("?")[0].isdigit():
            raise InputError(f"--port {self.url}: names no port; write socket://HOST:PORT, as bench --tcp prints it")
        try:
            port = serial.serial_for_url(self.url, baudrate=self.baud, timeout=_READ_S, write_timeout=1.0)
        except (OSError, ValueError) as error:
            if first:
                raise InputError(f"--port {self.url}: cannot be opened ({error}); is it plugged in, is the name right, "
                                 f"may you read it, does another program hold it?{_there()}") from error
            return None
        self.connects += 1
        self._opened_at = time.monotonic()
        return port

    def _read(self) -> bytes:
        port = self._port
        data: bytes = port.read(1)
        waiting = port.in_waiting if data else 0
        if data and waiting:
            data += port.read(min(waiting, 65536)) if waiting > 1 else port.read(4096 if "socket" in self.url else 1)
        return data

    def _again(self) -> bool:
        """Try to open the port again, for as long as patience lasts."""
        if time.monotonic() - self._broken_at > self.patience_s:
            raise BayesDEAError(f"{self.url}: the connection broke and did not come back within {self.patience_s:g} s; "
                                "all that was received is kept. Plug it in and go on with --resume.")
        port = self._open()
        if port is None:
            self._finish.wait(0.1)
            return False
        with self._lock:
            self._port = port
        if self.wanted:
            # whatever it was doing, nobody watched: to zero, then on with listening
            zero = self.form.volts.format(volts=0.0) if self.driven else ""
            for words in (self.form.stop or zero, self.form.start):
                if words:
                    self.say(words)
        return True

    def _break(self) -> None:
        self.lost.set()
        self._broken_at = time.monotonic()
        self._close()
        if self._buffer:
            self.journal.reject(self._buffer, "cut: the connection broke", counted=False)
        self._buffer, self._fragment = b"", True

    def _close(self) -> None:
        with self._lock:
            port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(Exception):
                port.close()

    # ------------------------------------------------------------ lines
    def _take(self, data: bytes, now: float) -> None:
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        if len(self._buffer) > _LONGEST:
            self.journal.reject(self._buffer, "no end of line")
            self._buffer = b""
        rows: list[tuple[float, float, float]] = []
        comment = self.form.comment.encode() or b"\0"
        for line in lines:
            line = line.rstrip(b"\r")
            if not line:
                continue
            sample = parse_sample(line, self.form)
            if not isinstance(sample, str) and not self._counts:
                self._fragment, self.sample_at = False, now
            elif not isinstance(sample, str):
                self._fragment = False
                self._in_order(sample, line, rows, now)
            elif line.startswith(comment):
                self._remark(line)
            elif line.startswith((b"OK", b"ERR")) and not self.foreign:
                self._fragment = False
                self.answers.put(line.decode("ascii", "replace"))
            else:
                self.journal.reject(line, "began before we listened" if self._fragment else sample, not self._fragment)
                self._fragment = False
        self._store(rows, now)

    def _remark(self, line: bytes) -> None:
        text = line.decode("ascii", "replace")
        columns = None if self.foreign else header_columns(text)
        if columns is not None:
            self.form = format_of_header(columns)
            now = time.monotonic()
            # a device that streams answers us between samples; a header out of silence is that of one that has booted
            self._booted = self.wanted and min(now - self.sample_at, now - self._opened_at) > _BOOT_SILENCE_S
        elif text.startswith("# end"):
            self.ended.set()

    def _in_order(self, sample: tuple[float, float, float], line: bytes, rows: list[tuple[float, float, float]],
                  now: float) -> None:
        """Put a sample in its session: time that falls back once is a slip, twice a new clock."""
        pending = self._pending
        if pending is not None:
            self._pending = None
            if pending[0] < sample[0] <= self.time_s:
                self._store(rows, now)
                rows.clear()
                self._begin(now)
                rows.append(pending)
                self.time_s = pending[0]
            else:
                self.journal.reject(repr(pending).encode(), "time does not rise")
        if self._session is None:
            self._begin(now)
        elif self._booted and not self._goes_on(sample[0], now):
            self._store(rows, now)
            rows.clear()
            self._begin(now)
        self._booted = False
        if sample[0] <= self.time_s:
            self._pending = sample
            return
        self._step_s = sample[0] - self.time_s
        self.time_s = sample[0]
        rows.append(sample)

    def _goes_on(self, time_s: float, now: float) -> bool:
        """Whether a sample after a silence is of the same clock: the next one, or one as much later as the silence."""
        gap, silence = time_s - self.time_s, now - self.sample_at
        return gap > 0 and (gap < 3 * self._step_s or abs(gap - silence) < _ALIKE * silence)

    def _begin(self, now: float) -> None:
        elapsed = now - self.sample_at + self._elapsed_before
        self._session = self.journal.begin(self.zeroed and self._session is None, elapsed)
        self.time_s = -np.inf

    def _store(self, rows: list[tuple[float, float, float]], now: float) -> None:
        if not rows:
            return
        self.journal.append(rows)
        assert self._session is not None
        self._elapsed_before = 0.0
        self.sample_at = now
        self.batches.put(Batch(self._session, np.array(rows), now))

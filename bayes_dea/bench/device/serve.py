"""The device on a pseudo-terminal or a TCP port, in real time, faster, or as fast as the host reads."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path

from bayes_dea.bench.device.line import HEADER
from bayes_dea.bench.device.machine import SILENCE_S, Machine
from bayes_dea.errors import BayesDEAError, InputError

#: what the device keeps for a host that does not read; then samples are lost, as on a real one
_BUFFER = 65536
_PORTION = 512
_WAIT_S = 0.004


class PtyPort:
    """A pseudo-terminal. link: a name that always points to the present one, as udev gives to a device."""

    def __init__(self, link: Path | None = None) -> None:
        self._link = link
        self._master = self._slave = -1
        self.plug()

    def plug(self) -> None:
        """Open a new pseudo-terminal."""
        import tty

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        if self._link is not None:
            beside = self._link.with_name(self._link.name + ".new")
            with contextlib.suppress(FileNotFoundError):
                beside.unlink()
            beside.symlink_to(self.name)
            os.replace(beside, self._link)
            self.name = str(self._link)

    def unplug(self) -> None:
        """Close it: the host's next read fails."""
        for handle in (self._master, self._slave):
            if handle >= 0:
                os.close(handle)
        self._master = self._slave = -1

    def close(self) -> None:
        """Close it and take the link away."""
        self.unplug()
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def wait(self, writing: bool) -> bool:
        """Wait a moment for something to read, or room to write; False: whoever was there before has gone."""
        select.select([self._master], [self._master] if writing else [], [], _WAIT_S)
        return True

    def read(self) -> bytes:
        """What has come in."""
        try:
            return os.read(self._master, 4096)
        except (BlockingIOError, OSError):
            return b""

    def write(self, data: bytes) -> int:
        """How many bytes went out."""
        try:
            return os.write(self._master, data)
        except (BlockingIOError, OSError):
            return 0


class TcpPort:
    """A TCP port that takes one host at a time."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._server = socket.create_server((host, port))
        except OSError as error:
            raise InputError(f"--tcp {host}:{port}: cannot be opened ({error.strerror or error}); choose another") \
                from error
        self._server.setblocking(False)
        self._host: socket.socket | None = None
        self.name = f"socket://{host}:{self._server.getsockname()[1]}"

    def plug(self) -> None:
        """Listen again; the port was never given up."""

    def unplug(self) -> None:
        """Close the connection: the host's next read fails."""
        if self._host is not None:
            self._host.close()
        self._host = None

    def close(self) -> None:
        """Close everything."""
        self.unplug()
        self._server.close()

    def wait(self, writing: bool) -> bool:
        """See `PtyPort.wait`."""
        if self._host is None:
            ready, _, _ = select.select([self._server], [], [], _WAIT_S)
            if not ready:
                return True
            self._host, _ = self._server.accept()
            self._host.setblocking(False)
            self._host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return False
        select.select([self._host], [self._host] if writing else [], [], _WAIT_S)
        return True

    def read(self) -> bytes:
        """What has come in; an end of the connection makes room for the next host."""
        if self._host is None:
            return b""
        try:
            data = self._host.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.unplug()
        return data

    def write(self, data: bytes) -> int:
        """How many bytes went out; nobody there: all of them, into the air."""
        if self._host is None:
            return len(data)
        try:
            return self._host.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self.unplug()
            return len(data)


def serve(
    machine: Machine,
    port: PtyPort | TcpPort,
    speed: float = 1.0,
    seconds: float | None = None,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """Be the device until `stop` or for `seconds` (s of the world's clock).

    speed: intervals of the device a second, over its rate; above 1 its clock waits for a host that listens but cannot
    follow. 0: as fast as the host reads, and the device's clock stands still while no programme is played. Raises
    BayesDEAError where the pseudo-terminal cannot be opened again.
    """
    began = heard = spoken = time.monotonic()
    rate = machine.settings.rate_Hz
    passed = 0.0  # intervals that are due by the world's clock and have been produced
    waiting = bytearray(HEADER.encode())
    words = bytearray()
    try:
        while not stop() and (seconds is None or time.monotonic() - began < seconds):
            if not port.wait(bool(waiting)):
                waiting[:] = HEADER.encode()
                heard = time.monotonic()
            said = port.read()
            now = time.monotonic()
            if said:
                heard = spoken = now
                words += said
                *lines, rest = words.split(b"\n")
                words = bytearray(rest[-200:])
                for line in lines:
                    waiting += machine.hear(line.decode("ascii", "replace"))
            if now - heard > SILENCE_S:
                machine.ramp_down()
                heard = now
            if speed > 0:
                due = int((now - began) * rate * speed - passed)
                passed += due
                while due > 0:
                    if speed > 1 and len(waiting) >= _BUFFER and now - spoken < SILENCE_S:
                        break  # only a clock that keeps the world's time goes on without its host
                    sent = machine.produce(min(due, _PORTION))
                    due -= min(due, _PORTION)
                    if len(waiting) < _BUFFER:
                        waiting += sent
            else:
                while (machine.busy or machine.booting) and len(waiting) < _BUFFER // 4 and not machine.unplugged_s:
                    waiting += machine.produce(_PORTION)
            if machine.unplugged_s > 0:
                waiting.clear()
                port.unplug()
                time.sleep(machine.unplugged_s)
                machine.unplugged_s = 0.0
                try:
                    port.plug()
                except OSError as error:
                    raise BayesDEAError(f"the pseudo-terminal cannot be opened again: {error}") from error
                waiting += HEADER.encode()
                continue
            if waiting:
                del waiting[: port.write(bytes(waiting[:16384]))]
    finally:
        port.close()

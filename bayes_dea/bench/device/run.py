"""`bench --serve-pty` and `bench --tcp`: from options to a device that serves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from bayes_dea.bench.device.faults import parse_faults
from bayes_dea.bench.device.machine import DeviceSettings, Machine
from bayes_dea.bench.device.serve import PtyPort, TcpPort, serve
from bayes_dea.bench.nuisance import SensorSheet
from bayes_dea.bench.rig import Material
from bayes_dea.errors import InputError

#: a line is about 30 bytes, and no port carries more of them
_FASTEST_HZ = 1e6


def address(text: str) -> tuple[str, int]:
    """Host and port of "HOST:PORT". Raises InputError."""
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdigit() and int(port) < 65536):
        raise InputError(f"--tcp {text}: write HOST:PORT, as 127.0.0.1:4000 (port 0: any that is free)")
    return host, int(port)


def serve_bench(
    tcp: str | None = None,
    *,
    link: str | Path | None = None,
    rate_Hz: float = 1000.0,
    speed: float = 1.0,
    seconds: float | None = None,
    faults: Iterable[str] = (),
    seed: int = 1,
    material: str | None = None,
    noise_scale: float = 1.0,
    announce: Callable[[str], None] = print,
    stop: Callable[[], bool] = lambda: False,
) -> None:
    """The virtual bench as a device on a TCP port, or on a pseudo-terminal where `tcp` is None (CONTRACT 6).

    announce: called with the name of the port (a path, or socket://HOST:PORT) once it is open. speed: see `serve`.
    Raises InputError for settings that cannot be, BayesDEAError where a port breaks.
    """
    if material not in (None, "baseline", "drawn"):
        raise InputError(f"--material {material}: use baseline or drawn")
    if not 0.0 < rate_Hz <= _FASTEST_HZ:
        raise InputError(f"--rate {rate_Hz:g}: give samples a second, at most {_FASTEST_HZ:g}")
    if not 0.0 <= speed < math.inf:
        raise InputError(f"--speed {speed:g}: give zero (as fast as the host reads) or a positive number")
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise InputError(f"--lasting {seconds:g}: give a positive number of seconds, or leave it out")
    sheet = SensorSheet(noise_scale * 4.7e-6, 19.4e-6, 0.15e-6)
    made = Material.drawn(np.random.default_rng(seed)) if material == "drawn" else Material()
    machine = Machine(DeviceSettings(rate_Hz, seed, material=made, sensor=sheet, faults=parse_faults(faults)))
    port = TcpPort(*address(tcp)) if tcp is not None else PtyPort(None if link is None else Path(link))
    announce(port.name)
    serve(machine, port, speed, seconds, stop)

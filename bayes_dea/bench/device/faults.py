"""Faults of device, line and actuator on request: `--fault NAME=VALUE`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from bayes_dea.errors import InputError

#: faults that are a share of all lines
_SHARES = ("garble", "cut", "checksum", "dropouts")
#: faults that come at a moment: their second number, and what it is where only the moment is given
_MOMENTS = {"reset": 0.3, "stall": 1.5, "unplug": 0.5, "stiffness": 1.05, "delay": 3e-3,
            "mains": 3e-6}
NAMES = (*_SHARES, *_MOMENTS, "drift")


@dataclass(frozen=True)
class LineFaults:
    """Shares of lines with a flipped byte (`garble`), a lost end (`cut`), a wrong checksum, a laser drop-out.

    At a moment in s of the device's time since the first START, each with a size: `reset` and how long the device is
    dead (s), `stall` (s), `unplug` (s of the world's clock), `stiffness` (a factor from then on), `delay` of the
    readings from then on (s), `mains` pick-up of that amplitude at 50.02 Hz from then on (m). `drift`: relative error
    of the device's clock.
    """

    garble: float = 0.0
    cut: float = 0.0
    checksum: float = 0.0
    dropouts: float = 0.0
    drift: float = 0.0
    moments: tuple[tuple[str, float, float], ...] = ()  # (name, at, size), in the order of time


def parse_faults(texts: Iterable[str]) -> LineFaults:
    """Faults from texts such as "garble=0.01", "reset=5" or "stall=5:1.5". Raises InputError for anything else."""
    faults = LineFaults()
    moments: list[tuple[str, float, float]] = []
    for text in texts:
        name, _, value = text.partition("=")
        if name not in NAMES:
            raise InputError(f"--fault {text}: there is no fault {name!r}; one of {', '.join(NAMES)}")
        first, _, second = value.partition(":")
        a = _number(first, text)
        if name in _MOMENTS:
            size = _number(second, text) if second else _MOMENTS[name]
            if a < 0 or size <= 0:
                raise InputError(f"--fault {text}: give a moment in s and a positive size, as {name}=5:{size:g}")
            moments.append((name, a, size))
        elif second:
            raise InputError(f"--fault {text}: takes one number, as {name}=0.01")
        elif name in _SHARES and not 0.0 <= a < 1.0:
            raise InputError(f"--fault {text}: give a share from 0 to below 1")
        else:
            faults = replace(faults, **{name: a})  # type: ignore[arg-type]
    return replace(faults, moments=tuple(sorted(moments, key=lambda m: m[1])))


def _number(text: str, whole: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"--fault {whole}: {text!r} is no number; write it as reset=5, stall=5:1.5 or garble=0.01")
    return value

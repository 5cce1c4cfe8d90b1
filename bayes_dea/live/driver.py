"""Driving the bench: the device's own programmes or a command file, within the limits of the actuator."""

from __future__ import annotations

import csv
import math
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..campaign.schema import Actuator
from ..errors import BayesDEAError, InputError
from .lines import LineFormat
from .reader import Reader

Array = NDArray[np.float64]

#: what a supply may overshoot before a run is stopped
_OVERSHOOT = 1.01, 1.0
_POLL_S = 0.004
#: how a device without a word to stop is ramped down
_RAMP_S, _RAMP_STEPS = 0.5, 10


@dataclass(frozen=True)
class Command:
    """Voltage (n,) in V from each time (n,) in s on."""

    time_s: Array
    voltage_V: Array


def limit_of(actuator: Actuator, own_V: float | None = None) -> float:
    """Largest voltage that may be commanded. own_V: a limit of the user's own, below the actuator's.

    Raises InputError where the campaign states none, or own_V is above it.
    """
    if actuator.max_voltage_V is None:
        raise InputError("[actuator] max_voltage_V is missing: nothing is driven without a limit")
    if own_V is None:
        return actuator.max_voltage_V
    if not (math.isfinite(own_V) and own_V > 0):
        raise InputError(f"--max-voltage {own_V:g}: give a positive number of volts")
    if own_V > actuator.max_voltage_V:
        raise InputError(f"--max-voltage {own_V:g}: the actuator takes {actuator.max_voltage_V:g} V; give less")
    return own_V


def read_command(path: Path, actuator: Actuator, own_V: float | None = None) -> Command:
    """A command file (columns time_s, voltage_V), checked against the limit of the actuator and the user's own.

    Raises InputError naming the row that goes beyond it, or that cannot be read.
    """
    limit = limit_of(actuator, own_V)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"--command {path}: cannot be read ({error})") from error
    header = [c.strip() for c in table[0]] if table else []
    if "time_s" not in header or "voltage_V" not in header:
        raise InputError(f"{path}: the first line must name time_s and voltage_V; it has {header}")
    places = header.index("time_s"), header.index("voltage_V")
    rows = [r for r in table[1:] if r]
    values = np.empty((len(rows), 2))
    for i, row in enumerate(rows):
        try:
            values[i] = [float(row[p]) for p in places]
        except (ValueError, IndexError):
            raise InputError(f"{path}, row {i + 1}: {','.join(row)!r} is not a time and a voltage") from None
    if len(values) < 2 or not np.all(np.isfinite(values)):
        raise InputError(f"{path}: a command needs two rows or more, without gaps")
    t, V = values.T
    if np.any(np.diff(t) <= 0):
        raise InputError(f"{path}, row {int(np.argmax(np.diff(t) <= 0)) + 2}: time_s does not rise")
    over = np.flatnonzero(np.abs(V) > limit)
    if over.size:
        raise InputError(f"{path}, row {over[0] + 1}: {V[over[0]]:g} V is beyond the limit of the actuator "
                         f"({limit:g} V); it is not played")
    return Command(t - t[0], V)


def check_words(form: LineFormat | None, where: str, zero: bool, play: bool, volts: bool) -> None:
    """Raises InputError where a device of another make (`form`, from `where`) has no word for what is asked of it."""
    if form is None:
        return
    wanted = [("zero", zero, "--zero", 'zero = "TARE"'), ("play", play, "--play", 'play = "RUN {name}"'),
              ("stop", play, "--play", 'stop = "OFF"'),
              ("volts", volts, "--command and --adaptive", 'volts = "SET {volts:.1f}"')]
    for name, asked, option, example in wanted:
        if asked and not getattr(form, name):
            raise InputError(f"{where}: [device] has no {name}, which {option} needs; write what the device "
                             f"understands, as {example}")


class Driver:
    """Starts, plays and stops. After a broken connection nothing is commanded any more.

    adaptive: commands come while it runs, through `stream`. `done`: the command that was streamed is at its end.
    """

    def __init__(self, reader: Reader, actuator: Actuator, play: str | None, command: Command | None,
                 own_V: float | None = None, adaptive: bool = False) -> None:
        self._reader, self._play, self._command, self._adaptive = reader, play, command, adaptive
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._sent = 0.0  # the last voltage that was streamed
        self.done = threading.Event()
        self.error: BaseException | None = None
        drives = play is not None or command is not None or adaptive
        self._limit = limit_of(actuator, own_V) if drives or own_V is not None else actuator.max_voltage_V

    @property
    def drives(self) -> bool:
        """Whether anything is commanded at all."""
        return self._play is not None or self._command is not None or self._adaptive

    def begin(self, zero: bool) -> None:
        """Zero the sensor if asked, start the stream, and what is to be played. Raises BayesDEAError as `ask`."""
        r, form = self._reader, self._reader.form
        if zero:
            r.ask(form.zero)
        r.wanted = True
        if form.start:
            r.ask(form.start)
        r.driven = self.drives
        if self._play is not None:
            r.ask(form.play.format(name=self._play))
        if self._command is not None:
            self.stream(self._command)

    def stream(self, command: Command) -> None:
        """Stream one command, when the one before is done. Raises InputError where it goes beyond the limit."""
        over = np.abs(command.voltage_V) > (self._limit or 0.0)
        if not np.all(np.isfinite(command.voltage_V)) or over.any():
            raise InputError(f"{float(np.max(np.abs(command.voltage_V))):g} V is beyond the limit of "
                             f"{self._limit or 0.0:g} V; it is not played")
        if self._thread is not None:
            self._thread.join()
        self.done.clear()
        self._thread = threading.Thread(target=self._follow, args=(command,), name="live driver", daemon=True)
        self._thread.start()

    def watch(self, voltage_V: Array) -> None:
        """Raises BayesDEAError where the bench reports a voltage beyond the limit."""
        limit = self._limit
        if limit is None or not voltage_V.size:
            return
        most = float(np.max(np.abs(voltage_V)))
        if most > _OVERSHOOT[0] * limit + _OVERSHOOT[1]:
            raise BayesDEAError(f"the bench reports {most:g} V, beyond the limit of {limit:g} V; it was told to stop")

    def end(self) -> None:
        """Voltage to zero, whatever happened before. Errors are swallowed: the device ramps down by itself."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=1.0)
        r = self._reader
        r.wanted = False
        if r.form.stop:
            try:
                r.ask(r.form.stop, 1.0)
            except BayesDEAError:
                r.say(r.form.stop)
        elif self._command is not None or self._adaptive:  # a device that only knows voltages
            for volts in np.linspace(self._sent, 0.0, _RAMP_STEPS + 1)[1:]:
                r.say(r.form.volts.format(volts=float(volts)))
                time.sleep(_RAMP_S / _RAMP_STEPS)

    def _follow(self, command: Command) -> None:
        """Follow the command by the device's clock: what was in force is what the device reports."""
        r, t, V = self._reader, command.time_s, command.voltage_V
        limit = self._limit or 0.0
        try:
            began = r.time_s
            while not math.isfinite(began) and not self._stop.wait(_POLL_S):
                began = r.time_s
            sent = math.nan
            while not self._stop.is_set():
                if r.lost.is_set():
                    raise BayesDEAError("the connection broke while a command was streamed; the voltage ramps to zero "
                                        "and the command is not taken up again")
                now = r.time_s - began
                if now > t[-1]:
                    break
                volts = float(V[max(0, int(np.searchsorted(t, now, side="right")) - 1)])
                if volts != sent:
                    if abs(volts) > limit:  # read_command has checked it; this is the last gate before the wire
                        raise BayesDEAError(f"{volts:g} V is beyond {limit:g} V")
                    r.say(r.form.volts.format(volts=volts))
                    sent = self._sent = volts
                time.sleep(_POLL_S)
            self.done.set()
        except BaseException as error:
            self.error = error

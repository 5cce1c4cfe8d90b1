"""Driving the bench: the device's own programmes or a command file, within the limits of the actuator."""

from __future__ import annotations

import csv
import math
import re
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
#: how often a device that would not ramp down by itself is told so again
_AGAIN_S = 0.1
#: a voltage that is written out may be rounded by this share of the limit
_ROUNDED = 0.01
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


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


def read_command(path: str | Path, actuator: Actuator, own_V: float | None = None) -> Command:
    """A command file (columns time_s, voltage_V), checked against the limit of the actuator and the user's own.

    Raises InputError naming the file's row that goes beyond it, or that cannot be read.
    """
    path, limit = Path(path), limit_of(actuator, own_V)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            table = [(reader.line_num, row) for row in reader]  # as counted in the file, which editors show
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"--command {path}: cannot be read ({error})") from error
    header = [c.strip() for c in table[0][1]] if table else []
    if "time_s" not in header or "voltage_V" not in header:
        raise InputError(f"{path}: the first line must name time_s and voltage_V; it has {header}")
    places = header.index("time_s"), header.index("voltage_V")
    rows = [(number, row) for number, row in table[1:] if row]
    values = np.empty((len(rows), 2))
    for i, (number, row) in enumerate(rows):
        try:
            values[i] = [float(row[p]) for p in places]
        except (ValueError, IndexError):
            raise InputError(f"{path}, row {number}: {','.join(row)!r} is not a time and a voltage") from None
    if len(values) < 2 or not np.all(np.isfinite(values)):
        raise InputError(f"{path}: a command needs two rows or more, without gaps")
    t, V = values.T
    if np.any(np.diff(t) <= 0):
        raise InputError(f"{path}, row {rows[int(np.argmax(np.diff(t) <= 0)) + 1][0]}: time_s does not rise")
    over = np.flatnonzero(np.abs(V) > limit)
    if over.size:
        raise InputError(f"{path}, row {rows[over[0]][0]}: {V[over[0]]:g} V is beyond the limit of the actuator "
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


def check_voltage_word(form: LineFormat | None, where: str, limit_V: float) -> None:
    """Raises InputError where a device's word for voltages cannot be filled in, or does not say the voltage.

    Such a word would pass every limit, and the ramp to zero would not be one.
    """
    if form is None:
        return
    for volts in (0.0, 0.637 * limit_V, limit_V):
        remedy = 'write {volts} where the number stands, as volts = "SET {volts:.1f}"'
        said = _filled(form.volts, f"{where}: [device] volts", remedy, volts=volts)
        if not any(abs(float(n) - volts) <= _ROUNDED * limit_V for n in _NUMBER.findall(said)):
            raise InputError(f"{where}: [device] volts = {form.volts!r} sends {said!r} for {volts:g} V; {remedy}")


def check_name_word(form: LineFormat | None, where: str, name: str) -> None:
    """Raises InputError where the name of a programme cannot be sent, or a device's word for it does not hold it."""
    if not name.isascii():
        raise InputError(f"--play {name}: cannot be sent; what a device understands is plain ASCII")
    if form is None:
        return
    remedy = 'write {name} where the name stands, as play = "RUN {name}"'
    said = _filled(form.play, f"{where}: [device] play", remedy, name=name)
    if name not in said:
        raise InputError(f"{where}: [device] play = {form.play!r} sends {said!r} for {name}; {remedy}")


def _filled(word: str, what: str, remedy: str, **value: float | str) -> str:
    try:
        return word.format(**value)
    except (LookupError, ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{what} = {word!r} cannot be filled in ({error}); {remedy}") from None


def _unheard(what: str) -> str:
    return (f"The device could not be told {what} at the end: the voltage may still be on. Switch the supply off by "
            "hand.")


#: time that a device of another make, which does not answer, gets to zero its sensor
_ZEROED_S = 1.0


class Driver:
    """Starts, plays and stops. After a broken connection nothing is commanded any more.

    adaptive: commands come while it runs, through `stream`. `done`: the command that was streamed is at its end.
    `unheard`: after `end`, why the voltage may still be on; empty where the device was told, or ramps down unasked.
    """

    def __init__(self, reader: Reader, actuator: Actuator, play: str | None, command: Command | None,
                 own_V: float | None = None, adaptive: bool = False) -> None:
        self._reader, self._play, self._command, self._adaptive = reader, play, command, adaptive
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._sent = 0.0  # the last voltage that was streamed
        self.done = threading.Event()
        self.error: BaseException | None = None
        self.unheard = ""
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
            if r.foreign:
                time.sleep(_ZEROED_S)
        r.count()
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
        """Voltage to zero, whatever happened before. Nothing is raised; see `unheard`."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=1.0)
        self._reader.wanted = False
        try:
            self._to_zero()
        except BaseException:  # a second Ctrl-C while the device is told
            if self.drives and self._reader.foreign:
                self.unheard = _unheard("to go to zero")
            raise

    def _to_zero(self) -> None:
        r = self._reader
        last = r.form.stop
        heard = True
        if last:
            try:
                r.ask(last, 1.0)
            except BayesDEAError:
                heard = r.say(last)
        elif self._command is not None or self._adaptive:  # a device that only knows voltages
            for volts in np.linspace(self._sent, 0.0, _RAMP_STEPS + 1)[1:]:
                last = r.form.volts.format(volts=float(volts))
                heard = r.say(last)
                time.sleep(_RAMP_S / _RAMP_STEPS)
        if not heard and self.drives and r.foreign:
            self._insist(last)

    def _insist(self, words: str) -> None:
        """Say it until it has gone out: the line may come back, and this device waits for what it is told."""
        r = self._reader
        until = time.monotonic() + r.patience_s
        while not r.say(words):
            if time.monotonic() > until or not (r.connected or r.is_alive()):
                self.unheard = _unheard(repr(words))
                return
            time.sleep(_AGAIN_S)

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
                    words = r.form.volts.format(volts=volts)
                    self._sent = max(self._sent, volts, key=abs)  # it may have gone out even where that fails
                    if not r.say(words):
                        raise BayesDEAError(f"{r.url}: {words!r} could not be sent while a command was streamed; the "
                                            "voltage ramps to zero and the command is not taken up again")
                    sent = self._sent = volts
                time.sleep(_POLL_S)
            self.done.set()
        except BaseException as error:
            self.error = error

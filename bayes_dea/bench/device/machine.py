"""The device: clock, supply, sensor and the words it understands (CONTRACT 6). It knows nothing of ports."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bayes_dea.bench.device.faults import LineFaults
from bayes_dea.bench.device.line import HEADER, sample_line
from bayes_dea.bench.device.programmes import Programme, built_in
from bayes_dea.bench.device.stack import Stack
from bayes_dea.bench.nuisance import ZERO_READINGS, SensorSheet, quantise
from bayes_dea.bench.rig import Geometry, Material, check_positive

Array = NDArray[np.float64]

#: time in which the supply ramps from the limit to zero
_RAMP_S = 0.5
#: silence of the host after which the voltage is ramped down
SILENCE_S = 2.0
#: frequency of the grid by the device's clock
_MAINS_HZ = 50.02
#: largest drop-out of the laser
_DROPOUT_M = 300e-6


@dataclass(frozen=True)
class DeviceSettings:
    """What the device is. gain: error of the sensor's scale, drawn from its sheet where None."""

    rate_Hz: float = 1000.0
    seed: int = 1
    geometry: Geometry = Geometry()
    material: Material = Material()
    sensor: SensorSheet = SensorSheet(4.7e-6, 19.4e-6, 0.15e-6)
    gain: float | None = None
    faults: LineFaults = field(default_factory=LineFaults)

    def __post_init__(self) -> None:
        check_positive("device of the bench", rate_Hz=self.rate_Hz)


class Machine:
    """Words in, lines out. `produce(n)` lets n sampling intervals pass."""

    def __init__(self, settings: DeviceSettings) -> None:
        self.settings = settings
        self._rng = np.random.default_rng([settings.seed, 0x6465])
        self._stack = Stack(settings.geometry, settings.material)
        self._programmes = built_in()
        largest = 3e-4  # stroke at the limit, for the gain that the sheet allows
        limit = settings.sensor.accuracy / largest
        self._gain = settings.gain if settings.gain is not None else float(self._rng.uniform(-limit, limit))
        self._offset = float(self._rng.uniform(-settings.sensor.accuracy, settings.sensor.accuracy))
        self._moments = list(settings.faults.moments)
        self._world = 0  # intervals since the first START; no reset touches it
        self._started = False
        self._delay = 0
        self._mains_m = 0.0
        self._past = np.zeros(round(settings.rate_Hz) + 1)  # one second of true displacements, newest last
        self.unplugged_s = 0.0
        self._boot()
        self._dead = 0

    def _boot(self) -> None:
        self._clock = 0
        self._target_V = 0.0
        self._voltage_V = 0.0
        self._ramping = False
        self._ending = False
        self._playing: tuple[str, Programme, int] | None = None
        self.streaming = False

    @property
    def booting(self) -> bool:
        """Whether it is dead or stalled for a while: time has to pass before it answers."""
        return self._dead != 0

    @property
    def busy(self) -> bool:
        """Whether a programme is played or the voltage ramps down."""
        return self._playing is not None or (self._ramping and (self._voltage_V != 0.0 or self._ending))

    # ------------------------------------------------------------ words
    def hear(self, line: str) -> bytes:
        """The answer to one line of the host, without its end."""
        if self._dead != 0:
            return b""
        word, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if word == "?":
            return HEADER.encode()
        if word == "START" and not rest:
            self.streaming, self._ending, self._started = True, False, True
            return b"OK START\n"
        if word == "STOP" and not rest:
            self.ramp_down()
            self._ending = True
            return b"OK STOP\n"
        if word == "ZERO" and not rest:
            noise = self.settings.sensor.fluctuation / math.sqrt(ZERO_READINGS)
            self._offset = -(1 + self._gain) * float(self._past[-1]) + noise * float(self._rng.standard_normal())
            return b"OK ZERO\n"
        if word == "V":
            return self._set(rest)
        if word == "PLAY":
            return self._play(rest)
        return b"ERR unknown: say ?, START, STOP, ZERO, V <volts> or PLAY <name>\n"

    def _set(self, text: str) -> bytes:
        try:
            volts = float(text)
        except ValueError:
            volts = math.nan
        most = self.settings.geometry.max_voltage_V
        if not math.isfinite(volts):
            return b"ERR V wants a number of volts\n"
        if abs(volts) > most:
            return f"ERR V {text}: the limit is {most:g} V\n".encode()
        self._playing, self._ramping = None, False
        self._target_V = volts
        return f"OK V {volts:g}\n".encode()

    def _play(self, name: str) -> bytes:
        programme = self._programmes.get(name)
        if programme is None:
            return f"ERR PLAY {name}: there is {' '.join(self._programmes)}\n".encode()
        if programme.largest_V > self.settings.geometry.max_voltage_V:
            return f"ERR PLAY {name}: goes to {programme.largest_V:g} V\n".encode()
        self._playing, self._ramping = (name, programme, self._clock), False
        return f"OK PLAY {name} {programme.duration_s:g} s\n".encode()

    def ramp_down(self) -> None:
        """Voltage to zero, at a constant rate."""
        self._playing, self._ramping, self._target_V = None, True, 0.0

    # ------------------------------------------------------------ time
    def produce(self, n: int) -> bytes:
        """Let n intervals pass and return what is sent meanwhile."""
        out = b""
        while n > 0:
            self._strike()
            take = n
            if self._moments:
                take = min(n, max(1, math.ceil(self._moments[0][1] * self.settings.rate_Hz) - self._world))
            if self._dead != 0:
                take = min(take, abs(self._dead))
            if self._playing is not None:  # the end of a programme falls between two calls
                left = round(self._playing[1].duration_s * self.settings.rate_Hz) - (self._clock - self._playing[2])
                take = min(take, max(1, left))
            out += self._interval(take)
            n -= take
        return out

    def _strike(self) -> None:
        """Faults whose moment has come."""
        while self._started and self._moments and self._world >= math.ceil(self._moments[0][1] * self.settings.rate_Hz):
            name, _, size = self._moments.pop(0)
            if name == "reset":
                self._boot()
                self._dead = max(1, round(size * self.settings.rate_Hz))
            elif name == "stall":
                self._dead = -max(1, round(size * self.settings.rate_Hz))
            elif name == "unplug":
                self.unplugged_s = size
            elif name == "stiffness":
                self._stack.factor = size
            elif name == "mains":
                self._mains_m = size
            elif name == "delay":
                self._delay = min(round(size * self.settings.rate_Hz), self._past.size - 1)

    def _interval(self, n: int) -> bytes:
        volts = self._commands(n)
        dt = 1.0 / self.settings.rate_Hz
        true = self._stack.advance(volts, dt)
        self._world += n if self._started else 0
        seen = np.concatenate([self._past, true])
        self._past = seen[-self._past.size :].copy()
        if self._dead > 0:
            self._dead -= n
            return HEADER.encode() if self._dead == 0 else b""
        stamps = (self._clock + 1 + np.arange(n)) * dt * (1 + self.settings.faults.drift)
        self._clock += n
        end = self._finished()
        if self._dead < 0:  # stalled: the clock and the supply go on, nothing is sent
            self._dead += n
            return end
        if not self.streaming:
            return end
        read = self._read(seen[seen.size - n - self._delay : seen.size - self._delay])
        lines = [sample_line(*row) for row in zip(stamps.tolist(), volts.tolist(), read.tolist(), strict=True)]
        if self._ending and self._voltage_V == 0.0:
            self.streaming = self._ending = False
            del lines[int(np.argmax(volts == 0.0)) + 1 :]  # the stream ends with the first sample at rest
        return self._spoil(lines) + end

    def _commands(self, n: int) -> Array:
        if self._dead > 0:
            return np.zeros(n)
        if self._playing is not None:
            _, programme, start = self._playing
            out = programme.command((self._clock - start + np.arange(n)) / self.settings.rate_Hz)
        elif self._ramping:
            step = self.settings.geometry.max_voltage_V / (_RAMP_S * self.settings.rate_Hz)
            size = np.maximum(abs(self._voltage_V) - step * (1 + np.arange(n)), 0.0)
            out = math.copysign(1.0, self._voltage_V) * size + 0.0
        else:
            out = np.full(n, self._target_V)
        out = quantise(out, 0.01)
        self._voltage_V = float(out[-1])
        return out

    def _finished(self) -> bytes:
        if self._playing is None:
            return b""
        name, programme, start = self._playing
        if self._clock - start < round(programme.duration_s * self.settings.rate_Hz):
            return b""
        self.ramp_down()
        return f"# end {name}\n".encode()

    def _read(self, true: Array) -> Array:
        s, f = self.settings.sensor, self.settings.faults
        y = (1 + self._gain) * true + self._offset + s.fluctuation * self._rng.standard_normal(true.size)
        if self._mains_m > 0:
            t = (self._clock - true.size + 1 + np.arange(true.size)) / self.settings.rate_Hz
            y = y + self._mains_m * np.sin(2 * np.pi * _MAINS_HZ * t + 0.7)
        if f.dropouts > 0:
            hit = self._rng.random(true.size) < f.dropouts
            y = np.where(hit, y + _DROPOUT_M * self._rng.choice((-1.0, 1.0), true.size), y)
        return quantise(y, s.resolution)

    def _spoil(self, lines: list[bytes]) -> bytes:
        f = self.settings.faults
        if f.garble + f.cut + f.checksum <= 0 or not lines:
            return b"".join(lines)
        which = self._rng.random(len(lines))
        for i in np.flatnonzero(which < f.garble + f.cut + f.checksum):
            line = lines[i]
            if which[i] < f.garble:
                at = int(self._rng.integers(len(line) - 1))
                lines[i] = line[:at] + bytes([line[at] ^ (1 << int(self._rng.integers(7)))]) + line[at + 1 :]
            elif which[i] < f.garble + f.cut:
                lines[i] = line[: int(self._rng.integers(1, len(line) - 4))] + b"\n"
            else:
                lines[i] = line[:-3] + (b"00" if line[-3:-1] != b"00" else b"FF") + b"\n"
        return b"".join(lines)

"""The frequency that mains had in a recording whose drive has a line of its own there.

The grid is at 50 Hz on average: from one recording to the next it wanders by hundredths, and what others show is out
of step after half a minute. A line of the drive is known by its shape, and stays where it is; what turns beside it
does so at the difference of the two.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .mains import MainsLine, on_even_steps

Array = NDArray[np.float64]
#: windows (s), Hann, half overlapping, and how many of these are as good as one that stands alone
_WINDOW_S, _ALONE = 1.0, 1.9
#: turns over the recording by which trial frequencies differ, and sds of what others show that are tried
_TURNS, _SDS = 0.05, 4.0
#: fewest windows that can tell a frequency, and nats by which one has to be likelier than what others show
_FEWEST, _LIKELIER = 6, 5.0
#: how well the amplitude is known from others, as a share
_AMPLITUDE = 0.1


def in_this_recording(
    line: MainsLine, shown_Hz: Array, time_s: ArrayLike, y: ArrayLike, u: ArrayLike
) -> MainsLine:
    """A line that others show, at the frequency that it has in a recording of its own.

    shown_Hz (k,): of the line where it is shown; time_s, y, u (n,): readings (nan where there is none) and drive. The
    readings are taken for what the drive's square has about there, times one complex number, and a line about as strong
    as others show it; of all frequencies as near as theirs, the likeliest. The same line where these hardly differ, or
    nothing tells.
    """
    spread = float(np.std(shown_Hz, ddof=1)) if shown_Hz.size > 1 else 0.0
    times = np.asarray(time_s, float)
    if spread * (times[-1] - times[0]) < _TURNS:
        return line
    t, x = on_even_steps(times, np.asarray(y, float))
    if t.size < 2:
        return line
    step = (t[-1] - t[0]) / (t.size - 1)
    squares = np.interp(t, times, np.asarray(u, float) ** 2)
    at, z = _beside(np.diff(x), step, line.frequency_Hz)
    _, drive = _beside(np.diff(squares), step, line.frequency_Hz)
    if at.size < _FEWEST:
        return line
    reach = _SDS * spread
    trials = np.linspace(-reach, reach, 2 * math.ceil(reach * (t[-1] - t[0]) / _TURNS) + 1)
    window = math.sin(math.pi * line.frequency_Hz * step) * float(np.sum(_hann(round(_WINDOW_S / step))))
    cost = np.empty(trials.size)
    for k, off in enumerate(trials):
        left, size = _fitted(z, drive, np.exp(2j * np.pi * off * at))
        unlike = (size / (window * line.amplitude) - 1.0) / _AMPLITUDE
        cost[k] = at.size / _ALONE * math.log(left) + 0.5 * (unlike**2 + (off / spread) ** 2)
    best = int(np.argmin(cost))
    if cost[best] > cost[trials.size // 2] - _LIKELIER:
        return line
    return replace(line, frequency_Hz=line.frequency_Hz + float(trials[best]))


def _hann(size: int) -> Array:
    return np.asarray(np.hanning(size + 2)[1:-1], dtype=np.float64)


def _beside(d: Array, step: float, f: float) -> tuple[Array, NDArray[np.complex128]]:
    """Middles (k,) s of windows over d (n,), and what each has at f (Hz) (k,)."""
    size = round(_WINDOW_S / step)
    start = np.arange(0, d.size - size + 1, max(size // 2, 1))
    carrier = _hann(size) * np.exp(-2j * np.pi * f * step * np.arange(size))
    turned = np.empty(start.size, np.complex128)
    for k, first in enumerate(start):
        part = d[first : first + size]
        turned[k] = part @ carrier.real + 1j * (part @ carrier.imag)
    turned *= np.exp(-2j * np.pi * f * step * start)
    middles = np.asarray((start + 0.5 * size) * step, dtype=np.float64)
    return middles, turned


def _fitted(
    z: NDArray[np.complex128], drive: NDArray[np.complex128], line: NDArray[np.complex128]
) -> tuple[float, float]:
    """Sum of squares that drive and line (k,) leave of z (k,), and how much of the line there is."""
    scale = float(np.linalg.norm(drive)) or 1.0
    A = np.stack([drive / scale, line], axis=1)
    found = np.linalg.lstsq(A, z, rcond=1e-9)[0]
    return float(np.sum(np.abs(z - A @ found) ** 2)) + 1e-300, abs(complex(found[1]))

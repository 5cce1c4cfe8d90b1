"""Mains pick-up: lines at 50 or 60 Hz and their harmonics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayes_dea.campaign.order import differences, median, of
from bayes_dea.campaign.pace import pace_of
from bayes_dea.campaign.scratch import BLOCK, all_finite, beside, computed, kept, pieces, rows_where

Array = NDArray[np.float64]
#: rows first .. stop - 1 of a column
_Rows = Callable[[int, int], Array]

#: how far the grid and the clock of the recording may be off, relative
_TOLERANCE = 0.01
_SEGMENTS_S = (16.0, 128.0)
_HIGHEST_HARMONIC = 8
#: bins beyond which a Hann window shows nothing of a line
_LEAK_BINS = 4.0
#: share of a line that is left where what a drive has at its frequency is taken out
_TOLD_APART = 0.2
#: share of its range by which a drive moves, periods of a line that it has to rest for before, and the share of a line
#: that is there at rest, so many of its standard errors up: mains is there whatever the drive does
_STIRS, _RESTS_PERIODS, _AT_REST, _RESTS_SDS = 0.02, 10.0, 0.5, 4.0
#: a gap that counts (s), and the share of a recording in such gaps from which on only its longest stretch is looked at:
#: a line drawn across a gap holds no mains, and no noise either
_GAP_S, _MOST_GAPS = 0.2, 0.1


@dataclass(frozen=True)
class MainsLine:
    """One line: amplitude cos(2 pi frequency_Hz t + phase_rad), t as in `time_s` of the recording."""

    harmonic: int
    frequency_Hz: float
    amplitude: float
    amplitude_se: float
    phase_rad: float
    false_alarm: float  # probability of a line this strong without mains, all trials counted


@dataclass(frozen=True)
class Mains:
    """Lines found in one recording, in the unit of its output."""

    base_Hz: float  # 50 or 60
    frequency_Hz: float  # refined fundamental
    lines: tuple[MainsLine, ...]
    coherent: bool  # whether one frequency describes the whole recording
    taken_over: bool = False  # a line that others of the campaign show and this one cannot (see `site_lines`)

    @property
    def amplitude(self) -> float:
        """Amplitude of the strongest line."""
        return max(line.amplitude for line in self.lines)

    @property
    def false_alarm(self) -> float:
        """Smallest false-alarm probability of the lines."""
        return min(line.false_alarm for line in self.lines)

    def with_lines(self, lines: Iterable[MainsLine]) -> Mains:
        """The same with these lines; the frequency is that of the first where all were taken over."""
        new = tuple(lines)
        base = new[0].frequency_Hz / new[0].harmonic if self.taken_over else self.frequency_Hz
        return replace(self, lines=new, frequency_Hz=base)

    def signal(self, time_s: ArrayLike) -> Array:
        """Sum of the lines at the given times."""
        t = np.asarray(time_s, dtype=float)
        total = np.zeros(t.shape)
        for line in self.lines:
            total += line.amplitude * np.cos(2 * np.pi * line.frequency_Hz * t + line.phase_rad)
        return total


def find_mains(y: ArrayLike, time_s: ArrayLike, u: ArrayLike | None = None, *, false_alarm: float = 1e-4,
               mask: ArrayLike | None = None) -> Mains | None:
    """Mains lines in a recording or in its residuals; None where none is significant.

    The power of differences of y (steps become single points, cut at six robust sds) is averaged over Hann
    segments (Welch) of 16 s, and again of 128 s: short ones find a line that wanders, long ones a weak one.
    Power in a line's band (+-1 %) is held against the median of its surroundings, which is what a coloured
    spectrum has there; the false-alarm probability is that of an F ratio, times the number of bins, bands
    and lengths tried. The strongest line gives the frequency, by demodulation of the whole record. Segments
    hold a million samples at most.

    A line counts as the drive's where u or u^2, times the gain that y shows at their strongest lines,
    explains a tenth of it; where the drive is periodic and the line one of its multiples, it must also
    stand four times above the neighbouring multiples. One that is not there at rest, before u moves, is none: a mass
    near 50 Hz that steps make ring. A model's residuals as y show more than raw data do.

    Parameters
    ----------
    y : output or residual, shape (n,); nan cells are bridged.
    time_s : shape (n,), rising. Uneven steps are interpolated; where the sampler was slower for a while, or much is
        missing, the longest stretch of the others is looked at.
    u : drive, shape (n,).
    false_alarm : largest probability at which a line is believed.
    mask : True where y is not to be used (drop-outs).
    """
    t, x = on_even_steps(np.asarray(time_s, dtype=float), np.asarray(y, dtype=float), mask)
    if t.size < 64:
        return None
    step = (t[-1] - t[0]) / (t.size - 1)
    if 0.5 / step < 50 * (1 + _TOLERANCE) or t[-1] - t[0] < 0.5:
        return None  # fewer than 25 periods, or a band that cannot be seen
    d = _cut_peaks(x)
    seconds = d.size * step
    # of a fast sampler they are shorter, as a segment is held in memory
    longest = max(BLOCK * step, 0.5)
    lengths = sorted({min(s, longest) for s in _SEGMENTS_S if seconds > 1.5 * min(s, longest)}) or [seconds]
    trials = len(lengths) * sum(_harmonics(base, step) for base in (50.0, 60.0))
    best: _Hits | None = None
    drive_rows = None if u is None else _on_grid(u, np.asarray(time_s, dtype=float), t)
    for length in lengths:
        spectrum = _welch(lambda first, stop: d[first:stop], d.size, step, length)
        found = {base: _lines(base, spectrum, trials, false_alarm, step) for base in (50.0, 60.0)}
        if drive_rows is not None and any(found.values()):
            drive = _drive(drive_rows, spectrum, step, length)
            found = {base: [line for line in lines if not _of_drive(spectrum, line[1], drive)]
                     for base, lines in found.items()}
        for base, lines in found.items():
            hits = _Hits(base, spectrum, tuple(lines))
            if hits.lines and (best is None or hits.score > best.score):
                best = hits
    if best is None:
        return None
    mains = _refine(best, d, t, step, drive_rows)
    return None if drive_rows is not None and _silent_at_rest(mains, d, step, drive_rows) else mains


@dataclass(frozen=True)
class _Spectrum:
    f: Array
    p: Array
    dof: float


@dataclass(frozen=True)
class _Hits:
    base: float
    spectrum: _Spectrum
    lines: tuple[tuple[int, int, float], ...]  # harmonic, bin, false-alarm probability

    @property
    def score(self) -> float:
        return sum(-math.log10(max(p, 1e-300)) for _, _, p in self.lines)


def _lines(base: float, spectrum: _Spectrum, trials: int, false_alarm: float,
           step: float) -> list[tuple[int, int, float]]:
    hits = []
    for h in range(1, _harmonics(base, step) + 1):
        hit = _band(spectrum, h * base)
        if hit is not None and hit[1] * trials < false_alarm:
            hits.append((h, hit[0], hit[1] * trials))
    return hits


def _harmonics(base: float, step: float) -> int:
    return min(_HIGHEST_HARMONIC, int(0.5 / step / (base * (1 + _TOLERANCE))))


def on_even_steps(t: Array, y: Array, mask: ArrayLike | None = None) -> tuple[Array, Array]:
    """Recording on even steps, without nan; nothing where too little was read. Where more than a tenth of it lies in
    gaps it is the longest stretch between them."""
    good = computed(lambda a, b: np.isfinite(a) & np.isfinite(b), t, y, dtype=np.bool_)
    if mask is not None:
        good &= ~np.asarray(mask, dtype=bool)
    if np.count_nonzero(good) < 64:
        return np.empty(0), np.empty(0)
    tg, yg = kept(t, good), kept(y, good)
    pace = pace_of(tg)
    # lines through what was read at a slower pace have lines of their own
    fast, step = pace.longest_fast(tg.size), pace.step_s
    tg, yg = tg[fast], yg[fast]
    whole = _longest_whole(tg)
    tg, yg = tg[whole], yg[whole]
    if tg.size < 64:
        return np.empty(0), np.empty(0)
    if tg.size == t.size and max(float(np.max(np.abs(d - step))) for d in differences(tg)()) < 0.05 * step:
        return tg, yg
    grid = beside(tg, n=int((tg[-1] - tg[0]) / step) + 1)
    for part in pieces(grid.size, BLOCK):
        grid[part] = tg[0] + step * np.arange(part.start, part.stop)
    return grid, _at(grid, tg, yg)


def _longest_whole(t: Array) -> slice:
    """Rows of the longest stretch between gaps where these are much of the times t (n,); else all rows."""
    before = rows_where(lambda later, row: later - row > _GAP_S, t[1:], t[:-1])
    if np.sum(t[before + 1] - t[before]) <= _MOST_GAPS * (t[-1] - t[0]):
        return slice(0, t.size)
    first, last = np.append(0, before + 1), np.append(before, t.size - 1)
    longest = int(np.argmax(t[last] - t[first]))
    return slice(int(first[longest]), int(last[longest]) + 1)


def _at(grid: Array, t: Array, y: Array) -> Array:
    """Straight lines through (t, y) at the times of a grid (n,)."""
    out = beside(grid)
    for part in pieces(grid.size, BLOCK):
        # only what lies around: of all that is given numpy takes every slope
        low, high = np.searchsorted(t, [grid[part.start], grid[part.stop - 1]])
        near = slice(max(int(low) - 2, 0), int(high) + 2)
        out[part] = np.interp(grid[part], t[near], y[near])
    return out


def _cut_peaks(x: Array) -> Array:
    """Differences of x, less their median, within six robust sds."""
    d = beside(x, n=x.size - 1)
    for part in pieces(d.size, BLOCK):
        d[part] = np.diff(x[part.start:part.stop + 1])
    middle = median(of(d))
    scale = 1.4826 * median(of(d, lambda piece: np.abs(piece - middle)))
    if scale == 0:
        mean = sum(float(np.sum(d[part])) for part in pieces(d.size, BLOCK)) / d.size
        scale = math.sqrt(sum(float(np.sum((d[part] - mean) ** 2)) for part in pieces(d.size, BLOCK)) / d.size)
    for part in pieces(d.size, BLOCK):
        d[part] = np.clip(d[part] - middle, -6 * scale, 6 * scale)
    return d


def _welch(rows: _Rows, n: int, step: float, seconds: float) -> _Spectrum:
    """Mean power of Hann segments with half overlap; about two degrees of freedom a segment and bin."""
    from scipy import fft

    # segments of nearly the wished length that tile the record
    number = max(1, round(2 * n * step / seconds) - 1)
    length = fft.prev_fast_len(2 * n // (number + 1), real=True)
    starts = np.linspace(0, n - length, number).astype(int)
    window = np.hanning(length + 1)[:-1]
    total = np.zeros(length // 2 + 1)
    for first in starts:
        piece = fft.rfft(rows(first, first + length) * window)
        total += piece.real**2 + piece.imag**2
    # neighbouring Hann segments at half overlap correlate with (1/6)^2 in power
    dof = 2.0 * number / (1.0 + 2.0 / 36.0 * (number > 1))
    return _Spectrum(fft.rfftfreq(length, step), total / number, dof)


@dataclass(frozen=True)
class _Drive:
    fundamental_Hz: float  # 0 where the drive is not periodic
    power: tuple[Array, ...]  # of u and of u^2, as differences
    strongest: tuple[NDArray[np.int64], ...]  # bins of their strongest lines


def _on_grid(u: ArrayLike, time: Array, grid: Array) -> Array | None:
    """A drive (n,) read at `time` on even steps; None where there is none, or nothing of it changes."""
    v = np.asarray(u, dtype=float)
    good = computed(lambda a, b: np.isfinite(a) & np.isfinite(b), v, time, dtype=np.bool_)
    if np.count_nonzero(good) < 2:
        return None
    on_grid = v if v.size == grid.size and all_finite(v) and all_finite(time) else _at(
        grid, kept(time, good), kept(v, good))
    return None if on_grid.max() == on_grid.min() else on_grid


def _drive(on_grid: Array, spectrum: _Spectrum, step: float, seconds: float) -> _Drive:
    power, strongest, fundamental = [], [], 0.0
    for k in (1, 2):
        p = _welch(lambda first, stop, k=k: np.diff(on_grid[first:stop + 1]**k),  # type: ignore[misc]
                   on_grid.size - 1, step, seconds).p
        power.append(p)
        strongest.append(np.argsort(p)[-6:])
        if k == 1:
            # periodic: lines far above what lies between them; the lowest is the fundamental
            lines = np.flatnonzero((p > 0.02 * p[2:].max()) & (p > 100 * np.median(p)))
            if lines.size:
                first = int(lines[0])
                fundamental = _peak(spectrum.f, p, first + int(np.argmax(p[first:first + 4])))
    return _Drive(fundamental, tuple(power), tuple(strongest))


def _peak(f: Array, p: Array, k: int) -> float:
    """Frequency of a Hann-windowed tone from its two largest bins (doi 10.1109/TIM.1983.4315077)."""
    if not 0 < k < p.size - 1:
        return float(f[k])
    side = 1 if p[k + 1] > p[k - 1] else -1
    ratio = math.sqrt(p[k + side] / p[k])
    return float(f[k] + side * (2 * ratio - 1) / (1 + ratio) * (f[1] - f[0]))


def _band(spectrum: _Spectrum, centre: float) -> tuple[int, float] | None:
    """Largest bin of a band and its false-alarm probability; None where it cannot be told."""
    from scipy.special import betainc

    f, p, dof = spectrum.f, spectrum.p, spectrum.dof
    df = float(f[1] - f[0])
    low, high = np.searchsorted(f, [centre * (1 - _TOLERANCE) - df, centre * (1 + _TOLERANCE) + df])
    if high - low < 3 or high >= f.size:
        return None
    k = int(low + np.argmax(p[low:high]))
    wide = max(5.0, 0.1 * centre, 60 * df)
    near = np.flatnonzero((np.abs(f - centre) < wide) & (np.abs(np.arange(f.size) - k) > 3))
    if near.size < 20:
        return None
    # level at the line: a straight line through both sides, so that a sloping spectrum does no harm
    sides = [side for side in (near[near < k], near[near > k]) if side.size >= 10]
    medians = [math.log(max(float(np.median(p[side])), 1e-300)) for side in sides]
    level = math.exp(float(np.interp(f[k], [float(np.mean(f[side])) for side in sides], medians)))
    ratio = p[k] * _median_of_mean(dof) / level
    # the median is 0.48 as efficient as a mean, Hann bins count 0.65 each
    reference = 0.3 * dof * near.size
    tail = float(betainc(reference / 2, dof / 2, reference / (reference + dof * ratio)))
    return k, 1.0 - (1.0 - tail) ** (high - low) if tail > 1e-12 else tail * (high - low)


def _median_of_mean(dof: float) -> float:
    """Median over mean of a chi-square with dof degrees of freedom."""
    from scipy.special import gammaincinv

    return float(gammaincinv(dof / 2, 0.5) / (dof / 2))


def _of_drive(spectrum: _Spectrum, k: int, drive: _Drive) -> bool:
    """Whether the drive explains bin k; see `find_mains`."""
    f, p = spectrum.f, spectrum.p
    for power, strongest in zip(drive.power, drive.strongest, strict=True):
        # what y shows at the drive's strongest lines, above its noise there
        shown = sum(max(0.0, float(p[i]) - 10 * _noise_level(p, int(i))) for i in strongest)
        whole = float(np.sum(power[strongest]))
        if whole > 0.0 and shown / whole * power[max(k - 1, 0):k + 2].max() > 0.1 * p[k]:
            return True
    df = f[1] - f[0]
    base = drive.fundamental_Hz
    if base <= 0:
        return False
    order = round(_peak(f, p, k) / base)
    if order < 1 or abs(f[k] - order * base) > 2 * df + 0.02 * df * order:
        return False
    level = 0.0
    # far enough away that the line itself does not leak there: multiples of 0.1 Hz lie within one bin or two
    apart = math.ceil(_LEAK_BINS * df / base)
    for other in (order - 2 * apart, order - apart, order + apart, order + 2 * apart):
        at = round(other * base / df)
        if other >= 1 and at + 1 < p.size:
            level = max(level, float(p[max(at - 1, 0):at + 2].max()) / float(f[at]) ** 2)
    return bool(p[k] / f[k] ** 2 < 16 * level)


def _refine(hits: _Hits, d: Array, t: Array, step: float, drive: Array | None) -> Mains:
    """Frequency, amplitudes and phases by demodulation of the whole record. drive: on the same steps."""
    f, p = hits.spectrum.f, hits.spectrum.p
    strongest = max(hits.lines, key=lambda line: float(p[line[1]]))
    chunk = max(1, round(0.5 / step))
    fine, coherent = _fine_frequency(d, step, _peak(f, p, strongest[1]), chunk, drive)
    fundamental = fine / strongest[0]
    shaped = beside(d)
    for part in pieces(d.size, BLOCK):
        # rows of np.hanning(d.size + 2) without its ends
        shaped[part] = d[part] * (0.5 + 0.5 * np.cos(np.pi * (2.0 * np.arange(part.start, part.stop) + 1 - d.size)
                                                     / (d.size + 1)))
    window_sum, window_squares = 0.5 * (d.size + 1), 0.375 * (d.size + 1)
    segment_squares = 0.375 * 2 * (p.size - 1)
    lines = []
    for h, k, probability in hits.lines:
        w = 2 * math.pi * h * fundamental
        chunks, _ = _demodulate(shaped, step, w, chunk)
        rest = shaped[chunks.size * chunk:]
        z = np.sum(chunks) + np.sum(rest * np.exp(-1j * w * step * np.arange(chunks.size * chunk, d.size)))
        # a difference belongs to the middle of its interval, and sees 2i sin(w step/2) of the line
        response = 2j * math.sin(0.5 * w * step)
        a = complex(2 * z / window_sum / response * np.exp(-1j * w * (t[0] + 0.5 * step)))
        variance = 2 * _noise_level(p, k) / segment_squares * window_squares / window_sum**2
        lines.append(MainsLine(
            harmonic=h, frequency_Hz=h * fundamental, amplitude=abs(a),
            amplitude_se=math.sqrt(variance) / abs(response), phase_rad=math.atan2(a.imag, a.real),
            false_alarm=float(min(1.0, probability))))
    return Mains(base_Hz=hits.base, frequency_Hz=fundamental, lines=tuple(lines), coherent=coherent)


def _silent_at_rest(mains: Mains, d: Array, step: float, drive: Array) -> bool:
    """Whether the strongest line is not there before the drive moves: what it kicks is a mass that rings.

    d, drive: see `_refine`. Nothing is said where the drive moves at once, or never.
    """
    stirs = _STIRS * float(drive.max() - drive.min())
    moves = ((p.start, np.abs(drive[p] - drive[0]) > stirs) for p in pieces(drive.size, BLOCK))
    rest = next((start + int(np.argmax(moved)) for start, moved in moves if moved.any()), 0)
    line = max(mains.lines, key=lambda one: one.amplitude)
    rest = min(rest, BLOCK)  # enough, and no more than is held in memory
    if rest * step < _RESTS_PERIODS / line.frequency_Hz:
        return False
    w = 2 * math.pi * line.frequency_Hz
    window = np.hanning(rest + 2)[1:-1]
    z = np.sum(window * d[:rest] * np.exp(-1j * w * step * np.arange(rest)))
    # around a line that rings there is more than noise: what scatters at rest tells how well one is seen there
    response = abs(2j * math.sin(0.5 * w * step)) * float(window.sum()) / 2.0
    size, se = abs(z) / response, float(np.std(d[:rest])) * math.sqrt(0.5 * float(window @ window)) / response
    return bool(size + _RESTS_SDS * se < _AT_REST * line.amplitude)


def _demodulate(d: Array, step: float, w: float, chunk: int) -> tuple[NDArray[np.complex128], int]:
    """Sums of d exp(-i w t) over chunks, t from the first sample; the exponential is taken once a chunk."""
    n = d.size // chunk
    carrier = np.exp(-1j * w * step * np.arange(chunk))
    sums = np.empty(n, np.complex128)
    for part in pieces(n, max(1, BLOCK // chunk)):
        rows = d[part.start * chunk:part.stop * chunk].reshape(-1, chunk)
        sums[part] = rows @ carrier.real + 1j * (rows @ carrier.imag)
    return sums * np.exp(-1j * w * step * chunk * np.arange(n)), n


def _noise_level(p: Array, k: int) -> float:
    near = np.concatenate([p[max(0, k - 40):max(0, k - 3)], p[k + 4:k + 40]])
    return float(np.median(near))


def _fine_frequency(d: Array, step: float, coarse: float, chunk: int, drive: Array | None = None
                    ) -> tuple[float, bool]:
    """Frequency at which the demodulated record adds up most, and whether it stays in phase.

    What the square of a drive has there, times one complex number, is taken out: a wave of 100 um that begins within a
    chunk leaves more in it than a line of half a micrometre.
    """
    w = 2 * math.pi * coarse
    z, n = _demodulate(d, step, w, chunk)
    if n < 4:
        return coarse, True
    window = np.hanning(n + 2)[1:-1]
    size = 1 << (int(math.log2(n)) + 4)
    told = np.full(size, window.sum())
    if drive is not None:
        squares = beside(d)
        for part in pieces(d.size, BLOCK):
            squares[part] = np.diff(drive[part.start:part.stop + 1] ** 2)
        driven, _ = _demodulate(squares, step, w, chunk)
        whole = float(np.sum(window * np.abs(driven) ** 2))
        if whole > 0.0:
            beside_it = told - np.abs(np.fft.fft(driven * window, size)) ** 2 / whole
            # at frequencies that the drive cannot be told from nothing is taken out
            if beside_it.min() > _TOLD_APART * window.sum():
                z, told = z - driven * (np.vdot(driven, window * z) / whole), beside_it
    spectrum = np.abs(np.fft.fft(z * window, size)) / np.sqrt(told)
    offsets = np.fft.fftfreq(size, chunk * step)
    k = int(np.argmax(np.where(np.abs(offsets) < 0.25 / (chunk * step), spectrum, 0.0)))
    left, centre, right = (float(np.log(spectrum[(k + i) % size] + 1e-300)) for i in (-1, 0, 1))
    curvature = left - 2 * centre + right
    shift = 0.5 * (left - right) / curvature if curvature < 0 else 0.0
    fine = coarse + float(offsets[k]) + shift / (size * chunk * step)
    # a line that wanders adds up over quarters of the record but not over the whole
    turned = z * np.exp(-2j * np.pi * (fine - coarse) * chunk * step * np.arange(n))
    quarters = sum(abs(np.sum(part)) for part in np.array_split(turned, 4))
    return float(fine), bool(abs(np.sum(turned)) > 0.8 * quarters)

"""What the course of a signal says: which kind of recording, which column drives and which answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MOST = 40_000  # samples looked at; a shape needs no more


@dataclass(frozen=True)
class Shape:
    """Kind of a recording and the reason; `sure` false where another kind fits nearly as well."""

    kind: str
    why: str
    sure: bool = True


@dataclass(frozen=True)
class Run:
    """Consecutive samples first ... last-1 with the signal held at `level`."""

    first: int
    last: int
    level: float


def span(values: Array) -> float:
    """Largest minus smallest finite value."""
    return float(np.nanmax(values) - np.nanmin(values)) if np.isfinite(values).any() else 0.0


def scatter(values: Array) -> float:
    """Standard deviation of white noise on a smooth signal, from its differences (edges do not count).

    Differences of second and of fourth order see the same white noise; a smooth curve of few samples a period shows in
    the second ones only, so the smaller estimate is taken.
    """
    finite = values[np.isfinite(values)]
    if finite.size < 6:
        return 0.0
    second = np.diff(finite, 2)
    fourth = np.diff(second, 2)
    return float(1.4826 * min(np.median(np.abs(second)) / np.sqrt(6.0), np.median(np.abs(fourth)) / np.sqrt(70.0)))


def is_reading(values: Array) -> bool:
    """Whether a signal carries the noise of a measurement: white differences beyond rounding, and no mere curvature."""
    finite = values[np.isfinite(values)]
    noise = scatter(finite)
    if finite.size < 50 or noise < 3e-5 * span(finite) or noise < 0.5 * step_between(finite):
        return False
    fourth = np.diff(finite, 4)
    limit = 6.0 * noise * np.sqrt(70.0)  # edges of a rectangle are no noise
    quiet = np.abs(fourth) < limit
    both = quiet[1:] & quiet[:-1]
    a, b = fourth[1:][both], fourth[:-1][both]
    return bool(a.size > 20 and float(np.mean(a * b)) < -0.4 * float(np.mean(a * a)))  # white noise: -0.8


def step_between(values: Array) -> float:
    """Smallest step between values that differ: the resolution of whatever recorded them."""
    distinct = np.unique(values[np.isfinite(values)])
    if distinct.size < 3:
        return 0.0
    steps = np.diff(distinct)
    return float(np.median(steps[steps <= 2.0 * np.percentile(steps, 10)]))


def filled(values: Array) -> Array:
    """The signal with gaps bridged by straight lines."""
    good = np.isfinite(values)
    if good.all() or not good.any():
        return values
    index = np.arange(values.size)
    return np.interp(index, index[good], values[good])


# -- voltage ------------------------------------------------------------------------------------------------------


def active(voltage: Array) -> tuple[int, int]:
    """First and one past the last sample at which the signal is not at the level it rests on at either end."""
    v = filled(voltage)
    tolerance = max(0.005 * span(v), 5.0 * scatter(v))
    moving = np.flatnonzero(np.abs(v - v[0]) > tolerance)
    if moving.size == 0:
        return 0, v.size
    first = max(int(moving[0]) - 1, 0)
    moving = np.flatnonzero(np.abs(v - v[-1]) > tolerance)
    return first, min(int(moving[-1]) + 2, v.size) if moving.size else v.size


def _percent(misfit: float) -> str:
    """A relative misfit in words; what rounding leaves of an exact wave is no number to look at."""
    return f"{100 * misfit:.2g} %" if misfit >= 1e-4 else "below 0.01 %"


def voltage_shape(time: Array, voltage: Array) -> Shape:
    """Kind of a voltage recording: creep, sine, triangle, rectangle, or voltage for everything else."""
    v = filled(voltage)
    total = span(v)
    if total <= max(1e-9 * float(np.abs(v).max()), 8.0 * scatter(v)) or total == 0.0:
        return Shape(
            "creep" if abs(float(np.median(v))) > 0 else "voltage",
            f"the voltage stays at {np.median(v):.4g} V",
            sure=False,
        )
    levels = _two_levels(time, v)
    if levels is not None:
        return levels
    first, last = active(v)
    t, v = time[first:last], v[first:last]
    linear = next((s for s in (_triangle(t, v, n) for n in (200, 60, 24)) if s is not None), None)
    fits = _periodic(t, v)
    if fits is not None:
        name, residual, second, frequency, cycles = fits
        if residual < 0.12 and second > 1.8 * residual:
            return Shape(
                name,
                f"{cycles:.3g} periods of a {name} at {frequency:.4g} Hz (misfit {_percent(residual)}, "
                f"next best {_percent(second)})",
            )
    if linear is not None:
        return linear
    if fits is None:
        short = _short_sine(t, v)
        if short is not None:
            return short
    return Shape("voltage", "neither steps to one level nor a sine, triangle or rectangle")


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _two_levels(time: Array, v: Array) -> Shape | None:
    """Creep or rectangle where the signal spends its time at two levels."""
    low, high = _levels(v)
    total = high - low
    if total <= 0:
        return None
    near_high, near_low = np.abs(v - high) < 0.1 * total, np.abs(v - low) < 0.1 * total
    if float(np.mean((v < low - 0.15 * total) | (v > high + 0.15 * total))) > 0.02:
        return None  # it goes beyond both: a wave with rests before and after
    at_levels = float(np.mean(near_high | near_low))
    on = v > low + 0.5 * total
    if abs(low) > abs(high):
        on = ~on  # a negative command: on is the level away from zero
    pulses = _runs(on)
    if not pulses:
        return None
    step = float(np.median(np.diff(time)))
    durations = np.array([time[b - 1] - time[a] + step for a, b in pulses])
    # a slow supply spends part of its time between the levels, with a fast edge at the start of each pulse
    if at_levels < 0.9 and not (at_levels > 0.6 and _fast_edges(time, v, pulses, total, durations)):
        return None
    level = high if abs(high) >= abs(low) else low
    if len(pulses) == 1:
        return Shape("creep", f"one step to {level:.4g} V, held for {durations[0]:.4g} s")
    others = durations[:-1]
    if durations[-1] >= 2.5 * others.max() and float(np.ptp(others)) < 0.1 * float(others.mean()):
        return Shape(
            "creep",
            f"{len(pulses) - 1} conditioning step{'s' if len(pulses) > 2 else ''} of "
            f"{np.median(others):.3g} s, then {level:.4g} V held for {durations.max():.4g} s",
        )
    starts = np.array([time[a] for a, _ in pulses])
    gaps = np.diff(starts)
    inner = durations[1 if pulses[0][0] == 0 else 0 : -1 if pulses[-1][1] == v.size else None]  # the ends may be cut
    equal = inner.size < 2 or float(np.ptp(inner)) < 0.2 * float(inner.mean())
    regular = equal and (gaps.size < 2 or float(gaps.std()) < 0.05 * float(gaps.mean()))
    if regular:
        return Shape(
            "rectangle",
            f"{len(pulses)} equal pulses to {level:.4g} V, one every {gaps.mean():.4g} s",
            sure=len(pulses) > 2 or not _long_rest(durations, gaps),
        )
    return Shape("voltage", f"{len(pulses)} steps to one level at uneven times")


def _long_rest(durations: Array, gaps: Array) -> bool:
    return bool(gaps.mean() > 2.5 * durations.mean())


def _levels(v: Array) -> tuple[float, float]:
    """Lower and upper level of a signal of two levels: medians of what lies nearest to either end."""
    low, high = np.percentile(v, [1.0, 99.0])
    middle = 0.5 * (low + high)
    below, above = v[v < middle], v[v >= middle]
    if below.size == 0 or above.size == 0:
        return float(low), float(high)
    return float(np.median(below)), float(np.median(above))


def _fast_edges(time: Array, v: Array, pulses: list[tuple[int, int]], total: float, durations: Array) -> bool:
    """Whether each pulse that begins inside the recording rises within a twentieth of its duration."""
    step = float(np.median(np.diff(time)))
    sign = 1.0 if np.median(v[np.concatenate([np.arange(a, b) for a, b in pulses])]) > np.median(v) else -1.0
    checked = 0
    for a, _ in pulses:
        back = a - max(2, round(0.05 * float(np.median(durations)) / step))
        if a == 0 or back < 0:
            continue
        checked += 1
        if sign * (v[min(a + (a - back), v.size - 1)] - v[back]) < 0.7 * total:
            return False
    return checked > 0


def _short_sine(t: Array, v: Array) -> Shape | None:
    """A sine of one to three periods, by least squares over frequencies."""
    ends = max(3, v.size // 100)  # where it is switched on and off
    step = max(1, v.size // 500)
    x, y = t[ends:-ends:step], v[ends:-ends:step]
    if x.size < 20:
        return None
    x = x - x[0]
    duration, spread = float(x[-1]), float(y.std())
    if spread == 0.0:
        return None
    best, cycles = 1.0, 0.0
    for c in np.linspace(0.9, 3.2, 116):
        phase = 2 * np.pi * c * x / duration
        design = np.column_stack([np.sin(phase), np.cos(phase), np.ones(x.size)])
        residual = float((y - design @ np.linalg.lstsq(design, y, rcond=None)[0]).std()) / spread
        if residual < best:
            best, cycles = residual, float(c)
    if best > 0.05:
        return None
    return Shape("sine", f"{cycles:.3g} periods of a sine at {cycles / duration:.4g} Hz (misfit {_percent(best)})")


def _triangle(t: Array, v: Array, pieces: int) -> Shape | None:
    """Straight ramps of one steepness that turn at two levels, looked at in so many pieces."""
    if v.size < 2 * pieces:
        return None
    edges = np.linspace(0, v.size, pieces + 1).astype(int)
    means = np.add.reduceat(v, edges[:-1]) / np.diff(edges)
    times = np.add.reduceat(t, edges[:-1]) / np.diff(edges)
    slopes = np.diff(means) / np.diff(times)
    typical = float(np.median(np.abs(slopes)))
    if typical == 0.0:
        return None
    straight = np.abs(np.abs(slopes) - typical) < 0.12 * typical
    turns = int(np.count_nonzero(np.diff(np.sign(slopes[straight]))))
    if np.mean(straight) < 0.85 or turns == 0:
        return None
    return Shape(
        "triangle",
        f"straight ramps of {typical:.4g} V/s that turn {turns} time{'s' if turns > 1 else ''}",
        sure=turns >= 2 or abs(float(v[0] - v[-1])) < 0.1 * span(v),
    )


def _periodic(t: Array, v: Array) -> tuple[str, float, float, float, float] | None:
    """(best shape, its misfit, next misfit, frequency, cycles) where the signal repeats; misfits relative to
    amplitude.
    """
    middle = 0.5 * (np.percentile(v, 1) + np.percentile(v, 99))
    amplitude = 0.5 * float(np.percentile(v, 99) - np.percentile(v, 1))
    state = np.where(v > middle + 0.2 * amplitude, 1, np.where(v < middle - 0.2 * amplitude, -1, 0))
    known = np.flatnonzero(state)
    rising = known[1:][np.diff(state[known]) > 0]
    if rising.size < 3 or amplitude == 0.0:
        return None
    periods = np.diff(t[rising])
    if periods.std() > 0.05 * periods.mean() + (t[1] - t[0]):
        return None
    # whole periods only, at most ten: enough for the shape, and a frequency that is a little off does no harm
    last = min(rising.size - 1, 10)
    a, b = int(rising[0]), int(rising[last])
    frequency = last / float(t[b] - t[a])
    x, y = t[a:b], v[a:b]
    if x.size < 8 * last:
        return None
    phase = 2 * np.pi * frequency * (x - x[0])
    misfits = {}
    c1 = np.exp(-1j * phase) @ (y - y.mean()) * 2 / y.size
    angle = float(np.angle(c1)) + np.pi / 2  # of the fundamental, written as a sine
    shifted = phase + angle
    sine = np.sin(shifted)
    for name, wave in (
        ("sine", sine),
        ("triangle", 2 / np.pi * np.arcsin(np.clip(sine, -1, 1))),
        ("rectangle", np.sign(sine)),
    ):
        design = np.column_stack([wave, np.ones(wave.size)])
        residual = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
        misfits[name] = float(np.sqrt(np.mean(residual**2))) / amplitude
    order = sorted(misfits, key=misfits.__getitem__)
    cycles = float(t[-1] - t[0]) * frequency
    return order[0], misfits[order[0]], misfits[order[1]], frequency, cycles


# -- mechanics ----------------------------------------------------------------------------------------------------


class _Pieces(NamedTuple):
    """A signal in 200 pieces: their means, the sd that noise leaves in one, and the span of the whole."""

    means: Array
    noise: float
    span: float


def _pieces(values: Array) -> _Pieces:
    v = filled(values)
    edges = np.linspace(0, v.size, min(200, v.size) + 1).astype(int)
    lengths = np.diff(edges)
    noise = scatter(v) / float(np.sqrt(max(1.0, float(lengths.mean()))))
    return _Pieces(np.add.reduceat(v, edges[:-1]) / lengths, noise, span(v))


def _moves(signal: _Pieces, share: float) -> NDArray[np.bool_]:
    """Where it moves by more than its noise and `share` of its span from one piece to the next."""
    return np.abs(np.diff(signal.means)) > max(share * signal.span, 5.0 * signal.noise)


def _drifts(length: _Pieces, force: _Pieces) -> tuple[float, float]:
    """How far each goes on, in shares of its span, during the longest stretch in which neither leaps.

    The one that is held stays where it is, the other creeps or relaxes; 0 for what noise could be.
    """
    leaps = np.flatnonzero(_moves(length, 0.02) | _moves(force, 0.02))
    bounds = np.concatenate([[-1], leaps, [length.means.size - 1]])
    longest = int(np.argmax(np.diff(bounds)))
    first, last = int(bounds[longest]) + 1, int(bounds[longest + 1]) + 1
    tenth = max(1, (last - first) // 10)
    out = []
    for means, noise, whole in (length, force):
        drift = abs(float(means[last - tenth : last].mean() - means[first : first + tenth].mean()))
        out.append(drift / whole if drift > 5.0 * noise * (2.0 / tenth) ** 0.5 else 0.0)
    return out[0], out[1]


def mechanical_shape(length: Array, force: Array) -> Shape:
    """relaxation (length held), load (force held) or compression (both move), from who holds still.

    What moves by more than its noise and 0.2 % of its span is not still. Where both are for most of the time, the one
    that is held is the one that does not drift meanwhile.
    """
    x, f = _pieces(length), _pieces(force)
    moves_length, moves_force = (float(np.mean(_moves(signal, 0.002))) for signal in (x, f))
    held = moves_length <= moves_force
    if max(moves_length, moves_force) < 0.3:
        drift_length, drift_force = _drifts(x, f)
        if drift_length != drift_force:
            held = drift_length < drift_force
    if moves_length < 0.3 and held:
        return Shape(
            "relaxation", f"the position moves during {100 * moves_length:.2g} % of the time and is held otherwise"
        )
    if moves_force < 0.3 and not held:
        return Shape("load", f"the force changes during {100 * moves_force:.2g} % of the time and is held otherwise")
    return Shape("compression", "position and force move all the time", sure=True)


def buckling_number(length: Array, force: Array) -> float:
    """How far a compression of this travel and force would be beyond buckling, for a column of 10 kPa or stiffer.

    A clamped square column of side a and height h buckles at a strain of 3.3 (a/h)^2 (Euler); with the modulus Y,
    force F = Y a^2 e and travel x = e h this is reached when Y x^2 / (3.3 F) exceeds 1, whatever the height.
    """
    travel, load = span(filled(length)), span(filled(force))
    return 1e4 * travel**2 / (3.3 * load) if load > 0 else 0.0


# -- who drives whom ----------------------------------------------------------------------------------------------


def follows(time: Array, cause: Array, effect: Array) -> tuple[float, float]:
    """(part of the variance of `effect` that the squared cause explains, sign of the gain).

    The square is taken as it is and through five first-order lags, which is what creep and delay look like.
    """
    c, e = filled(cause), filled(effect)
    if span(c) == 0.0 or span(e) == 0.0:
        return 0.0, 0.0
    step = max(1, c.size // _MOST)
    t, u, y = time[::step], np.square(c[::step]), e[::step]
    u = u / float(np.abs(u).max())
    dt = float(np.median(np.diff(t)))
    duration = max(float(t[-1] - t[0]), dt)
    from scipy.signal import lfilter

    columns = [u]
    for share in (0.003, 0.01, 0.03, 0.1, 0.3):
        a = float(np.exp(-dt / (share * duration)))
        columns.append(lfilter([1 - a], [1, -a], u - u[0]) + u[0])
    design = np.column_stack([*columns, np.ones(u.size)])
    coefficients = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ coefficients
    explained = 1.0 - float(residual.var() / y.var())
    fitted = design[:, :-1] @ coefficients[:-1]
    gain = float(np.dot(u - u.mean(), fitted - fitted.mean()))
    return max(explained, 0.0), float(np.sign(gain))

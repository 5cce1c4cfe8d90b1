"""Whether a recording can come from its actuator: units off by a power of ten, and what is worth a warning.

Only clear cases are errors. The yardstick of a voltage recording is Maxwell stress on a Hookean stack of
1 MPa (Pelrine 1998, doi:10.1016/S0924-4247(97)01657-9, with electrode and total area as in CONTRACT 1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.checks import first_row
from bayes_dea.campaign.holes import some_steps
from bayes_dea.campaign.schema import Actuator, Recording, Sensor
from bayes_dea.campaign.scratch import computed, pieces
from bayes_dea.campaign.settings import MAX_FIELD
from bayes_dea.errors import InputError

_EPS0 = 8.8541878128e-12  # F/m
TYPICAL_MODULUS = 1e6  # Pa
#: strokes this far from the yardstick, either way, are a wrong unit (kV for V is 1e6, mm for m is 1e3)
_STROKE_FACTOR = 200.0
_LONG_S = 3 * 86400.0
#: what a message ends with when the user may know better
OVERRIDE = 'If it is right as it is, set plausibility = "warn" in [conventions].'
#: rows of one of the stretches by which a column is judged that is too long to be looked at whole
_STRETCH = 5_000
#: rows by which the span of a voltage is judged, and share of it within which most rows of a step lie
_LOOKED_AT, _OF_A_WAVE = 200_000, 0.2
#: crossings of its middle that a wave has at least
_CROSSINGS = 6
#: faster than this an actuator may swing against its drive (resonance), and a sign says nothing
_SLOW_HZ = 5.0
#: rows of a pull, and the standard deviations of a sensor beyond which it is one
_ROWS_PULLED, _PULLS_SDS = 10, 5.0
#: share of the voltage that an actuator takes from which on it is driven
_DRIVES = 0.02
#: time constants with which the answer may lag behind the drive when its sign is judged, in s
_SIGN_LAGS_S = (0.0, 0.03, 0.3, 3.0, 30.0)
#: an answer that is the mirror image of the drive correlates with it by more than this, drifts and noise by less
_SIGN_CORRELATION = 0.7
#: what happens within this time (s) is prompt; by so many standard errors it has to go with the drive
_PROMPT_S, _SURE = 1.0, 5.0


def check_plausible(recording: Recording, sensors: Mapping[str, Sensor] | None = None,
                    where: Callable[[int], str] = lambda i: f"row {i + 1}", strict: bool = True) -> list[str]:
    """Warnings about one recording that has passed `check_columns`.

    Raises InputError for a unit off by a power of ten beyond what the actuator can do; with `strict` false
    that is a warning too (conventions.plausibility = "warn").
    """
    problems: list[str] = []
    warnings: list[str] = []
    if recording.kind != "capacitance" and "time_s" in recording.columns:
        _time(recording, problems, warnings)
    if "voltage_V" in recording.columns:
        _voltage(recording, problems, warnings, where)
    if "displacement_m" in recording.columns:
        _displacement(recording, sensors or {}, problems, warnings, where)
        _sign(recording, sensors or {}, problems)
    if "position_m" in recording.columns:
        _mechanical(recording, problems, warnings)
        _pulled(recording, (sensors or {}).get("force", Sensor()), warnings)
    _temperature(recording, problems)
    if problems and strict:
        raise InputError(f"{problems[0]} {OVERRIDE}")
    return problems + warnings


def _span(values: NDArray[np.float64]) -> float:
    return float(np.nanmax(values) - np.nanmin(values))


def usual_span(values: NDArray[np.float64]) -> float:
    """Span of all but the half per cent at either end, so that a few drop-outs do not count."""
    some = values[:: max(1, values.size // 20_000)]
    low, high = np.nanpercentile(some, [0.5, 99.5]) if np.isfinite(some).any() else (0.0, 0.0)
    return float(high - low)


def _structured(values: NDArray[np.float64]) -> bool:
    """Whether a column is more than white noise: its steps are small against its spread."""
    # a long recording is judged by stretches from all over it
    starts = np.linspace(0, values.size - 1, min(400, -(-values.size // _STRETCH))).astype(int)
    if values.size <= 400 * _STRETCH:
        stretches = [values[np.isfinite(values)]]
    else:
        stretches = [x[np.isfinite(x)] for x in (values[a : a + _STRETCH] for a in starts)]
    finite = np.concatenate(stretches)
    spread = float(finite.std())
    if spread == 0.0:
        return finite[0] != 0.0
    return float(np.concatenate([np.diff(x) for x in stretches]).std()) / np.sqrt(2) < 0.5 * spread


def _time(r: Recording, problems: list[str], warnings: list[str]) -> None:
    time = r.time_s
    steps = some_steps(time)
    median = float(np.median(steps))
    duration = float(time[-1] - time[0])
    waves = r.kind in ("sine", "triangle", "rectangle")
    if waves and median > 50.0:
        problems.append(f'{r.name}: the median step of time_s is {median:g} s, too long for a {r.kind}. If '
                        'the times are in ms, map them: columns.time_s = { name = "time_s", unit = "ms" } in '
                        'its [format].')
    elif duration > _LONG_S:
        warnings.append(f"{r.name}: the recording lasts {duration / 86400:.1f} days; check that time_s is in "
                        "seconds.")
    limit = r.actuator.max_frequency_Hz
    if limit is not None and "voltage_V" in r.columns:
        frequency = dominant_frequency(r.columns["voltage_V"], time)
        if frequency > 20.0 * limit:
            problems.append(f"{r.name}: the voltage alternates at about {frequency:.3g} Hz, far beyond "
                            f"max_frequency_Hz = {limit:g}. Are the times off by a power of ten? Correct the "
                            "unit of time_s in its [format].")
        elif frequency > 1.2 * limit:
            warnings.append(f"{r.name}: the voltage alternates at about {frequency:.3g} Hz, above "
                            f"max_frequency_Hz = {limit:g}.")


def dominant_frequency(voltage: NDArray[np.float64], time_s: NDArray[np.float64]) -> float:
    """Crossings of the middle per second of the stretch in which there are any, rests before and after left out."""
    count, first, last = swings(voltage)
    seconds = float(time_s[last] - time_s[first])
    return (count - 1) / 2.0 / seconds if count >= _CROSSINGS and seconds > 0.0 else 0.0


def swings(voltage: NDArray[np.float64]) -> tuple[int, int, int]:
    """How often a voltage (n,) crosses its middle, and the rows of the first and last crossing.

    With a dead band of half the span, so that noise does not count: a crossing is seen where that is left. A wave that
    stays above its rests has few; it crosses the middle of the span of most rows, where these have one.
    """
    low, high = float(np.nanmin(voltage)), float(np.nanmax(voltage))
    found = _crossings(voltage, low, high)
    if found[0] >= _CROSSINGS:
        return found
    usual = np.nanquantile(voltage[:: -(-voltage.size // _LOOKED_AT)], [0.1, 0.9])
    wave = usual[1] - usual[0] > _OF_A_WAVE * (high - low)
    return max(found, _crossings(voltage, float(usual[0]), float(usual[1]))) if wave else found


def _crossings(voltage: NDArray[np.float64], low: float, high: float) -> tuple[int, int, int]:
    """`swings` of a voltage (n,) whose span is known."""
    middle, band = 0.5 * (high + low), 0.25 * (high - low)
    count, first, end, last = 0, 0, 0, 0
    if not band > 0.0:
        return 0, 0, 0
    for part in pieces(voltage.size):
        state = (voltage[part] > middle + band).astype(np.int8) - (voltage[part] < middle - band).astype(np.int8)
        at = np.flatnonzero(state)  # of nan, too
        if at.size:
            known = np.concatenate([[last], state[at]])
            turned = at[(known[1:] != known[:-1]) & (known[:-1] != 0)]
            if turned.size:
                first = first if count else part.start + int(turned[0])
                end = part.start + int(turned[-1])
                count += turned.size
            last = int(state[at[-1]])
    return count, first, end


def _voltage(r: Recording, problems: list[str], warnings: list[str], where: Callable[[int], str]) -> None:
    voltage = r.columns["voltage_V"]
    largest, limit = max(float(np.nanmax(voltage)), -float(np.nanmin(voltage))), r.actuator.max_voltage_V
    at = first_row(lambda x: np.abs(x) == largest, voltage) or 0
    thickness = r.actuator.layer_thickness_m
    if limit is None and thickness is not None and largest / thickness > MAX_FIELD:
        problems.append(f"{r.name}, {where(at)}: voltage_V reaches {largest:g} V, a field of "
                        f"{largest / thickness:.3g} V/m that no elastomer holds. Check the unit of voltage_V "
                        "and layer_thickness_m.")
    if limit is None:
        return
    if largest > 1.5 * limit:
        problems.append(f"{r.name}, {where(at)}: voltage_V reaches {largest:g} V, beyond max_voltage_V = "
                        f"{limit:g}. Is the column in another unit (mV)? Say so in its [format], or correct "
                        "max_voltage_V in campaign.toml.")
    elif largest > 1.01 * limit:
        warnings.append(f"{r.name}, {where(at)}: voltage_V reaches {largest:g} V, a little beyond "
                        f"max_voltage_V = {limit:g}.")
    elif 0.0 < largest < 5.0 and limit >= 500.0 and _structured(r.columns["voltage_V"]):
        remedy = ("Is it the column of another channel? Check the header, or say in its [format] which column "
                  "holds the voltage.")
        if 1e3 * largest > _DRIVES * limit:
            remedy = ('If the column is in kV, say so: columns.voltage_V = { name = "voltage_V", unit = "kV" } in its '
                      "[format].")
        problems.append(f"{r.name}: voltage_V reaches only {largest:g} V, while the actuator takes {limit:g} V. "
                        f"{remedy}")


def maxwell_stroke(a: Actuator, squared_volts: float) -> float | None:
    """Stroke in m of a stack of 1 MPa for a change of V^2 in V^2; None without geometry."""
    if a.layers is None or a.layer_thickness_m is None or a.relative_permittivity is None:
        return None
    share = 1.0
    if a.electrode_area_m2 is not None and a.total_area_m2 is not None:
        share = a.electrode_area_m2 / a.total_area_m2
    stress = _EPS0 * a.relative_permittivity * squared_volts / a.layer_thickness_m**2 * share
    return a.layers * a.layer_thickness_m * stress / TYPICAL_MODULUS


def _displacement(r: Recording, sensors: Mapping[str, Sensor], problems: list[str],
                  warnings: list[str], where: Callable[[int], str]) -> None:
    stroke = _span(r.columns["displacement_m"])
    a = r.actuator
    remedy = ('If the column is in mm or um, say so: columns.displacement_m = { name = "displacement_m", '
              'unit = "mm" } in its [format].')
    usual = usual_span(r.columns["displacement_m"])
    if a.stack_height_m is not None and usual <= a.stack_height_m < stroke:
        y = r.columns["displacement_m"]
        middle = float(np.nanmedian(y[:: max(1, y.size // 1_000_000)]))
        far = max(float(np.nanmax(y)) - middle, middle - float(np.nanmin(y)))
        at = first_row(lambda x: np.abs(x - middle) >= far * (1 - 1e-12), y) or 0
        warnings.append(f"{r.name}, {where(at)}: displacement_m is {far:.3g} m away from its median, "
                        f"more than "
                        f"the height of the stack ({a.stack_height_m:g} m). If the sensor dropped out "
                        f"there, write "
                        "nan.")
    if a.stack_height_m is not None and usual > a.stack_height_m:
        problems.append(f"{r.name}: displacement_m spans {stroke:.4g} m, more than the height of the stack "
                        f"({a.stack_height_m:g} m). {remedy}")
        return
    if not r.is_voltage:
        return
    low, high = float(np.nanmin(r.columns["voltage_V"])), float(np.nanmax(r.columns["voltage_V"]))
    largest = max(low**2, high**2)
    # a recording may begin after the step, so the most that can be expected counts from rest
    most = maxwell_stroke(a, largest)
    least = maxwell_stroke(a, largest - (0.0 if low <= 0.0 <= high else min(low**2, high**2)))
    sensor = sensors.get("displacement", Sensor())
    floor = max(sensor.fluctuation or 0.0, sensor.resolution or 0.0)
    if low == high and usual > 10.0 * floor > 0.0 and _structured(r.columns["displacement_m"]):
        taken = ("is it the right column?" if low == 0.0 else
                 "it is taken as a step from rest at the first row. Is it the right column?")
        warnings.append(f"{r.name}: voltage_V stays at {low:g} V while displacement_m moves by {stroke:.3g} m; {taken}")
    if not most or least is None:
        return

    def said(expected: float) -> str:
        return (f"{r.name}: displacement_m spans {stroke:.3g} m where about {expected:.2g} m are expected "
                "(Maxwell stress, 1 MPa)")

    if usual > max(_STROKE_FACTOR * most, 10.0 * floor):
        if _structured(r.columns["displacement_m"]):
            problems.append(f"{said(most)}. {remedy} Or is the voltage in kV, or layer_thickness_m wrong?")
    elif stroke == 0.0:
        _never_changes(r, sensor, problems, warnings)
    elif stroke * _STROKE_FACTOR < least:
        if stroke < floor or stroke * _STROKE_FACTOR**2 < least:
            problems.append(f"{said(least)}. Was a column divided by a unit once too often, or is the "
                            "voltage in mV? Correct the units in its [format].")
        else:
            warnings.append(f"{said(least)}. Check the units of displacement and voltage.")


def _never_changes(r: Recording, sensor: Sensor, problems: list[str], warnings: list[str]) -> None:
    """A reading that stays the same is wrong where a stack far stiffer than the yardstick moves by what is resolved."""
    y, v = r.columns["displacement_m"], r.columns["voltage_V"]
    squares = v[np.isfinite(y) & np.isfinite(v)] ** 2
    expected = (maxwell_stroke(r.actuator, float(np.ptp(squares))) or 0.0) if squares.size else 0.0
    dead = expected > _STROKE_FACTOR * (sensor.resolution or 0.0)
    where = f" where about {expected:.2g} m are expected (Maxwell stress, 1 MPa)" if dead else ""
    (problems if dead else warnings).append(
        f"{r.name}: displacement_m never changes (it stays at {float(np.fmax.reduce(y)) + 0.0:g} m){where}; is the "
        "sensor connected? If it was not, record it again, or take the recording out.")


def _sign(r: Recording, sensors: Mapping[str, Sensor], problems: list[str]) -> None:
    """Displacement that falls when the voltage rises: Maxwell stress only ever shortens a stack."""
    if not r.is_voltage:
        return
    t, v, y = r.time_s, r.columns["voltage_V"], r.columns["displacement_m"]
    duration = float(t[-1] - t[0])
    if dominant_frequency(v, t) > _SLOW_HZ:
        return
    good = computed(lambda a, b: np.isfinite(a) & np.isfinite(b), v, y, dtype=np.bool_)
    if good.sum() < 20:
        return
    t, v, answer = (_thinned(x, good) for x in (t, v, y))
    drive = np.square(v)
    if np.ptp(drive) == 0.0:
        return
    sensor = sensors.get("displacement", Sensor())
    floor = max(sensor.fluctuation or 0.0, sensor.resolution or 0.0)
    base = np.column_stack([np.ones(t.size), (t - t[0]) / duration])  # an offset and a drift
    answer = answer - base @ np.linalg.lstsq(base, answer, rcond=None)[0]
    falls = rises = fall = 0.0
    for lag in _SIGN_LAGS_S:
        x = _lagged(t, drive, lag)
        x = x - base @ np.linalg.lstsq(base, x, rcond=None)[0]
        size = float(np.linalg.norm(x) * np.linalg.norm(answer))
        correlation = float(x @ answer) / size if size > 0.0 else 0.0
        if correlation < -falls:
            falls = -correlation
            fall = -correlation * float(np.linalg.norm(answer) / np.linalg.norm(x)) * float(np.ptp(x))
        rises = max(rises, correlation)
    if falls > _SIGN_CORRELATION and rises < 0.5 * falls and fall > 5.0 * floor and not _follows(t, drive, answer):
        problems.append(f"{r.name}: displacement_m falls by about {fall:.3g} m where the voltage rises; it is positive "
                        "when the stack gets shorter. Turn it round: columns.displacement_m = { name = "
                        '"displacement_m", sign = -1 } in its [format].')


def _follows(t: NDArray[np.float64], drive: NDArray[np.float64], answer: NDArray[np.float64]) -> bool:
    """Whether the prompt part of an answer goes with the drive, whatever comes later.

    Charges that screen the field let a stack fall back while the voltage stands, and hold it when the voltage is gone.
    """
    x, y = (values - _lagged(t, values, _PROMPT_S) for values in (drive, answer))
    size = float(x @ x)
    if size == 0.0:
        return False
    slope = float(x @ y) / size
    rest = y - slope * x
    return slope * np.sqrt(size) > _SURE * float(np.std(rest))


def _thinned(values: NDArray[np.float64], good: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Means of neighbours among the good rows, so that at most 5,000 values are left."""
    if good.all():
        block = -(-values.size // 5_000)
        return values[: values.size // block * block].reshape(-1, block).mean(axis=1)
    block = -(-int(good.sum()) // 5_000)
    means, left = [], np.empty(0)
    for part in pieces(values.size):
        left = np.concatenate([left, values[part][good[part]]])
        whole = left.size // block * block
        means.append(left[:whole].reshape(-1, block).mean(axis=1))
        left = left[whole:]
    return np.concatenate(means)


def _lagged(t: NDArray[np.float64], drive: NDArray[np.float64], lag: float) -> NDArray[np.float64]:
    """A (n,) drive behind a first-order lag (s), from rest at its first value."""
    if lag == 0.0:
        return drive
    keep = np.exp(-np.diff(t, prepend=t[0]) / lag)
    out = np.empty_like(drive)
    state = drive[0]
    for i in range(drive.size):
        state = drive[i] + keep[i] * (state - drive[i])
        out[i] = state
    return out


def _pulled(r: Recording, sensor: Sensor, warnings: list[str]) -> None:
    """Whether a recording of compression is one of tension at times: a specimen that sticks to the plates, or is glued.

    The median of ten rows in a row counts, against five standard deviations and what a sensor may be off.
    """
    if r.kind not in ("compression", "relaxation") or sensor.fluctuation is None:
        return
    force = r.columns["force_N"]
    lowest, highest = np.inf, float(np.nanmax(force))
    for part in pieces(force.size):
        here = force[part][np.isfinite(force[part])]
        if here.size >= _ROWS_PULLED:
            rows = np.lib.stride_tricks.sliding_window_view(here, _ROWS_PULLED)[:: _ROWS_PULLED // 2]
            lowest = min(lowest, float(np.median(rows, axis=1).min()))
    if lowest < -(_PULLS_SDS * sensor.fluctuation + (sensor.accuracy or 0.0)) and highest > -lowest:
        warnings.append(f"{r.name}: force_N falls to {lowest:.3g} N, a pull beyond what the sensor may be off. Models "
                        "take the plates to lift off where nothing presses: of a specimen that sticks to them or is "
                        "glued, keep the rows that press, or preload it; of a load cell that was not zeroed, take its "
                        "reading without contact off (offset in [format]).")


def _mechanical(r: Recording, problems: list[str], warnings: list[str]) -> None:
    height, area = r.actuator.stack_height_m, r.actuator.total_area_m2
    position, force = r.columns["position_m"], r.columns["force_N"]
    travel = _span(position)
    if height is None:
        return
    tension = abs(float(np.nanmin(force))) > abs(float(np.nanmax(force)))
    unit = 'columns.position_m = { name = "position_m", unit = "mm" } in its [format]'
    if travel > 20.0 * height:
        problems.append(f"{r.name}: position_m spans {travel:.4g} m, {travel / height:.3g} times the height "
                        f"of {height:g} m. If the column is in mm, say so: {unit}.")
        return
    if not tension and travel > 1.5 * height:
        warnings.append(f"{r.name}: position_m spans {travel:.4g} m of compression, more than the height of "
                        f"{height:g} m. Check its unit; if this is tension, set sign = -1 for position_m and "
                        "force_N in its [format].")
    if _opposed(position, force):
        problems.append(f"{r.name}: force_N falls where position_m rises, as no specimen between plates does: "
                        "compression is positive in both columns, tension negative in both. Set sign = -1 for the one "
                        'that is turned round, columns.force_N = { name = "force_N", sign = -1 } in its [format].')
        return
    if area is None or travel == 0.0:
        return
    modulus = max(float(np.nanmax(force)), -float(np.nanmin(force))) / area / (travel / height)
    if modulus > 3e9 or 0.0 < modulus < 100.0:
        problems.append(f"{r.name}: force and travel make a stiffness of about {modulus:.2g} Pa, which no "
                        "elastomer has. Check the units of force_N, position_m, total_area_m2 and "
                        "stack_height_m.")


def _opposed(position: NDArray[np.float64], force: NDArray[np.float64]) -> bool:
    """Whether a force is the mirror image of its way, by rows from all over a recording."""
    some = slice(None, None, max(1, position.size // _LOOKED_AT))
    x, f = position[some], force[some]
    known = np.isfinite(x) & np.isfinite(f)
    if known.sum() < 3 or np.ptp(x[known]) == 0.0 or np.ptp(f[known]) == 0.0:
        return False
    return bool(np.corrcoef(x[known], f[known])[0, 1] < -_SIGN_CORRELATION)


def _temperature(r: Recording, problems: list[str]) -> None:
    if "temperature_C" in r.columns:
        coldest = float(np.nanmin(r.columns["temperature_C"]))
        hottest = float(np.nanmax(r.columns["temperature_C"]))
        if coldest > 200.0:
            problems.append(f'{r.name}: temperature_C is {coldest:g} and more. If it is in kelvin, say so: '
                            'unit = "K" in its [format].')
        elif coldest < -273.15 or hottest > 500.0:
            problems.append(f"{r.name}: temperature_C lies between {coldest:g} and {hottest:g}. Check its "
                            "unit.")

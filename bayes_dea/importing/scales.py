"""Unit and scale of a column: said in the file, or the only one that an actuator allows, or asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.columns import to_si
from bayes_dea.campaign.format_map import ColumnMap
from bayes_dea.campaign.schema import Actuator
from bayes_dea.importing.notebook import Notebook
from bayes_dea.importing.ranges import PLAUSIBLE, clock_unit, rate_of, unit_by_range
from bayes_dea.importing.roles import Role
from bayes_dea.importing.shapes import span
from bayes_dea.importing.split import defect
from bayes_dea.importing.tables import RawTable

#: name of our column for each quantity
OURS = {
    "voltage": "voltage_V",
    "displacement": "displacement_m",
    "position": "position_m",
    "force": "force_N",
    "temperature": "temperature_C",
    "capacitance": "capacitance_F",
    "time": "time_s",
}
_SI = {"voltage": "V", "displacement": "m", "position": "m", "force": "N", "capacitance": "F", "temperature": "degC"}
_FACTORS = {"V": 1.0, "kV": 1e3, "mV": 1e-3, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
#: a command below this in volts is that of a supply or a monitor, not the voltage on an elastomer
LEAST_VOLTS = 20.0


def column_for(role: Role, quantity: str, book: Notebook, actuator: Actuator) -> ColumnMap | None:
    """The column with unit and scale into SI, without sign; None where the scale stays open."""
    source = role.column.source
    label = role.column.label
    if role.ours is not None:
        book.reason(f"{label}: the project's own name and unit")
        return source
    if quantity == "temperature":
        return _temperature(role, book)
    own = _SI[quantity]
    if role.dimension == "voltage" and quantity != "voltage":
        return _sensor_volts(role, quantity, own, book)
    if role.unit is not None:
        return _said(role, quantity, own, book)
    guess = unit_by_range(quantity, role.values)
    candidates = _by_geometry(guess.candidates, role, actuator) if quantity == "displacement" else guess.candidates
    if quantity == "voltage" and candidates == ("kV",):
        book.assume(
            f"{label}: {guess.why}: taken as kV. A monitor output of another ratio than 1 V for 1 kV would look "
            "the same; look at the amplifier."
        )
        return replace(source, unit="kV")
    if quantity == "force" and "N" in candidates:
        unit = book.question(f"{label}.unit", f'The unit of "{label}" is not said ({guess.why}).', candidates, "N")
        return _in_unit(source, unit, own)
    if len(candidates) == 1:
        book.reason(f"{label}: {candidates[0]} by its range ({guess.why})")
        return _in_unit(source, candidates[0], own)
    options = candidates or tuple(_units_of(quantity))
    unit = book.question(
        f"{label}.unit", f'The unit of "{label}" is not said, and its range does not decide ({guess.why}).', options
    )
    return None if unit is None else _in_unit(source, unit, own)


def _units_of(quantity: str) -> tuple[str, ...]:
    return {
        "voltage": ("V", "kV"),
        "displacement": ("m", "mm", "um"),
        "position": ("m", "mm", "um"),
        "force": ("N", "mN"),
        "capacitance": ("F", "uF", "nF", "pF"),
    }[quantity]


def _in_unit(source: ColumnMap, unit: str | None, own: str) -> ColumnMap | None:
    if unit is None:
        return None
    return source if unit == own else replace(source, unit=unit)


def _said(role: Role, quantity: str, own: str, book: Notebook) -> ColumnMap | None:
    label, unit = role.column.label, str(role.unit)
    size = float(np.nanmax(np.abs(role.values))) * _FACTORS.get(unit, 1.0)
    if quantity == "voltage" and 0 < size < LEAST_VOLTS:
        ratio = book.question(
            f"{label}.scale",
            f'"{label}" reaches only {size:.3g} V, which moves no elastomer: it must be '
            "a monitor or the input of an amplifier. How many volts on the actuator is "
            f"1 V of it?",
        )
        if ratio is None:
            return None
        return replace(role.column.source, scale=float(ratio) * _FACTORS.get(unit, 1.0))
    where = role.column.unit_from or "name"
    book.reason(
        f"{label}: {unit}, from the {where}" if not where.startswith('"') else f"{label}: {unit}, from {where}"
    )
    if quantity in ("displacement", "position"):
        low, high = PLAUSIBLE[quantity]
        size = span(role.values) * _FACTORS.get(unit, 1.0)
        if size > 0 and not 0.1 * low <= size <= 3 * high:
            book.assume(
                f"{label}: spans {size:.3g} m in the unit {unit} of the file, which is unusual; check the unit."
            )
    return _in_unit(role.column.source, unit, own)


def _sensor_volts(role: Role, quantity: str, own: str, book: Notebook) -> ColumnMap | None:
    label = role.column.label
    scale = book.question(
        f"{label}.scale",
        f'"{label}" is the output of a sensor in {role.unit}. How many {own} is one V '
        "of it (negative where it falls as the quantity rises)?",
    )
    if scale is None:
        return None
    return replace(role.column.source, scale=float(scale) * _FACTORS.get(str(role.unit), 1.0))


def _temperature(role: Role, book: Notebook) -> ColumnMap | None:
    middle = float(np.nanmedian(role.values))
    unit = role.unit
    if unit is None:
        unit = "K" if 200.0 < middle < 500.0 else "degC"
        text = f"{role.column.label}: {unit} by its range (about {middle:.4g})"
        if unit == "K":
            book.reason(text)
        else:
            book.assume(text + ".")
    if role.dimension not in (None, "temperature"):
        return None
    return role.column.source if unit == "degC" else replace(role.column.source, unit=unit)


def _by_geometry(candidates: tuple[str, ...], role: Role, actuator: Actuator) -> tuple[str, ...]:
    """Of several units those that make a stroke of a hundredth to a fifth of the stack's height."""
    height = actuator.stack_height_m
    if height is None or len(candidates) < 2:
        return candidates
    size = span(role.values)
    good = tuple(u for u in candidates if 1e-5 * height < size * _FACTORS[u] < 0.3 * height)
    return good or candidates


def _without_repeats(column: ColumnMap, role: Role, table: RawTable, book: Notebook) -> ColumnMap:
    """The column, or a rate in its place where the times have too few digits to tell the rows apart."""
    times = to_si(role.values, column, "time_s", table.label)
    steps = np.diff(times)
    if float(np.mean(steps == 0)) < 0.2 or bool(np.any(steps < 0)):
        return column
    if table.rate_Hz is not None:
        book.reason(f"{role.column.label}: too few digits, so {table.rate_Hz:.6g} samples a second ({table.rate_from})")
        return ColumnMap(rate_Hz=float(f"{table.rate_Hz:.10g}"))
    regular = _evenly_repeated(times)
    if regular is not None:
        rows, rate_Hz = regular[0], regular[0] / regular[1]
        book.reason(
            f"{role.column.label}: too few digits, but evenly so: every time stands on {rows} rows, and the next is "
            f"{regular[1]:.6g} s later, so {rate_Hz:.6g} samples a second"
        )
        return ColumnMap(rate_Hz=float(f"{rate_Hz:.10g}"))
    mean = f"{steps.size / float(steps.sum()):.4g}"
    rate = book.question(
        "rate_Hz",
        f'"{role.column.label}" has too few digits: {100 * np.mean(steps == 0):.3g} % of the rows repeat '
        "the time before. How many samples a second, if they are even?",
        fallback=mean,
    )
    return ColumnMap(rate_Hz=float(rate or mean))


def _evenly_repeated(times: NDArray[np.float64]) -> tuple[int, float] | None:
    """(rows on which each time stands, step between times) where both are the same throughout; None otherwise.

    Only the first and the last time may stand on fewer rows. Samples that were lost, or a rate that is no multiple of
    the last digit, would break the pattern somewhere, so twenty times that keep it leave no other reading.
    """
    if times.size == 0 or not np.isfinite(times).all():
        return None
    begins = np.concatenate([[0], 1 + np.flatnonzero(np.diff(times) != 0)])
    rows = np.diff(np.append(begins, times.size))
    steps = np.diff(times[begins])
    if rows.size < 20 or np.any(rows[1:-1] != rows[1]) or max(rows[0], rows[-1]) > rows[1] or rows[1] < 2:
        return None
    step = float(np.median(steps))
    # what is left of a step after rounding to its last digit
    if np.max(np.abs(steps - step)) > 1e-6 * step + 4 * np.finfo(float).eps * float(np.max(np.abs(times))):
        return None
    return int(rows[1]), float((times[begins[-1]] - times[0]) / steps.size)


def time_column(
    roles: list[Role], table: RawTable, book: Notebook, fallback: str | None = None
) -> tuple[ColumnMap | None, bool]:
    """(where time comes from, whether it is decided). (None, True): the table has no time and none is needed to be
    known.

    Time as text and time stamps are seconds already; a count of samples needs a rate. `fallback` is the unit that is
    assumed where the column names none (None: the recording waits for an answer).
    """
    role = next((r for r in roles if r.quantity == "time"), None)
    row = defect(role.values) if role is not None else None
    if role is not None and row is not None:
        rate = book.question(
            "rate_Hz",
            f'"{role.column.label}" runs backwards at row {row + 1} after the header, from '
            f"{role.values[row - 1]:.6g} to {role.values[row]:.6g}, and does not begin again there: "
            "the times are damaged. How many samples a second, if they are even?",
        )
        return (ColumnMap(rate_Hz=float(rate)), True) if rate is not None else (None, False)
    if role is not None:
        column = _time_of(role, table, book)
        if column is not None:
            return _without_repeats(column, role, table, book), True
    if table.rate_Hz is not None:
        book.reason(f"time: {table.rate_Hz:.6g} samples a second, from {table.rate_from}")
        return ColumnMap(rate_Hz=float(f"{table.rate_Hz:.10g}")), True
    if role is not None:
        unit = book.question(
            f"{role.column.label}.unit",
            f'The unit of "{role.column.label}" is not said ({clock_unit(role.values).why}).',
            ("s", "ms", "us", "min", "count"),
            None if clock_unit(role.values).count else fallback,
        )
        if unit is not None and unit != "count":
            return (role.column.source if unit == "s" else replace(role.column.source, unit=unit)), True
        if unit is None:
            return None, False
    rate = book.question("rate_Hz", "There is no column of times, and no rate is said. How many samples a second?")
    return (ColumnMap(rate_Hz=float(rate)), True) if rate is not None else (None, False)


def _time_of(role: Role, table: RawTable, book: Notebook) -> ColumnMap | None:
    label, source = role.column.label, role.column.source
    if role.column.clock or role.ours:
        book.reason(f"{label}: time" + (f' as text ("{source.time_format}")' if source.time_format else ""))
        return source
    if role.unit is not None and role.dimension == "time":
        book.reason(f"{label}: time in {role.unit}, from the {role.column.unit_from or 'name'}")
        found, unit = source, role.unit
    else:
        clock = clock_unit(role.values)
        if clock.unit is None:
            if table.rate_Hz is None:
                return None
            step = rate_of(role.values)[0]
            for name, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
                if not clock.count and abs(step / factor / table.rate_Hz - 1.0) < 0.01:
                    book.reason(f"{label}: time in {name}, as {table.rate_from} says")
                    return source if name == "s" else replace(source, unit=name)
            return None
        book.reason(f"{label}: time; {clock.why}")
        found, unit = source, clock.unit
    column = found if unit == "s" else replace(found, unit=unit)
    if abs(float(role.values[0])) > 1e6 or unit == "day":
        column = replace(column, offset="first")
    return column

"""Which column is what: names and units first, then how the numbers behave; every choice with its reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayes_dea.campaign.vocabulary import KNOWN_COLUMNS
from bayes_dea.importing.ranges import clock_unit
from bayes_dea.importing.shapes import follows, scatter, span
from bayes_dea.importing.tables import Array, RawColumn, RawTable
from bayes_dea.importing.words import BY_DIMENSION, DIMENSIONS, Said, read_name

#: how sure: the file says so; the numbers leave nothing else; a guess that has to be looked at; not known
LEVELS = ("said", "inferred", "assumed", "unknown")


@dataclass(frozen=True)
class Role:
    """What one column is.

    `quantity`: time, voltage, displacement, position, force, ... or None. `variant`: command or measured. `unit` as the
    format map writes it, None where none is said. `raw_volts`: the unit is volts but the quantity is not a voltage, so
    that a scale is missing.
    """

    column: RawColumn
    quantity: str | None
    level: str
    why: str
    variant: str | None = None
    unit: str | None = None
    dimension: str | None = None
    raw_volts: bool = False
    weak: bool = False
    distance: bool = False
    channel: bool = False
    ours: str | None = None  # the column has one of our own names

    @property
    def values(self) -> Array:
        """The column's numbers, in the file's unit."""
        return self.column.values


def read_roles(table: RawTable) -> list[Role]:
    """A role for every column of a table, from names, units and the course of the numbers."""
    roles = [_by_name(c) for c in table.columns]
    roles = _one_time(roles)
    roles = [_count_is_no_length(r) for r in roles]
    return _by_course(roles)


def _by_name(column: RawColumn) -> Role:
    said: Said = read_name(column.name, column.unit)
    if column.clock:
        return Role(column, "time", "said", "time written as date or clock", unit=None, dimension="time")
    if column.name in KNOWN_COLUMNS:
        own = {"measured_voltage_V": "voltage"}.get(column.name, column.name.rsplit("_", 1)[0])
        return Role(
            column,
            own,
            "said",
            "has the project's own name",
            "measured" if column.name == "measured_voltage_V" else None,
            said.unit,
            said.dimension,
            ours=column.name,
        )
    quantity, unit, dimension = said.quantity, said.unit, said.dimension
    # "column 3" is our own word, "CH3" is a recorder's
    named = column.source.name is not None and column.source.index is None
    nothing = Role(
        column,
        None,
        "unknown",
        f'"{column.name}" says nothing we know',
        said.variant,
        unit,
        dimension,
        distance=said.distance,
        channel=said.channel and named,
    )
    if dimension is not None and quantity is not None and dimension not in DIMENSIONS.get(quantity, (dimension,)):
        if dimension == "voltage" and quantity in ("displacement", "position", "force", "temperature"):
            why = f'named "{column.name}" but given in {unit}: the output of a sensor'
            return replace(nothing, quantity=quantity, level="said", why=why, raw_volts=True)
        if said.weak and dimension in BY_DIMENSION:
            return replace(nothing, quantity=BY_DIMENSION[dimension], level="said", why=f"unit {unit}")
        return replace(nothing, why=f'"{column.name}" and its unit {unit} contradict each other')
    if nothing.channel and dimension in (None, "voltage"):
        return replace(nothing, why=f'"{column.name}" is a channel of a recorder; what was connected is not said')
    if quantity is not None:
        why = f'named "{column.name}"' + (f", {column.unit_from} {unit}" if column.unit_from and unit else "")
        return replace(nothing, quantity=quantity, level="said", why=why, weak=said.weak)
    if dimension in BY_DIMENSION:
        return replace(nothing, quantity=BY_DIMENSION[str(dimension)], level="inferred", why=f"unit {unit}")
    return nothing


def rises(values: Array) -> bool:
    """Whether a column rises like time, but for a few restarts; times of too few digits stand still between."""
    finite = values[np.isfinite(values)]
    if finite.size < 3 or finite.size < values.size:
        return False
    steps = np.diff(finite)
    back = int(np.count_nonzero(steps < 0))
    still = float(np.mean(steps == 0))
    return back <= max(0, finite.size // 10 - 1) and still < 0.95 and float(np.median(steps[steps != 0])) > 0


def _one_time(roles: list[Role]) -> list[Role]:
    """One time column: a clock or a named one that rises; the others are put aside. A nameless one by its steps."""
    named = [r for r in roles if r.quantity == "time" and rises(r.values)]
    out = [
        r
        if r.quantity != "time" or r in named
        else replace(r, quantity=None, level="unknown", why="named like a time but does not rise")
        for r in roles
    ]
    if named:
        best = min(named, key=lambda r: (r.ours is None, r.unit is None and not r.column.clock, r.weak))
        return [
            r
            if r is best or r.quantity != "time"
            else replace(r, quantity="other time", level="inferred", why="a second time column")
            for r in out
        ]
    even = [
        r
        for r in out
        if r.quantity is None
        and not r.channel
        and r.dimension in (None, "time")
        and rises(r.values)
        and _even(r.values)
    ]
    worked_up = {r.quantity for r in out} & {
        "stress",
        "strain",
        "stretch",
    }  # a ramp of a stretch is as even as a clock
    moving = [r for r in even if not clock_unit(r.values).count and not worked_up and _like_clock(r.values)]
    if len(moving) == 1:
        found = moving[0]
        return [
            replace(r, quantity="time", level="inferred", why="rises in even steps, as only time does")
            if r is found
            else r
            for r in out
        ]
    if even:
        return [
            replace(r, quantity="index", level="inferred", why="counts rows")
            if r in even and clock_unit(r.values).count
            else r
            for r in out
        ]
    return out


def _even(values: Array) -> bool:
    steps = np.diff(values)
    good = steps[steps > 0]
    return bool(good.size and float(np.median(np.abs(good - np.median(good)))) < 0.02 * float(np.median(good)))


def _like_clock(values: Array) -> bool:
    """Whether a nameless column steps as exactly as a clock does, by a round time or at a round rate."""
    steps = np.diff(values)
    step = float(values[-1] - values[0]) / steps.size
    if step <= 0 or values.size < 20 or float(np.abs(steps - step).max()) > 0.02 * step:
        return False
    rate = 1.0 / step
    digits = step / 10.0 ** np.floor(np.log10(step))
    return bool(
        abs(rate - round(rate)) < 1e-3 * rate or min(abs(digits - d) for d in (1.0, 2.0, 2.5, 4.0, 5.0)) < 1e-3
    )


def _count_is_no_length(role: Role) -> Role:
    if (
        role.weak
        and role.quantity in ("displacement", "voltage")
        and rises(role.values)
        and clock_unit(role.values).count
    ):
        return replace(role, quantity="index", level="inferred", why="counts rows")
    return role


def _by_course(roles: list[Role]) -> list[Role]:
    """Names for what is left: of two nameless columns the one whose square the other follows is the command."""
    time = next((r for r in roles if r.quantity == "time"), None)
    nameless = [
        r for r in roles if r.quantity is None and r.dimension is None and span(r.values) > 0 and not r.channel
    ]
    have = {r.quantity for r in roles}
    if not nameless or have & {"force", "position", "stress", "strain", "stretch"}:
        return roles
    clock = time.values if time is not None else np.arange(roles[0].values.size, dtype=np.float64)
    voltages = [r for r in roles if r.quantity == "voltage"]
    answers = [r for r in roles if r.quantity == "displacement"]
    pairs: list[tuple[Role, Role]] = []
    if not voltages and not answers and len(nameless) == 2:
        pairs = [(nameless[0], nameless[1]), (nameless[1], nameless[0])]
    elif len(voltages) == 1 and not answers and len(nameless) == 1:
        pairs = [(voltages[0], nameless[0])]
    elif len(answers) == 1 and not voltages and len(nameless) == 1:
        pairs = [(nameless[0], answers[0])]
    good = [(a, b) for a, b in pairs if _drives(clock, a, b)]
    if len(good) != 1:
        return roles
    cause, effect = good[0]
    share = follows(clock, cause.values, effect.values)[0]
    out = []
    for r in roles:
        if r is cause and r.quantity is None:
            r = replace(
                r,
                quantity="voltage",
                level="inferred",
                why=f"reaches {np.nanmax(np.abs(r.values)):.4g}, and its square explains {100 * share:.3g} % of "
                "the other column",
            )
        elif r is effect and r.quantity is None:
            r = replace(
                r,
                quantity="displacement",
                level="inferred",
                why=f"follows the square of the voltage ({100 * share:.3g} %)",
            )
        out.append(r)
    return out


def _drives(clock: Array, cause: Role, effect: Role) -> bool:
    """Whether one nameless column is a command in volts and the other a measured answer to its square."""
    a, b = cause.values, effect.values
    if np.nanmax(np.abs(a)) < 50.0 or np.nanmax(np.abs(a)) > 2e4:
        return False
    if scatter(a) / span(a) > 0.3 * scatter(b) / span(b):
        return False
    # an answer that has few digits looks as quiet as a command: it must also not explain the command as well
    missed, missed_back = 1.0 - follows(clock, a, b)[0], 1.0 - follows(clock, b, a)[0]
    return missed < 0.2 and missed < 0.3 * missed_back

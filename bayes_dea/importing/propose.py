"""Tables -> recordings with kind, columns, units, signs and rows, each with its reasons; questions where nothing
decides.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from bayes_dea.campaign.columns import to_si
from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.schema import VOLTAGE_KINDS, Actuator
from bayes_dea.campaign.units import SI_SUFFIXES, suffix
from bayes_dea.importing.ask import Asker, nobody
from bayes_dea.importing.families import Family, find_family
from bayes_dea.importing.notebook import Notebook
from bayes_dea.importing.ranges import rate_of
from bayes_dea.importing.roles import Role, read_roles
from bayes_dea.importing.scales import column_for, time_column
from bayes_dea.importing.shapes import Shape, is_reading, mechanical_shape, scatter, span, step_between, voltage_shape
from bayes_dea.importing.signs import answer_sign, mechanical_signs
from bayes_dea.importing.split import MIN_ROWS, Part, split_holes, split_pauses, split_rows
from bayes_dea.importing.tables import Array, RawTable
from bayes_dea.importing.unread import settle_unread
from bayes_dea.importing.words import parse_unit

#: kind of what is no recording of a DEA: only a model of the user's own reads it
FREE_KIND = "other"
_FREE_UNITS = {
    "voltage": "V",
    "length": "m",
    "force": "N",
    "stress": "Pa",
    "temperature": "C",
    "current": "A",
    "capacitance": "F",
    "frequency": "Hz",
    "time": "s",
}


@dataclass(frozen=True)
class ProposedRecording:
    """One `[[recording]]`. `usable` is false where something necessary is open: it is written as a comment."""

    path: Path
    name: str | None
    kind: str
    format: FormatMap
    rows: int
    rate_Hz: float
    even: bool
    duration_s: float
    hold: str | None = None
    rested: bool = True
    rest_before_s: float | None = None
    reasons: tuple[str, ...] = ()
    usable: bool = True
    noise: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def label(self) -> str:
        """Name for messages."""
        return self.name or self.path.name


@dataclass(frozen=True)
class TableReport:
    """What was found in one table: roles of all its columns, what is assumed, what stays open."""

    table: RawTable
    roles: tuple[Role, ...]
    family: str
    remark: str
    reasons: tuple[str, ...]
    assumed: tuple[str, ...]
    open: tuple[str, ...]
    recordings: tuple[ProposedRecording, ...]
    asked: int = 0


@dataclass(frozen=True)
class Proposal:
    """Everything that was found; `skipped` files hold no table (path, why)."""

    reports: tuple[TableReport, ...]
    skipped: tuple[tuple[Path, str], ...] = ()

    @property
    def recordings(self) -> tuple[ProposedRecording, ...]:
        """All recordings, in the order of the files."""
        return tuple(r for report in self.reports for r in report.recordings)

    @property
    def open(self) -> tuple[str, ...]:
        """What could not be decided, with the table's name."""
        return tuple(f"{r.table.label}: {text}" for r in self.reports for text in r.open)

    @property
    def assumed(self) -> tuple[str, ...]:
        """What was guessed and has to be looked at, with the table's name."""
        return tuple(f"{r.table.label}: {text}" for r in self.reports for text in r.assumed)


def propose(
    tables: Sequence[RawTable],
    ask: Asker = nobody,
    actuator: Actuator | None = None,
    skipped: Sequence[tuple[Path, str]] = (),
    tell: Callable[[float, float, str], None] = lambda *_: None,
) -> Proposal:
    """Proposes the recordings of some tables.

    `ask` answers what the files leave open; where it gives None the fallback is taken and said, or the recording is
    left unusable. `actuator` narrows units by what it can do. `tell` is called with (done, of, name) for each table.
    Raises InputError for an answer that makes no sense.
    """
    known = actuator or Actuator()
    reports = []
    for i, table in enumerate(tables):
        tell(i, len(tables), table.label)
        reports.append(_one_table(table, ask, known))
    return Proposal(_unique_names(reports), tuple(skipped))


def _unique_names(reports: list[TableReport]) -> tuple[TableReport, ...]:
    """Names of parts that are there twice (files of one name in two folders) get the folder in front, or a number."""
    taken: set[str] = set()
    out = []
    for report in reports:
        named = []
        for r in report.recordings:
            name = r.name
            if name is not None and name in taken:
                base, k = f"{r.path.resolve().parent.name}_{name}", 2
                name = base
                while name in taken:
                    name, k = f"{base}_{k}", k + 1
            if name is not None:
                taken.add(name)
            named.append(replace(r, name=name))
        out.append(replace(report, recordings=tuple(named)))
    return tuple(out)


def _one_table(table: RawTable, ask: Asker, actuator: Actuator) -> TableReport:
    book = Notebook(table.label, ask)
    for note in table.notes:
        book.reason(note)
    roles = read_roles(table)
    clock = _raw_time(roles, table)
    settled = settle_unread(table, roles, book)
    family = find_family(roles, clock, book, table.rate_Hz is not None) if settled else Family("open", {})
    for role in roles:
        if role.quantity is not None and role.column.label not in (None, ""):
            book.reason(
                f"{role.column.label}: {role.quantity}{f' ({role.variant})' if role.variant else ''}, {role.why}"
            )
    recordings: tuple[ProposedRecording, ...] = ()
    remark = family.why
    if family.name == "free":
        recordings, more = _free_recordings(table, roles, book)
        remark += more
    elif family.name != "open":
        recordings = _recordings(table, roles, family, clock, book, actuator)
    unused = [
        r.column.label
        for r in roles
        if r.quantity is None
        and span(r.values) > 0
        and not any(r.column is u.column for u in family.columns.values())
    ]
    if unused and family.name not in ("free", "open"):
        book.reason(f"not used, because nothing says what they are: {', '.join(unused)}")
    return TableReport(
        table,
        tuple(roles),
        family.name,
        remark,
        tuple(book.reasons),
        tuple(book.assumed),
        tuple(book.open),
        recordings,
        book.asked,
    )


def _raw_time(roles: Sequence[Role], table: RawTable) -> Array:
    """A time to judge shapes by: in whatever unit, or the number of the row."""
    role = next((r for r in roles if r.quantity == "time"), None)
    if role is not None:
        return role.values
    return np.arange(table.rows, dtype=np.float64) / (table.rate_Hz or 1.0)


def _recordings(
    table: RawTable, roles: Sequence[Role], family: Family, clock: Array, book: Notebook, actuator: Actuator
) -> tuple[ProposedRecording, ...]:
    columns: dict[str, ColumnMap] = {}
    decided = True
    needs_time = family.name != "capacitance" or any(r.quantity == "time" for r in roles)
    if needs_time:
        found, known = time_column(list(roles), table, book)
        decided = known
        if found is not None:
            columns["time_s"] = found
    for own, role in family.columns.items():
        quantity = {"position_m": "position", "measured_voltage_V": "voltage"}.get(own, own.rsplit("_", 1)[0])
        column = column_for(role, quantity, book, actuator)
        if column is not None:
            columns[own] = column
        elif own != "temperature_C":
            decided = False
    values = {
        own: to_si(family.columns[own].values, replace(c, sign=1), own, table.label)
        for own, c in columns.items()
        if own in family.columns
    }
    time = _si_time(columns.get("time_s"), roles, table, clock)
    columns, values, shape_kind = _signed(table, family, columns, values, time, book)
    if not decided:
        part = Part(0, table.rows)
        return (_build(table, family, columns, values, time, part, None, shape_kind, book, usable=False),)
    return _split(table, roles, family, columns, values, time, shape_kind, book)


def _si_time(column: ColumnMap | None, roles: Sequence[Role], table: RawTable, clock: Array) -> Array:
    if column is None:
        return clock
    if column.rate_Hz is not None:
        return np.arange(table.rows, dtype=np.float64) / column.rate_Hz
    role = next((r for r in roles if r.quantity == "time"), None)
    return to_si(role.values, column, "time_s", table.label) if role is not None else clock


def _signed(
    table: RawTable,
    family: Family,
    columns: dict[str, ColumnMap],
    values: dict[str, Array],
    time: Array,
    book: Notebook,
) -> tuple[dict[str, ColumnMap], dict[str, Array], str | None]:
    """Columns and values with their signs, and the kind where mechanics decide it."""
    signs: dict[str, int] = {}
    kind: str | None = None
    roles = family.columns
    if family.name in ("voltage", "blocked_force"):
        answer = "displacement_m" if family.name == "voltage" else "force_N"
        if answer in values and "voltage_V" in values:
            role = roles[answer]
            signs[answer] = answer_sign(
                time,
                values["voltage_V"],
                values[answer],
                role.column.label,
                role.ours is not None,
                book,
                answer.rsplit("_", 1)[0],
            )
            if family.name == "voltage" and role.ours is None:
                columns[answer] = _zeroed(columns[answer], role, book)
    elif family.name == "mechanical" and {"position_m", "force_N"} <= values.keys():
        shape = mechanical_shape(values["position_m"], values["force_N"])
        kind = shape.kind
        book.reason(f"{kind}: {shape.why}")
        if roles["position_m"].ours is None or roles["force_N"].ours is None:
            words = [
                table.path.name,
                *table.path.resolve().parent.parts[-2:],
                *(r.column.label for r in roles.values()),
                *table.facts.values(),
                *table.facts.keys(),
            ]
            signs["position_m"], signs["force_N"] = mechanical_signs(
                values["position_m"], values["force_N"], kind, words, book
            )
        if kind == "load":
            columns["displacement_m"] = columns.pop("position_m")
            values["displacement_m"] = values.pop("position_m")
            signs["displacement_m"] = signs.pop("position_m", 1)
    for own, sign in signs.items():
        if sign < 0 and own in columns:
            columns[own] = replace(columns[own], sign=-columns[own].sign)
            values[own] = -values[own]
    return columns, values, kind


def _zeroed(column: ColumnMap, role: Role, book: Notebook) -> ColumnMap:
    """A distance far from zero begins at zero: the zero of a displacement is free anyway."""
    first = role.values[np.isfinite(role.values)][:1]
    if first.size and abs(float(first[0])) > 2.0 * span(role.values):
        book.reason(
            f"{role.column.label}: begins at {first[0]:.6g}, far from zero, so it counts from its first value"
        )
        return replace(column, offset="first")
    return column


def _split(
    table: RawTable,
    roles: Sequence[Role],
    family: Family,
    columns: dict[str, ColumnMap],
    values: dict[str, Array],
    time: Array,
    kind: str | None,
    book: Notebook,
) -> tuple[ProposedRecording, ...]:
    run = next((r.values for r in roles if r.quantity == "run" and _like_runs(r.values)), None)
    has_time = "time_s" in columns
    parts = split_rows(time if has_time else None, run, table.rows)
    if has_time:
        parts = [p for whole in parts for p in split_holes(time, whole)]
    if "voltage_V" in values and has_time:
        parts = [p for whole in parts for p in split_pauses(time, values["voltage_V"], whole)]
    short = [p for p in parts if p.last - p.first < (MIN_ROWS if has_time else 3)]
    if short and len(parts) > len(short):
        book.assume(
            f"{len(short)} piece{'s' if len(short) > 1 else ''} of fewer than {MIN_ROWS} rows left out, the first at "
            f"row {short[0].first + 1}."
        )
        parts = [p for p in parts if p not in short]
    out = []
    for k, part in enumerate(parts, start=1):
        number = k if len(parts) > 1 else None
        if number is not None:
            book.reason(f"part {k}: rows {part.first + 1} to {part.last}" + (f"; {part.why}" if part.why else ""))
        out.append(_build(table, family, dict(columns), values, time, part, number, kind, book, usable=True))
    return tuple(out)


def _like_runs(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    changes = int(np.count_nonzero(np.diff(finite)))
    return (
        finite.size == values.size and bool(np.all(finite == np.round(finite))) and changes < finite.size / MIN_ROWS
    )


def _build(
    table: RawTable,
    family: Family,
    columns: dict[str, ColumnMap],
    values: dict[str, Array],
    time: Array,
    part: Part,
    number: int | None,
    kind: str | None,
    book: Notebook,
    usable: bool,
) -> ProposedRecording:
    cut = slice(part.first, part.last)
    t = time[cut]
    shape = _kind(family, values, t, cut, kind)
    name = None
    rows = None
    if number is not None:
        rows = (part.first + 1, part.last)
        name = f"{Path(table.path.name).stem}{_dotted(table.part)}_{number}_{shape.kind}"
        if columns.get("time_s") is not None and columns["time_s"].rate_Hz is None:
            columns["time_s"] = replace(columns["time_s"], offset="first")
    if shape.why:
        said = f"{name or table.label}: {shape.kind}: {shape.why}"
        if shape.sure:
            book.reason(said)
        else:
            book.assume(said + ".")
    hold = None
    if family.name in ("voltage", "blocked_force") and "voltage_V" in values:
        role = family.columns["voltage_V"]
        noise = scatter(values["voltage_V"][cut])
        if role.variant != "command" and is_reading(values["voltage_V"][cut]):
            hold = "linear"
            book.reason(
                f"hold = linear: the voltage scatters by {noise:.2g} V, so it is a reading taken together with the "
                "answer, not a command"
            )
    goes_on = part.continued and shape.kind in VOLTAGE_KINDS
    if part.continued and not goes_on:
        book.assume(
            f"{name or table.label}: taken to begin rested, although its times go on {part.rest_s:.4g} s after the "
            "recording above: what the specimen did between the two nobody recorded. If it had not rested, join them "
            "into one file."
        )
    rate, even = rate_of(t) if "time_s" in columns and t.size > 1 else (0.0, False)
    duration = float(t[-1] - t[0]) if t.size else 0.0
    noises = {
        own: (scatter(v[cut]), step_between(v[cut]))
        for own, v in values.items()
        if own in ("displacement_m", "force_N", "position_m")
    }
    return ProposedRecording(
        table.path,
        name,
        shape.kind,
        replace(table.format, rows=rows, columns=MappingProxyType(dict(columns))),
        part.last - part.first,
        rate,
        even,
        duration,
        hold,
        not goes_on,
        part.rest_s if goes_on else None,
        (),
        usable,
        MappingProxyType(noises),
    )


def _dotted(part: str) -> str:
    return "_" + re.sub(r"\W+", "_", part).strip("_") if part else ""


def _kind(family: Family, values: dict[str, Array], t: Array, cut: slice, kind: str | None) -> Shape:
    if family.name == "voltage" and "voltage_V" in values:
        return voltage_shape(t, values["voltage_V"][cut])
    if family.name == "mechanical":
        return Shape(kind or "compression", "")
    if family.name == "voltage":
        return Shape("voltage", "")
    return Shape(family.name, "")


# -- what is no recording of ours -------------------------------------------------------------------------------------


def _free_recordings(
    table: RawTable, roles: Sequence[Role], book: Notebook
) -> tuple[tuple[ProposedRecording, ...], str]:
    """A recording of a free kind with the columns under names of their own; none where there is no time."""
    role = next((r for r in roles if r.quantity == "time"), None)
    others = [
        r for r in roles if r.quantity not in ("time", "index", "run", "other time", "date") and span(r.values) > 0
    ]
    if role is None and table.rate_Hz is None:
        return (), "; without times it cannot be a recording at all"
    if not others:
        return (), "; nothing in it changes"
    column, known = time_column(list(roles), table, book, fallback="s")
    if not known or column is None:
        return (), ""
    columns: dict[str, ColumnMap] = {"time_s": column}
    for r in others:
        own, map_ = _free_column(r)
        if own == "temp_K":
            book.reason(f"{r.column.label}: kelvin by its range")
        while own in columns:
            own = "second_" + own
        columns[own] = map_
        if r.dimension is None and r.ours is None:
            book.reason(f"{r.column.label}: its unit is not said; the numbers are taken as they are")
    time = _si_time(column, roles, table, _raw_time(roles, table))
    run = next((r.values for r in roles if r.quantity == "run" and _like_runs(r.values)), None)
    parts = [p for p in split_rows(time, run, table.rows) if p.last - p.first >= MIN_ROWS]
    family = Family("free", {})
    out = []
    for k, part in enumerate(parts, start=1):
        number = k if len(parts) > 1 or part.last - part.first < table.rows else None
        built = _build(table, family, dict(columns), {}, time, part, number, None, book, usable=True)
        out.append(replace(built, kind=FREE_KIND, name=built.name.replace("_free", "") if built.name else None))
    return tuple(out), ""


def _free_column(role: Role) -> tuple[str, ColumnMap]:
    """A name of its own that ends in an SI unit where the unit is known, and the map."""
    if role.ours is not None:
        return role.ours, role.column.source
    if suffix(role.column.name) is not None and re.fullmatch(r"[A-Za-z]\w*", role.column.name):
        return role.column.name, role.column.source  # "input_V" says its SI unit already
    from bayes_dea.importing.words import read_name

    base = re.sub(r"\W+", "_", read_name(role.column.name).base.lower()).strip("_") or f"column_{role.column.name}"
    if not base[0].isalpha():
        base = "c_" + base
    if role.quantity == "temperature" and role.unit is None and 200.0 < float(np.nanmedian(role.values)) < 500.0:
        return "temp_K", role.column.source
    si = _FREE_UNITS.get(role.dimension or "")
    if si is None or role.unit is None:
        tail = suffix(base)
        return (base if tail is None else base + "_raw"), role.column.source
    same = parse_unit(role.unit) is not None and role.unit == (SI_SUFFIXES.get(si, si) if si == "C" else si)
    return f"{base}_{si}", role.column.source if same else replace(role.column.source, unit=role.unit)

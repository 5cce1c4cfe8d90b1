"""Text files: encoding, delimiter, decimal sign, header block, names and units above the numbers, time as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from bayes_dea.campaign.csv_source import CsvSource, to_float
from bayes_dea.campaign.format_map import ColumnMap
from bayes_dea.errors import InputError
from bayes_dea.importing.encodings import find_encoding
from bayes_dea.importing.facts import find_rate, header_facts
from bayes_dea.importing.layout import Layout, cells_of, find_layout, rows_format
from bayes_dea.importing.tables import RawColumn, RawTable, Unread
from bayes_dea.importing.unread import find_unread, refuse_unread_beginning
from bayes_dea.importing.words import parse_unit, read_name

_HEAD_BYTES = 400_000


def sniff_text(path: Path) -> list[RawTable]:
    """The one table of a text file, or none where it holds no rows of numbers.

    Raises InputError where the rows cannot be read as they stand (naming the row).
    """
    with path.open("rb") as handle:
        head = handle.read(_HEAD_BYTES)
        whole = not handle.read(1)
    if b"\0" in head[:4000] and not head.startswith((b"\xff\xfe", b"\xfe\xff")) and head[1:200:2].count(0) <= 40:
        return []
    encoding, why = find_encoding(head, whole)
    text = head.decode(encoding, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    if not whole:
        lines = lines[:-1]
    try:
        layout = find_layout(lines)
        if layout is None:
            return []
        above = [(i + 1, cells_of(lines[i], layout.delimiter)) for i in range(layout.first) if lines[i].strip()]
        refuse_unread_beginning(above, layout)
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from None
    return [_table(path, lines, layout, encoding, why)]


def _table(path: Path, lines: Sequence[str], layout: Layout, encoding: str, why: str) -> RawTable:
    above = [i for i in range(layout.first) if lines[i].strip()]
    rows = {i: cells_of(lines[i], layout.delimiter) for i in above}
    width = len(layout.kinds)
    names_at, units_at = _headings(above, rows, layout)
    blocks = [rows[i] for i in above if i not in (names_at, units_at)]
    facts = header_facts(blocks)
    names = rows[names_at] if names_at is not None else []
    units = rows[units_at] if units_at is not None else []
    facts |= _increment(names, units)
    rate = find_rate(facts)
    labels, beside, beside_from = _aligned(blocks, names, units, width)
    notes = [f"{encoding}: {why}", layout.described]
    narrow = names_at is not None and len(names) > width
    if names_at is None or narrow:
        fmt = rows_format(layout, encoding, layout.first, 0)
        notes.append(
            "no row of names above the numbers"
            if names_at is None
            else f"{len(names)} names above {width} columns, so the columns are taken by number"
        )
    else:
        fmt = rows_format(layout, encoding, names_at, len([i for i in above if i >= names_at]))
        notes.append(
            f"names in line {names_at + 1}"
            + (f", units in line {units_at + 1}" if units_at is not None else "")
            + f", numbers from line {layout.first + 1}"
        )
    source = CsvSource(path, fmt, path.name)
    shown = [labels[i] or (names[i] if i < len(names) else "") for i in range(width)]
    wanted: list[tuple[str, ColumnMap, str | None, bool]] = []
    for i, kind in enumerate(layout.kinds):
        if kind in ("text", "empty"):
            continue
        name = names[i] if i < len(names) else ""
        by_name = fmt.header > 0 and name != "" and list(source.names).count(name) == 1
        column = ColumnMap(name=name) if by_name else ColumnMap(index=i + 1)
        if kind != "number":
            column = replace(column, time_format=kind)
        wanted.append((shown[i] or f"column {i + 1}", column, beside[i], kind != "number"))
    values = source.read([w[1] for w in wanted])
    columns = tuple(
        RawColumn(label, column, array, unit, beside_from if unit else "", clock)
        for (label, column, unit, clock), array in zip(wanted, values.columns, strict=True)
    )
    return RawTable(
        path,
        fmt,
        columns,
        MappingProxyType(facts),
        tuple(notes),
        rate[0] if rate else None,
        rate[1] if rate else "",
        unread=tuple(_unread(lines, layout, shown, beside)),
    )


def _unread(
    lines: Sequence[str], layout: Layout, names: Sequence[str], units: Sequence[str | None]
) -> Iterator[Unread]:
    """The columns of text that should be numbers by their names."""
    texts = [i for i, kind in enumerate(layout.kinds) if kind == "text" and (names[i] or units[i])]
    if not texts:
        return
    rows = [(at, cells_of(line, layout.delimiter)) for at, line in enumerate(lines, 1) if at > layout.first]
    for i in texts:
        cells = [(at, row[i]) for at, row in rows if len(row) > i]
        found = find_unread(i + 1, names[i] or f"column {i + 1}", units[i], cells, layout.decimal)
        if found is not None:
            yield found


def _headings(above: Sequence[int], rows: dict[int, list[str]], layout: Layout) -> tuple[int | None, int | None]:
    """Lines of the names and of the units, None where there are none."""
    if not above:
        return None, None
    last = above[-1]
    if not _like_names(rows[last], layout):
        return None, None
    if len(above) > 1 and _like_units(rows[last], layout) and _like_names(rows[above[-2]], layout):
        return above[-2], last
    return last, None


def _like_names(cells: Sequence[str], layout: Layout) -> bool:
    filled = [c for c in cells if c]
    needed = sum(k not in ("empty", "text") for k in layout.kinds)
    texts = [c for c in filled if to_float(c, layout.decimal) is None]
    return len(filled) >= needed and len(texts) >= 0.5 * len(filled) and len(cells) >= needed


def _like_units(cells: Sequence[str], layout: Layout) -> bool:
    there = [c for c, k in zip(cells, layout.kinds, strict=False) if c and k not in ("text", "empty")]
    good = sum(parse_unit(c) is not None for c in there)
    return good >= 1 and good >= 0.5 * len(there)


def _increment(names: Sequence[str], units: Sequence[str]) -> dict[str, str]:
    """Rigol writes start and increment into the two header lines, as names and values."""
    return {
        n: u
        for n, u in zip(names, units, strict=False)
        if n and to_float(u, ".") is not None and u and n.lower() in ("increment", "tinc", "start", "t0")
    }


def _aligned(
    blocks: Sequence[list[str]], names: Sequence[str], units: Sequence[str], width: int
) -> tuple[list[str], list[str | None], str]:
    """Labels and units that stand above the columns, in the header block or in the line of units."""
    labels, found, where = [""] * width, [None] * width, ""
    result: list[str | None] = list(found)
    for cells in blocks:
        key = cells[0].lower() if cells else ""
        aligned = [c for c in cells[1:] if c]
        if not aligned or len(cells) > width + 4:
            continue
        if "horizontal" in key and "unit" in key and width and parse_unit(cells[1]):
            result[0], where = cells[1], "header block"
        elif "unit" in key and all(parse_unit(c) for c in aligned):
            for i, c in enumerate(cells[:width]):
                if i and c:
                    result[i], where = c, f'"{cells[0]}" in the header block'
        elif key in ("label", "labels", "channel name", "channel names", "name", "names"):
            for i, c in enumerate(cells[:width]):
                if i and c:
                    labels[i] = c
    for i, c in enumerate(units[:width]):
        if c and parse_unit(c) and not (i < len(names) and read_name(names[i]).unit):
            result[i], where = c, "line of units"
    return labels, result, where

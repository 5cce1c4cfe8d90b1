"""Columns whose names say that they hold a quantity, and whose cells are figures that no number can be read from:
numbers in groups of thousands, with another decimal sign than the others, or with a unit behind each.

They are not read by guess, because 1,000 may be one or a thousand; and they are not passed over in silence.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from bayes_dea.campaign.csv_source import GAPS, to_float
from bayes_dea.errors import InputError
from bayes_dea.importing.layout import Layout
from bayes_dea.importing.notebook import Notebook
from bayes_dea.importing.roles import Role
from bayes_dea.importing.tables import RawTable, Unread
from bayes_dea.importing.words import BY_DIMENSION, parse_unit, read_name

_GROUPED = re.compile(r"[+-]?\d{1,3}([.,'’_ \u00a0\u202f]\d{2,3})*[.,'’_ \u00a0\u202f]\d{3}([.,]\d*)?")
_WITH_UNIT = re.compile(r"[+-]?[\d.,]*\d[.,]?([eE][+-]?\d+)?\s*(?P<unit>[^\d\s.,]\S*)")
#: no recording takes these, and their cells are rightly text: names of runs, days
_OF_TEXT = ("index", "run", "date")
#: without these there is no recording, or it is one of another kind
_NEEDED = ("voltage", "displacement", "position", "force", "capacitance", "time")
_LEAVE = "leave out"


def find_unread(
    number: int, label: str, unit: str | None, cells: Sequence[tuple[int, str]], decimal: str
) -> Unread | None:
    """Column `number` (from 1) of text as one that cannot be read, None where it is rightly text.

    `unit` is one that stands beside the name, `cells` are (row, cell).
    """
    said = read_name(label, unit)
    quantity = said.quantity or BY_DIMENSION.get(said.dimension or "")
    filled = [(row, cell) for row, cell in cells if cell.lower() not in GAPS]
    if quantity is None or quantity in _OF_TEXT or not filled:
        return None
    if sum(_like_number(cell, quantity) for _, cell in filled) < 0.5 * len(filled):
        return None
    row, cell = next(((r, c) for r, c in filled if to_float(c, decimal) is None), filled[0])
    return Unread(number, label, quantity, row, cell, _remedy(cell, decimal))


def _like_number(cell: str, quantity: str) -> bool:
    plain = cell.replace("−", "-")
    with_unit = _WITH_UNIT.fullmatch(plain)
    if (
        to_float(plain, ".") is not None
        or to_float(plain, ",") is not None
        or _GROUPED.fullmatch(plain)
        or (with_unit is not None and parse_unit(with_unit["unit"]) is not None)
    ):
        return True
    # a time stamp is mostly digits as well
    digits, letters = sum(ch.isdigit() for ch in plain), sum(ch.isalpha() for ch in plain)
    return quantity != "time" and bool(re.match(r"[+-]?[.,]?\d", plain)) and digits > letters


def refuse_unread_beginning(rows: Sequence[tuple[int, Sequence[str]]], layout: Layout) -> None:
    """Raises InputError where the rows of numbers go on above the first that can be read.

    `rows` are (row, cells) above it. They would be taken for a header block, and what was measured first be lost.
    """
    found: tuple[int, int, str] | None = None
    for row, cells in reversed(rows):
        numbers = [i for i, kind in enumerate(layout.kinds[: len(cells)]) if kind == "number"]
        unread = [i for i in numbers if to_float(cells[i], layout.decimal) is None]
        if len(cells) < len(layout.kinds) or not all(_GROUPED.fullmatch(cells[i]) for i in unread):
            break
        if unread:
            found = row, unread[0], cells[unread[0]]
    if found is not None:
        row, i, cell = found
        raise InputError(f'row {row}, column {i + 1}: "{cell}" is not a number. {_remedy(cell, layout.decimal)}.')


def _remedy(cell: str, decimal: str) -> str:
    sign = "comma" if decimal == "," else "point"
    if _GROUPED.fullmatch(cell):
        return f"Write the numbers without grouping of thousands, with a decimal {sign} as in the other columns"
    if to_float(cell, "." if decimal == "," else ",") is not None:
        return f"Write the numbers with a decimal {sign} as in the other columns"
    if to_float(cell, decimal) is not None:
        return "Write the column as numbers"
    if _WITH_UNIT.fullmatch(cell):
        return "Write the numbers without a unit, which belongs beside the name of the column"
    return "Write the number, or nan for a gap"


def settle_unread(table: RawTable, roles: Sequence[Role], book: Notebook) -> bool:
    """Asks about the columns that cannot be read, and notes those that no recording needs; False where one stays open.

    A second column of times is no matter.
    """
    timed = any(r.quantity == "time" for r in roles)
    settled = True
    for column in table.unread:
        text = f'Column {column.number}, "{column.label}", row {column.row}: "{_cut(column.cell)}" is not a number.'
        if column.quantity not in _NEEDED or (column.quantity == "time" and timed):
            book.assume(f"{text} {column.remedy}; the column is left out.")
            continue
        answer = book.question(
            f"{column.label}.cells",
            f"{text} {column.remedy}, and import the file again; or is the column to be left out?",
            (_LEAVE,),
        )
        settled = settled and answer == _LEAVE
    return settled


def _cut(cell: str) -> str:
    return cell if len(cell) <= 40 else cell[:40] + "..."

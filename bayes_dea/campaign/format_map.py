"""The `[format]` map: how a file of another make becomes our columns, without rewriting it."""

from __future__ import annotations

import codecs
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

from bayes_dea.campaign.clock import NAMED_FORMATS, check_time_format
from bayes_dea.campaign.vocabulary import KNOWN_COLUMNS, did_you_mean, near
from bayes_dea.errors import InputError

FORMAT_KEYS = ("delimiter", "decimal", "encoding", "skip_rows", "header", "columns", "dataset", "struct",
               "type", "rows")
COLUMN_KEYS = ("name", "index", "unit", "sign", "scale", "offset", "rate_Hz", "time_format")
#: codecs of Python that take texts, but none of files
_OF_HOST_NAMES = ("idna", "punycode")
#: what an encoding of recordings can write
_SAMPLE = "0123456789+-.,;e\n"
TYPES = ("csv", "mat", "hdf5", "parquet")


@dataclass(frozen=True)
class ColumnMap:
    """Where one of our columns comes from.

    SI value = sign * unit(scale * (raw - offset)); offset is a number in the file's own unit, or "first" for
    the first finite value of the column. `index` counts columns from 1; with `name` it is a column of the
    matrix of that name (.mat, HDF5). `rate_Hz` makes a time axis for files that hold none; `time_format` reads one
    that is text ("iso", "clock" or a pattern of strptime; see clock.py), in seconds since the first row of the file.
    """

    name: str | None = None
    index: int | None = None
    unit: str | None = None
    sign: int = 1
    scale: float = 1.0
    offset: float | Literal["first"] = 0.0
    rate_Hz: float | None = None
    time_format: str | None = None

    def describe(self) -> str:
        """What to call the source in a message."""
        if self.name is not None:
            return f'"{self.name}"' + (f" column {self.index}" if self.index is not None else "")
        return f"column {self.index}"


@dataclass(frozen=True)
class FormatMap:
    """One `[format]` table. The defaults are the project's own CSV.

    `skip_rows` counts lines as they stand in the file, empty ones too. `header` is the number of header lines
    after them (True 1, False 0): names stand in the first, the others (units) are skipped. `dataset` is the
    group, struct, compound table or matrix of a .mat or HDF5 file inside which the names are looked up. `rows` (first
    and last row of numbers, counted from 1 after the header) takes one recording out of a long file.
    """

    delimiter: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    skip_rows: int = 0
    header: int = 1
    dataset: str | None = None
    type: str | None = None
    rows: tuple[int, int] | None = None
    columns: Mapping[str, ColumnMap] = field(default_factory=lambda: MappingProxyType({}))


def parse_format(table: object, where: str, base: FormatMap | None = None) -> FormatMap:
    """A FormatMap from a `[format]` table; what it does not say is taken from `base`.

    `where` names the place for messages ("campaign.toml, [format]"). Raises InputError for unknown keys
    (naming the nearest) and values that make no sense.
    """
    base = base or FormatMap()
    if table is False:
        return FormatMap()
    if not isinstance(table, Mapping):
        raise InputError(f"{where} must be a table of keys such as delimiter and columns (or false for the "
                         "project's own layout).")
    for key in table:
        if key not in FORMAT_KEYS:
            raise InputError(f'{where}: unknown key "{key}". {did_you_mean(key, FORMAT_KEYS)}')
    changes: dict[str, Any] = {}
    if "delimiter" in table:
        changes["delimiter"] = _delimiter(table["delimiter"], where)
    if "decimal" in table:
        if table["decimal"] not in (".", ","):
            raise InputError(f'{where}: decimal must be "." or ",", not {table["decimal"]!r}.')
        changes["decimal"] = table["decimal"]
    if "encoding" in table:
        changes["encoding"] = _encoding(table["encoding"], where)
    if "skip_rows" in table:
        changes["skip_rows"] = _count(table["skip_rows"], f"{where}: skip_rows")
    if "header" in table:
        header = table["header"]
        changes["header"] = int(header) if isinstance(header, bool) else _count(header, f"{where}: header")
    if "dataset" in table and "struct" in table:
        raise InputError(f"{where}: dataset and struct are two words for the same thing; give one.")
    for key in ("dataset", "struct"):
        if key in table:
            if not isinstance(table[key], str):
                raise InputError(f"{where}: {key} must be a text such as \"run1/data\".")
            changes["dataset"] = table[key]
    if "type" in table:
        if table["type"] not in TYPES:
            raise InputError(f"{where}: unknown type {table['type']!r}. "
                             f"{did_you_mean(str(table['type']), TYPES)}")
        changes["type"] = table["type"]
    if "rows" in table:
        changes["rows"] = _rows(table["rows"], where)
    if "columns" in table:
        if not isinstance(table["columns"], Mapping):
            raise InputError(f'{where}: columns must be a table, e.g. columns.time_s = "Time (s)".')
        mapped = dict(base.columns)
        for name, value in table["columns"].items():
            _refuse_misspelt(name, table["columns"], where)
            mapped[name] = _column(value, f"{where}: columns.{name}", name)
        changes["columns"] = MappingProxyType(mapped)
    return replace(base, **changes)


def _refuse_misspelt(name: str, mapped: Mapping[str, Any], where: str) -> None:
    """An unknown name is kept for models of the user's own, unless it is nearly one of ours."""
    guess = near(name, KNOWN_COLUMNS, 0.85)
    if name not in KNOWN_COLUMNS and guess is not None and guess not in mapped:
        raise InputError(f'{where}: columns.{name} is not a column we know. Did you mean columns.{guess}?')


def _delimiter(value: object, where: str) -> str:
    named = {"tab": "\t", "\\t": "\t", "comma": ",", "semicolon": ";", "space": "whitespace",
             " ": "whitespace"}
    if isinstance(value, str):
        value = named.get(value, value)
        if value == "whitespace" or len(value) == 1:
            return value
    raise InputError(f'{where}: delimiter must be one character, "tab" or "whitespace", not {value!r}.')


def _encoding(value: object, where: str) -> str:
    try:
        name = codecs.lookup(value).name  # type: ignore[arg-type]
        if name in _OF_HOST_NAMES or _SAMPLE.encode(name).decode(name) != _SAMPLE:  # hex and rot13 refuse texts
            raise LookupError
        return name
    except (LookupError, TypeError, ValueError):
        raise InputError(f'{where}: unknown encoding {value!r}. Common ones: "utf-8", "latin-1", "cp1252", '
                         '"gbk", "shift_jis", "utf-16".') from None


def _count(value: object, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InputError(f"{what} must be a whole number of lines, 0 or more, not {value!r}.")
    return value


def _rows(value: object, where: str) -> tuple[int, int]:
    whole = isinstance(value, list) and len(value) == 2 and all(
        isinstance(v, int) and not isinstance(v, bool) for v in value)
    if not whole or not 1 <= value[0] <= value[1]:  # type: ignore[index]
        raise InputError(f"{where}: rows must be the first and the last row of the recording, counted from 1 after the "
                         f"header, such as [1, 5000], not {value!r}.")
    return value[0], value[1]  # type: ignore[index]


def _time_format(value: object, what: str, own: str) -> str:
    if not isinstance(value, str) or not check_time_format(value):
        raise InputError(f'{what}: time_format must be one of {", ".join(NAMED_FORMATS)} or a pattern such as '
                         f'"%d.%m.%Y %H:%M:%S.%f", not {value!r}.')
    if own != "time_s":
        raise InputError(f"{what}: time_format goes with columns.time_s only.")
    return value


def _number(value: object, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{what} must be a finite number, not {value!r}.")
    return float(value)


def _column(value: object, what: str, own: str) -> ColumnMap:
    if isinstance(value, str):
        return ColumnMap(name=value)
    if isinstance(value, int) and not isinstance(value, bool):
        value = {"index": value}
    if not isinstance(value, Mapping):
        raise InputError(f'{what} must be the column\'s name in the file or a table such as {{ name = "HV '
                         f'monitor", unit = "kV" }}, not {value!r}.')
    for key in value:
        if key not in COLUMN_KEYS:
            raise InputError(f'{what}: unknown key "{key}". {did_you_mean(key, COLUMN_KEYS)}')
    name, index, unit, offset = (value.get(k) for k in ("name", "index", "unit", "offset"))
    for key, text in (("name", name), ("unit", unit)):
        if text is not None and not isinstance(text, str):
            raise InputError(f"{what}: {key} must be a text, not {text!r}.")
    if index is not None and (isinstance(index, bool) or not isinstance(index, int) or index < 1):
        raise InputError(f"{what}: index must be a whole number counted from 1, not {index!r}.")
    sign = value.get("sign", 1)
    if isinstance(sign, bool) or sign not in (1, -1):
        raise InputError(f"{what}: sign must be 1 or -1, not {sign!r} (a factor is called scale).")
    rate = value.get("rate_Hz")
    if rate is not None:
        rate = _number(rate, f"{what}: rate_Hz")
        if own != "time_s" or rate <= 0 or name is not None or index is not None:
            raise InputError(f"{what}: rate_Hz must be positive, and stands alone under columns.time_s, for "
                             "files without a time column.")
    elif name is None and index is None:
        name = own
    time_format = value.get("time_format")
    if time_format is not None:
        time_format = _time_format(time_format, what, own)
        if rate is not None or unit is not None:
            raise InputError(f"{what}: time_format gives seconds; take unit and rate_Hz out.")
    if offset is not None and offset != "first":
        offset = _number(offset, f'{what}: offset (a number, or "first")')
    scale = _number(value.get("scale", 1.0), f"{what}: scale")
    if scale == 0.0:
        raise InputError(f"{what}: scale is 0, which would make every value 0.")
    return ColumnMap(name, index, unit, int(sign), scale, 0.0 if offset is None else offset, rate,
                     time_format)

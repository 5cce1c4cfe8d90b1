"""CSV recordings: a fast path through pyarrow, and a careful one that finds the row of a bad cell."""

from __future__ import annotations

import csv
import io
import math
import re
from array import array
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.clock import BadTimeError, likely_format, seconds
from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.scratch import PIECE, Gathering, Scratch
from bayes_dea.campaign.tables import Table, ambiguous_column, missing_column
from bayes_dea.errors import InputError

#: cells that are gaps (compared without case); "-nan" is what C's printf writes
GAPS = frozenset({"", "nan", "-nan", "+nan"})
_GAP_SPELLINGS = ["", "nan", "NaN", "NAN", "Nan", "-nan", "-NaN"]
#: encodings in which a comma or digit byte may be a part of something else: decoded before anything is split
_WIDE = ("utf-16", "utf-32", "utf-7")
#: rows looked at when judging whether the last line was cut
_TAIL_ROWS = 1000


class CsvSource:
    """A CSV file whose header has been read."""

    def __init__(self, path: Path, fmt: FormatMap, label: str, scratch: Scratch | None = None) -> None:
        self.path, self.fmt, self.label = path, fmt, label
        self._scratch = scratch or Scratch()
        self.encoding = fmt.encoding
        with path.open("rb") as handle:
            start = handle.read(4)
        if start.startswith(b"\xef\xbb\xbf") and self.encoding == "utf-8":
            self.encoding = "utf-8-sig"
        if start.startswith((b"\xff\xfe", b"\xfe\xff")) and not self.encoding.startswith("utf-16"):
            raise InputError(f'{label}: the file is UTF-16. Set encoding = "utf-16" in its [format].')
        self._undecodable = False
        self.names, self.data_line = self._read_header()
        self._index = {name: i for i, name in reversed(list(enumerate(self.names)))}

    # -- header -----------------------------------------------------------------------------------------

    def _lines(self) -> IO[str]:
        return self.path.open("r", encoding=self.encoding, errors="surrogateescape", newline="")

    def _cells(self, line: str) -> list[str]:
        if self.fmt.delimiter == "whitespace":
            return line.split()
        row = next(csv.reader([line.rstrip("\r\n")], delimiter=self.fmt.delimiter, skipinitialspace=True), [])
        return [cell.strip() for cell in row]

    def _read_header(self) -> tuple[tuple[str, ...], int]:
        """Names of the columns and the number (from 1) of the first line after the header."""
        wanted = {c.name for c in self.fmt.columns.values() if c.name is not None}
        names: list[str] | None = None
        to_read = self.fmt.header
        skipped: list[list[str]] = []
        with self._lines() as lines:
            for number, line in enumerate(_physical(lines, self.label), start=1):
                if number <= self.fmt.skip_rows:
                    skipped.append(self._cells(line))
                    continue
                if not line.strip():
                    continue
                cells = self._cells(line)
                if to_read == 0:
                    if names is None:
                        names = [f"column {i + 1}" for i in range(len(cells))]
                    return self._finish(names, len(cells)), number
                if names is None and wanted and all(_is_number(c, self.fmt.decimal) for c in cells):
                    # two header lines, both counted as skipped: the names stand in one of those
                    earlier = next((s for s in skipped if wanted & set(s)), None)
                    if earlier is not None:
                        return self._finish(earlier, len(cells)), number
                if names is None:
                    names = cells
                to_read -= 1
        if names is None:
            raise InputError(f"{self.label}: the file has no rows after the {self.fmt.skip_rows} that are "
                             "skipped; it is empty or was cut. Record it again, or correct skip_rows.")
        raise InputError(f"{self.label}: the file has a header and not one row of numbers. Record it again, "
                         "or take it out of campaign.toml.")

    def _finish(self, names: list[str], width: int) -> tuple[str, ...]:
        self._named = len(names)
        self._undecodable = any(_has_surrogate(n) for n in names)
        # rows often end with a delimiter that the header lacks
        return tuple(names + [f"column {i + 1}" for i in range(len(names), width)])

    # -- columns ----------------------------------------------------------------------------------------

    def has(self, column: ColumnMap) -> bool:
        """Whether the file has that column."""
        if column.index is not None:
            return column.index <= len(self.names)
        return column.name in self._index

    def position(self, column: ColumnMap) -> int:
        """Position (from 0) of a column. Raises InputError where it is missing or ambiguous."""
        if column.name is not None and column.index is not None:
            raise InputError(f"{self.label}: a column of a CSV file is given by name or by index, not both.")
        if not self.has(column):
            raise self.missing(column.name or "", column)
        if column.index is not None:
            return column.index - 1
        if self.names.count(str(column.name)) > 1:
            places = [i + 1 for i, n in enumerate(self.names) if n == column.name]
            raise ambiguous_column(self.label, self.fmt, column, _readable(str(column.name)), places)
        return self._index[str(column.name)]

    def missing(self, own: str, column: ColumnMap) -> InputError:
        """The error for a column that is not there; `own` is what we call it."""
        names = [_readable(n) for n in self.names]
        return missing_column(self.label, own, column, names, self._header_hint(column))

    def _other_encoding(self, column: ColumnMap) -> str | None:
        """A common encoding under which the name does stand in the first lines."""
        name = column.name
        if name is None or name.isascii():
            return None
        with self.path.open("rb") as handle:
            head = b"".join(handle.readline(100_000) for _ in range(self.data_line - 1))
        for encoding in ("utf-8", "gbk", "latin-1", "shift_jis"):
            try:
                if name in head.decode(encoding):
                    return encoding
            except UnicodeDecodeError:
                continue
        return None

    def _header_hint(self, column: ColumnMap) -> str:
        other = self._other_encoding(column)
        if other is not None:
            return f'Read as {other} the header holds it: set encoding = "{other}" in its [format].'
        if self._undecodable:
            return (f"The header is not {self.fmt.encoding}: set encoding in its [format], e.g. \"latin-1\" "
                    "or "
                    '"gbk".')
        header = ("," if self.fmt.delimiter == "whitespace" else self.fmt.delimiter).join(self.names[: self._named])
        for mark, name in ((";", ";"), ("\t", "tab"), (",", ","), ("|", "|")):
            held = column.name in [cell.strip() for cell in header.split(mark)]
            if mark in header and mark != self.fmt.delimiter and (held or self._named == 1):
                return (f'The header looks separated otherwise: set delimiter = "{name}"{self._decimal_hint(mark)} in '
                        "its [format].")
        if self._named == 1 and len(self.names[0].split()) > 1 and self.fmt.delimiter != "whitespace":
            return 'The header looks separated by spaces: set delimiter = "whitespace" in its [format].'
        if all(_is_number(n, self.fmt.decimal) for n in self.names):
            return ("The first row holds numbers, so the file seems to have no header: set header = false in "
                    "its [format] and give the columns by number, e.g. columns.time_s = { index = 1 }.")
        return ""

    def _decimal_hint(self, mark: str) -> str:
        """What to add where the first row of numbers, separated by `mark`, has decimal commas."""
        with self._lines() as lines:
            row = next((line for line in islice(lines, self.data_line - 1, self.data_line)), "")
        cells = [cell.strip() for cell in row.split(mark)]
        comma = self.fmt.decimal == "." and mark != "," and any(
            "," in cell and to_float(cell, ",") is not None for cell in cells)
        return ' and decimal = ","' if comma else ""

    def read(self, columns: Sequence[ColumnMap]) -> Table:
        """The columns as float64, nan where a cell is empty or nan.

        Raises InputError naming the row (as counted in the file, from 1) and column of text in a number, of a
        row with too few or too many cells, and of a line that was cut.
        """
        positions = [self.position(c) for c in columns]
        texts = {p: c.time_format for p, c in zip(positions, columns, strict=True) if c.time_format is not None}
        numbers = [p for p in positions if p not in texts]
        warnings = self._check_tail(numbers) if numbers else ()
        arrays = self._fast(positions) if not texts else None
        if arrays is None:
            arrays = self._with_times(positions, texts) if texts else self._careful(positions)
        if arrays[0].size == 0:
            raise InputError(f"{self.label}: the file has a header and not one row of numbers.")
        return Table(tuple(arrays), self._where, warnings)

    def _with_times(self, positions: list[int], texts: dict[int, str]) -> list[NDArray[np.float64]]:
        """Columns of which some hold time as text."""
        out: dict[int, NDArray[np.float64]] = {}
        numbers = [p for p in dict.fromkeys(positions) if p not in texts]
        if numbers:
            fast = self._fast(numbers)
            out.update(zip(numbers, fast if fast is not None else self._careful(numbers), strict=True))
        for p, time_format in texts.items():
            cells = (row[p] if len(row) > p else "" for _, row in self._rows())
            try:
                with Gathering(1, self._scratch) as gathered:
                    gathered.add([seconds(cells, time_format)])
                    (out[p],) = gathered.columns()
            except BadTimeError as exc:
                raise InputError(f'{self.label}, {self._where(exc.index)}, column "{_readable(self.names[p])}": '
                                 f'"{exc.text[:40]}" is no time of the format "{time_format}". Correct the cell, or '
                                 "time_format in its [format].") from exc
        return [out[p] for p in positions]

    def _where(self, index: int) -> str:
        for i, (number, _) in enumerate(self._rows()):
            if i == index:
                return f"row {number}"
        return f"row {index + 1} after the header"

    def _fast(self, positions: list[int]) -> list[NDArray[np.float64]] | None:
        """Through pyarrow; None where it stumbles, for the careful path to say why (or to read it)."""
        if self.fmt.delimiter == "whitespace":
            return self._fast_whitespace(positions)
        import pyarrow as pa
        from pyarrow import csv as pa_csv

        names = [str(i) for i in range(len(self.names))]
        wanted = [str(i) for i in dict.fromkeys(positions)]
        plain = not self.encoding.startswith(_WIDE)  # numbers need no decoding
        try:
            with self.path.open("rb") as handle, Gathering(len(positions), self._scratch) as gathered:
                if plain:
                    for _ in range(self.data_line - 1):
                        handle.readline()
                pieces = pa_csv.open_csv(
                    handle,
                    read_options=pa_csv.ReadOptions(
                        column_names=names, encoding="utf8" if plain else self.encoding,
                        skip_rows=0 if plain else self.data_line - 1, block_size=1 << 20),
                    parse_options=pa_csv.ParseOptions(delimiter=self.fmt.delimiter, quote_char='"'),
                    convert_options=pa_csv.ConvertOptions(
                        column_types={n: pa.float64() for n in wanted}, include_columns=wanted,
                        null_values=_GAP_SPELLINGS, quoted_strings_can_be_null=True,
                        decimal_point=self.fmt.decimal))
                for piece in pieces:
                    gathered.add([piece.column(str(p)).to_numpy(zero_copy_only=False) for p in positions])
                return gathered.columns()
        except (pa.ArrowInvalid, pa.ArrowKeyError, UnicodeError, ValueError):
            return None

    def _fast_whitespace(self, positions: list[int]) -> list[NDArray[np.float64]] | None:
        import pandas as pd

        try:
            with Gathering(len(positions), self._scratch) as gathered, pd.read_csv(
                    self.path, sep=r"\s+", header=None, skiprows=self.data_line - 1, decimal=self.fmt.decimal,
                    encoding=self.encoding, dtype=np.float64, names=list(range(len(self.names))), index_col=False,
                    usecols=sorted(set(positions)), keep_default_na=False, na_values=_GAP_SPELLINGS,
                    chunksize=PIECE) as frames:
                for frame in frames:
                    if frame.isna().to_numpy().any():  # a short row looks like gaps here
                        return None
                    gathered.add([frame[p].to_numpy(np.float64) for p in positions])
                return gathered.columns()
        except (ValueError, UnicodeError):
            return None

    # -- careful path -----------------------------------------------------------------------------------

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """(line number in the file, cells) of every row of data, blank lines left out."""
        with self._lines() as lines:
            for _ in range(self.data_line - 1):
                lines.readline()
            if self.fmt.delimiter == "whitespace":
                for number, line in enumerate(lines, start=self.data_line):
                    if line.strip():
                        yield number, line.split()
                return
            reader = csv.reader(lines, delimiter=self.fmt.delimiter, skipinitialspace=True)
            before = 0
            try:
                for cells in reader:
                    number = self.data_line + before  # a quoted cell may span lines: name its first
                    before = reader.line_num
                    if cells and not (len(cells) == 1 and not cells[0].strip()):
                        yield number, cells
            except csv.Error as exc:
                raise InputError(f"{self.label}, row {self.data_line + before}: the row cannot be read "
                                 f"({exc}); the file was cut or damaged there. Copy it again from the "
                                 "recorder.") from exc

    def _careful(self, positions: list[int]) -> list[NDArray[np.float64]]:
        with Gathering(len(positions), self._scratch) as gathered:
            self._carefully(positions, gathered)
            return gathered.columns()

    def _carefully(self, positions: list[int], gathered: Gathering) -> None:
        values = [array("d") for _ in positions]  # a list of numbers would take four times as much
        width = len(self.names)
        rows = self._rows()
        number, cells = next(rows, (0, []))
        while number:
            following = next(rows, (0, []))
            last = following[0] == 0
            if len(cells) < width and (len(cells) <= max(positions) or last):
                end = "the file was cut there" if last else "the file is damaged there"
                raise InputError(f"{self.label}, row {number}: {len(cells)} cells instead of {width}; {end}. "
                                 "Copy it again from the recorder, or delete that row.")
            if len(cells) > width and any(c.strip() for c in cells[width:]):
                hint = (' Perhaps numbers have a decimal comma: set decimal = "," and the right delimiter in '
                        'its [format].' if self.fmt.delimiter == "," else "")
                raise InputError(f"{self.label}, row {number}: {len(cells)} cells instead of {width}.{hint} "
                                 "Correct that row.")
            for column, p in zip(values, positions, strict=True):
                value = to_float(cells[p], self.fmt.decimal)
                if value is None:
                    raise self._bad_cell(number, p, cells[p].strip(), not values[0] and not gathered.rows)
                column.append(value)
            if last or len(values[0]) >= PIECE:
                gathered.add(values)
                values = [array("d") for _ in positions]
            number, cells = following

    def _bad_cell(self, number: int, position: int, text: str, first: bool) -> InputError:
        shown = text if len(text) <= 40 else text[:40] + "..."
        if "\0" in text:
            return InputError(f"{self.label}, row {number}: zero bytes instead of a number; the recorder "
                              "stopped while writing. Delete the rows from there on.")
        remedy = "Write the number, or nan for a gap."
        if re.fullmatch(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?", text):
            remedy = ('Does the comma separate thousands? Then write the numbers without it; if it is a decimal comma, '
                      'set decimal = "," in its [format].')
        elif self.fmt.decimal == "." and to_float(text, ",") is not None:
            remedy = 'The number has a decimal comma: set decimal = "," in its [format].'
        elif self.fmt.decimal == "," and to_float(text, ".") is not None:
            remedy = 'The number has a decimal point: set decimal = "." in its [format].'
        elif (time_format := likely_format(text)) is not None:
            remedy = (f"That is a time written as text: set columns.time_s = {{ name = "
                      f'"{_readable(self.names[position])}", time_format = "{time_format}" }} in its [format].')
        elif first and self.fmt.header:
            remedy = ("If that is a second header line (units), set header = 2 in its [format]; otherwise "
                      "write the number, or nan for a gap.")
        return InputError(f'{self.label}, row {number}, column "{_readable(self.names[position])}": '
                          f'"{shown}" is not a number. {remedy}')

    def _check_tail(self, positions: list[int]) -> tuple[str, ...]:
        """What an unfinished last line says: an error where it was plainly cut, a warning where it may be."""
        if self.encoding.startswith(("utf-16", "utf-32")):
            return ()
        with self.path.open("rb") as handle:
            size = handle.seek(0, io.SEEK_END)
            handle.seek(max(0, size - 200_000))
            tail = handle.read()
        if tail.endswith((b"\n", b"\r")):
            return ()
        lines = tail.decode(self.encoding, errors="replace").splitlines()
        rows = [row for row in map(self._cells, lines[-_TAIL_ROWS:]) if row]
        last = rows.pop()
        # rows of data only, and whole ones (the header, and the first line of the piece, are not)
        before = [r for r in rows
                  if len(r) >= len(self.names) and _is_number(r[positions[0]], self.fmt.decimal)]
        if not before:
            return ()
        with self._lines() as everything:
            number = sum(1 for _ in everything)
        cut = InputError(f"{self.label}, row {number}: the file was cut in the middle of this row "
                         f"({len(last)} cells of {len(self.names)}, ends with "
                         f'"{last[-1][-20:]}", no line end). Copy it again from the recorder, or delete that '
                         "row.")
        if len(last) < len(self.names):
            raise cut
        end = len(last) - 1
        full = [r[end] for r in before if len(r) > end]
        if end in positions and (
                to_float(last[end], self.fmt.decimal) is None
                or (last[end] == "" and all(c != "" for c in full))
                or (len(full) >= 10 and len(last[end]) < min(map(len, full)))):
            raise cut
        return (f"{self.label}: the last row ({number}) has no line end; if the recording was cut there, its "
                "last number may lack digits. Delete that row if in doubt.",)


def _physical(lines: IO[str], label: str) -> Iterator[str]:
    """Lines of the header region; refuses what is no text at all."""
    for i, line in enumerate(lines):
        if i < 3 and "\0" in line:
            wide = _wide(line)
            if wide:
                raise InputError(f'{label}: the file looks like {wide.upper()} (every other byte is zero). Set '
                                 f'encoding = "{wide}" in its [format].')
            raise InputError(f"{label}: the file holds binary data, not text. If it is a .mat, HDF5 or "
                             "Parquet file, say so: type = "
                             '"mat", "hdf5" or "parquet" in its [format].')
        yield line


def _wide(line: str) -> str:
    """The encoding of 16 bits by which the first characters of a line are ASCII and zeros in turn, or ""."""
    first = line[:20]
    for encoding, zeros, texts in (("utf-16-le", first[1::2], first[0::2]), ("utf-16-be", first[0::2], first[1::2])):
        if len(first) >= 4 and not zeros.strip("\0") and "\0" not in texts:
            return encoding
    return ""


def _has_surrogate(text: str) -> bool:
    return any("\udc80" <= ch <= "\udcff" for ch in text)


def _readable(text: str) -> str:
    return text.encode("utf-8", "replace").decode("utf-8")


def to_float(cell: str, decimal: str) -> float | None:
    """The number in a cell, nan for a gap, None for text."""
    text = cell.strip()
    if text.lower() in GAPS:
        return math.nan
    if decimal == ",":
        if "." in text:
            return None
        text = text.replace(",", ".")
    if "_" in text:  # Python would read 1_000 as a number
        return None
    try:
        return float(text)
    except ValueError:
        return None


def _is_number(cell: str, decimal: str) -> bool:
    return to_float(cell, decimal) is not None

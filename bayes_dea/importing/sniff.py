"""A file of any type -> its tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bayes_dea.campaign.format_map import FormatMap
from bayes_dea.campaign.tables import file_type
from bayes_dea.errors import InputError
from bayes_dea.importing.tables import RawTable, distinct


def sniff(path: Path) -> list[RawTable]:
    """Every table of numbers in a file: one for text and Parquet, one a struct or group for .mat and HDF5.

    An empty list where there is no table. Raises InputError for a file that is empty, damaged or of a type that has
    to be converted first.
    """
    return [replace(table, columns=distinct(table.columns)) for table in _tables(path)]


def _tables(path: Path) -> list[RawTable]:
    if path.stat().st_size == 0:
        raise InputError(f"{path.name}: the file is empty. Copy it again from the recorder.")
    with path.open("rb") as handle:
        head = handle.read(8)
    for magic, what in (
        (b"PK\x03\x04", "an Excel or other zipped file; save it as CSV"),
        (b"\xd0\xcf\x11\xe0", "an old Excel file; save it as CSV"),
        (b"TDSm", "a TDMS file of LabVIEW; export it as HDF5, .mat or CSV"),
    ):
        if head.startswith(magic):
            raise InputError(f"{path.name}: is {what}.")
    kind = file_type(path, FormatMap())
    if kind == "csv":
        from bayes_dea.importing.sniff_text import sniff_text

        return sniff_text(path)
    from bayes_dea.importing.sniff_arrays import sniff_arrays, sniff_parquet

    return sniff_parquet(path) if kind == "parquet" else sniff_arrays(path, kind)

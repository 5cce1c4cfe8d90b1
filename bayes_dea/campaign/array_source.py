"""Recordings in .mat files (5 and 7.3) and HDF5: arrays found by name, through groups and structs."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.tables import Table, missing_column, text_times
from bayes_dea.errors import InputError

#: reads one leaf of the file
Loader = Callable[[], NDArray[Any]]


class ArraySource:
    """Named arrays of a file. Names are paths ("run1/time"); MATLAB's dots and runs(2) work too."""

    def __init__(self, leaves: Mapping[str, Loader], fmt: FormatMap, label: str) -> None:
        self.fmt, self.label = fmt, label
        self._all = dict(leaves)
        self._leaves = self._all
        if fmt.dataset is not None:
            self._leaves = self._below(fmt.dataset)
        self.names = tuple(name for name in self._leaves if name)

    def _below(self, dataset: str) -> dict[str, Loader]:
        for root in (dataset.strip("/"), _path(dataset)):
            if root in self._all:
                return {"": self._all[root]}
            inside = {k[len(root) + 1:]: v for k, v in self._all.items() if k.startswith(root + "/")}
            if inside:
                return inside
        parents = sorted({k.rsplit("/", 1)[0] for k in self._all if "/" in k})
        raise missing_column(self.label, "dataset", ColumnMap(name=dataset), parents + list(self._all),
                             "Correct dataset in its [format].")

    def _key(self, column: ColumnMap) -> str | None:
        if column.name is None:
            return "" if "" in self._leaves else None
        for key in (column.name.strip("/"), _path(column.name)):
            if key in self._leaves:
                return key
        return None

    @property
    def leaves(self) -> Mapping[str, Loader]:
        """Every array of the file (below `dataset` where one is said): name -> what reads it."""
        return self._leaves

    def has(self, column: ColumnMap) -> bool:
        """Whether the file has that array."""
        return self._key(column) is not None

    def missing(self, own: str, column: ColumnMap) -> InputError:
        """The error for an array that is not there; `own` is what we call it."""
        if column.name is None:
            return InputError(f"{self.label}: {column.describe()} of what? In a .mat or HDF5 file say which "
                              "matrix: { name = "
                              '"data", index = 1 }, or dataset = "data" in its [format]. Found: '
                              f"{', '.join(self.names[:30])}.")
        return missing_column(self.label, own, column, self.names)

    def read(self, columns: Sequence[ColumnMap]) -> Table:
        """The columns as float64. Raises InputError for missing arrays, text, and unequal lengths."""
        arrays = [self._one(c) for c in columns]
        lengths = {c.describe(): a.size for c, a in zip(columns, arrays, strict=True)}
        if len(set(lengths.values())) > 1:
            said = ", ".join(f"{k} {v}" for k, v in lengths.items())
            raise InputError(f"{self.label}: the columns have different lengths ({said}); they cannot be one "
                             "recording. Correct columns in its [format].")
        return Table(tuple(arrays), lambda i: f"element {i + 1}")

    def _one(self, column: ColumnMap) -> NDArray[np.float64]:
        key = self._key(column)
        if key is None:
            raise self.missing(column.name or "", column)
        raw = np.asarray(self._leaves[key]())
        if column.time_format is not None and raw.dtype.kind in "USO":
            return text_times([str(v.decode("utf-8", "replace") if isinstance(v, bytes) else v).strip()
                               for v in np.ravel(raw)], column, self.label, "element")
        if raw.dtype.kind not in "fiub":
            raise InputError(f"{self.label}: {column.describe()} holds {_kind_of(raw)}, not real numbers. "
                             f"Name another array in its [format]; found: {', '.join(self.names[:30])}.")
        if column.index is not None and raw.ndim >= 2:
            raw = raw.reshape(raw.shape[0], -1)
            if column.index > raw.shape[1]:
                raise InputError(f"{self.label}: {column.describe()} is asked for, but the matrix has "
                                 f"{raw.shape[1]} columns ({raw.shape[0]} x {raw.shape[1]}).")
            raw = raw[:, column.index - 1]
        raw = np.squeeze(raw)
        if raw.ndim > 1:
            raise InputError(f"{self.label}: {column.describe()} is a matrix "
                             f"({' x '.join(map(str, raw.shape))}). Say which column of it: "
                             '{ name = "...", index = 1 }.')
        return np.array(np.atleast_1d(raw), dtype=np.float64)


def open_arrays(path: Path, fmt: FormatMap, label: str, kind: str) -> ArraySource:
    """Opens a .mat (5 or 7.3) or HDF5 file. Raises InputError where it cannot be read."""
    import h5py

    if h5py.is_hdf5(path):
        return ArraySource(_hdf5_leaves(path, matlab=kind == "mat", label=label), fmt, label)
    if kind == "hdf5":
        raise InputError(f"{label}: cannot be read as HDF5; the file was cut or is of another type. Copy it "
                         "again from the recorder.")
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except Exception as exc:  # scipy raises many kinds on a damaged file
        raise InputError(f"{label}: cannot be read as a .mat file; the file was cut or is of another type. "
                         "Copy it again from the recorder.") from exc
    leaves: dict[str, Loader] = {}
    _flatten({k: v for k, v in content.items() if not k.startswith("__")}, "", leaves)
    return ArraySource(leaves, fmt, label)


def _flatten(value: Any, name: str, leaves: dict[str, Loader]) -> None:
    """Leaves of nested structs; struct arrays are numbered from 1 as in MATLAB."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            _flatten(part, f"{name}/{key}" if name else str(key), leaves)
    elif isinstance(value, np.ndarray) and value.dtype == object and value.size and all(
            isinstance(part, str) for part in value.ravel()):
        leaves[name] = lambda: np.asarray(value.ravel(), dtype=str)  # a cell array of texts
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for i, part in enumerate(np.asarray(value, dtype=object).ravel(), start=1):
            _flatten(part, f"{name}({i})", leaves)
    else:
        leaves[name] = lambda: np.asarray(value)


def _hdf5_leaves(path: Path, matlab: bool, label: str) -> dict[str, Loader]:
    """Every dataset of the file, fields of compound tables and of MATLAB's struct arrays one by one."""
    import h5py

    leaves: dict[str, Loader] = {}

    def load(name: str, field: str | None = None, element: int | None = None) -> Loader:
        def loader() -> NDArray[Any]:
            try:
                with h5py.File(path, "r") as file:
                    data: Any = file[name]
                    if element is not None:
                        data = file[np.ravel(data[()])[element]]
                    array = np.asarray(data.fields(field)[()] if field is not None else data[()])
            except (OSError, KeyError, RuntimeError, ValueError) as exc:
                raise InputError(f'{label}: "{name}" cannot be read; the file was cut or damaged. Copy it '
                                 'again from the recorder.') from exc
            return array.T if matlab else array  # MATLAB stores columns first
        return loader

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        if item.dtype.names:
            for part in item.dtype.names:
                leaves[f"{name}/{part}"] = load(name, field=part)
        elif h5py.check_ref_dtype(item.dtype) is not None:
            group, _, last = name.rpartition("/")
            for i in range(item.size):
                key = f"{group}({i + 1})/{last}" if group else f"{last}({i + 1})"
                leaves[key] = load(name, element=i)
        else:
            leaves[name] = load(name)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(visit)
    except (OSError, KeyError, RuntimeError, ValueError) as exc:
        raise InputError(f"{label}: cannot be read as HDF5; the file was cut or damaged. Copy it again from "
                         "the recorder.") from exc
    return leaves


def _path(name: str) -> str:
    """MATLAB's spelling as a path: rec.time -> rec/time."""
    return re.sub(r"\.", "/", name).strip("/")


def _kind_of(array: NDArray[Any]) -> str:
    return {"U": "text", "S": "text", "O": "objects", "c": "complex numbers"}.get(array.dtype.kind,
                                                                                  str(array.dtype))

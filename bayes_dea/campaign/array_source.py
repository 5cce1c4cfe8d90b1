"""Recordings in .mat files (5 and 7.3) and HDF5: arrays found by name, through groups and structs."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_dea.campaign.format_map import ColumnMap, FormatMap
from bayes_dea.campaign.scratch import Gathering, Scratch, pieces
from bayes_dea.campaign.tables import Table, missing_column, text_times
from bayes_dea.errors import InputError

#: reads one leaf of the file
Loader = Callable[[], NDArray[Any]]
#: numbers of a .mat variable from which on it is read by itself
_LONG = 1_000_000
#: classes of MATLAB that are arrays of numbers
_NUMERIC = ("double", "single", "logical", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")


class ArraySource:
    """Named arrays of a file. Names are paths ("run1/time"); MATLAB's dots and runs(2) work too."""

    def __init__(self, leaves: Mapping[str, Loader], fmt: FormatMap, label: str,
                 scratch: Scratch | None = None) -> None:
        self.fmt, self.label = fmt, label
        self._scratch = scratch or Scratch()
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
        leaf = self._leaves[key]
        with Gathering(1, self._scratch) as gathered:
            parts = leaf.parts(column.index) if isinstance(leaf, _Dataset) and column.time_format is None else None
            for part in [self._whole(column, leaf)] if parts is None else parts:
                gathered.add([part])
            return gathered.columns()[0]

    def _whole(self, column: ColumnMap, leaf: Loader) -> NDArray[np.float64]:
        raw = np.asarray(leaf())
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
        return np.asarray(np.atleast_1d(raw), dtype=np.float64)


def open_arrays(path: Path, fmt: FormatMap, label: str, kind: str, scratch: Scratch | None = None) -> ArraySource:
    """Opens a .mat (5 or 7.3) or HDF5 file. Raises InputError where it cannot be read."""
    import h5py

    if h5py.is_hdf5(path):
        return ArraySource(_hdf5_leaves(path, matlab=kind == "mat", label=label), fmt, label, scratch)
    if kind == "hdf5":
        raise InputError(f"{label}: cannot be read as HDF5; the file was cut or is of another type. Copy it "
                         "again from the recorder.")
    return ArraySource(_mat5_leaves(path, label), fmt, label, scratch)


def _mat5_leaves(path: Path, label: str) -> dict[str, Loader]:
    """Every array of a .mat of version 5; long ones are read when they are asked for, one at a time."""
    from scipy.io import loadmat, whosmat

    def read(names: list[str]) -> dict[str, Any]:
        try:
            content: dict[str, Any] = loadmat(path, variable_names=names, simplify_cells=True)
        except Exception as exc:  # scipy raises many kinds on a damaged file
            raise unreadable from exc
        return {k: v for k, v in content.items() if not k.startswith("__")}

    unreadable = InputError(f"{label}: cannot be read as a .mat file; the file was cut or is of another type. "
                            "Copy it again from the recorder.")
    try:
        listed = whosmat(path)
    except Exception as exc:
        raise unreadable from exc
    long = [name for name, shape, kind in listed if kind in _NUMERIC and math.prod(shape) > _LONG]
    leaves: dict[str, Loader] = {}
    _flatten(read([name for name, _, _ in listed if name not in long]), "", leaves)
    for name in long:
        leaves[name] = lambda name=name: np.asarray(read([name])[name])  # type: ignore[misc]
    return {k: leaves[k] for k in sorted(leaves, key=lambda k: _order(k, [name for name, _, _ in listed]))}


def _order(leaf: str, variables: Sequence[str]) -> int:
    """Place of the variable that an array belongs to among those of the file."""
    top = leaf.split("/")[0]
    return variables.index(top) if top in variables else variables.index(top.rpartition("(")[0])


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


@dataclass(frozen=True)
class _Dataset:
    """One array of an HDF5 file: a dataset, a field of a compound one, or what an element of it refers to."""

    path: Path
    label: str
    matlab: bool  # which stores columns first
    name: str
    field: str | None = None
    element: int | None = None

    def __call__(self) -> NDArray[Any]:
        with self._open() as data:
            array = np.asarray(data[()])
        return array.T if self.matlab else array

    def parts(self, index: int | None) -> Iterator[NDArray[Any]] | None:
        """Its numbers piece by piece, of a matrix those of column `index`; None where it has to be looked at whole."""
        with self._open() as data:
            shape = tuple(data.shape[::-1] if self.matlab else data.shape)
            if data.dtype.kind not in "fiub":
                return None
        along = [i for i, k in enumerate(shape) if k > 1]
        if index is not None and len(shape) == 2 and shape[0] > 1 and index <= shape[1]:
            return self._slices(shape, 0, index - 1)
        if index is None and len(along) == 1:
            return self._slices(shape, along[0], 0)
        return None

    def _slices(self, shape: tuple[int, ...], axis: int, other: int) -> Iterator[NDArray[Any]]:
        with self._open() as data:
            for part in pieces(shape[axis]):
                at: list[Any] = [part if i == axis else (other if i == 1 else 0) for i in range(len(shape))]
                yield np.ravel(data[tuple(at[::-1] if self.matlab else at)])

    @contextlib.contextmanager
    def _open(self) -> Iterator[Any]:
        import h5py

        try:
            with h5py.File(self.path, "r") as file:
                data: Any = file[self.name]
                if self.element is not None:
                    data = file[np.ravel(data[()])[self.element]]
                yield data if self.field is None else _Field(data, self.field)
        except (OSError, KeyError, RuntimeError, ValueError) as exc:
            raise InputError(f'{self.label}: "{self.name}" cannot be read; the file was cut or damaged. Copy it '
                             'again from the recorder.') from exc


class _Field:
    """One field of a compound dataset, like a dataset."""

    def __init__(self, data: Any, name: str) -> None:
        self.shape, self.dtype = data.shape, data.dtype[name]
        self._read = data.fields(name)

    def __getitem__(self, at: Any) -> Any:
        return self._read[at]


def _hdf5_leaves(path: Path, matlab: bool, label: str) -> dict[str, Loader]:
    """Every dataset of the file, fields of compound tables and of MATLAB's struct arrays one by one."""
    import h5py

    leaves: dict[str, Loader] = {}

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        if item.dtype.names:
            for part in item.dtype.names:
                leaves[f"{name}/{part}"] = _Dataset(path, label, matlab, name, field=part)
        elif h5py.check_ref_dtype(item.dtype) is not None:
            group, _, last = name.rpartition("/")
            for i in range(item.size):
                key = f"{group}({i + 1})/{last}" if group else f"{last}({i + 1})"
                leaves[key] = _Dataset(path, label, matlab, name, element=i)
        else:
            leaves[name] = _Dataset(path, label, matlab, name)

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

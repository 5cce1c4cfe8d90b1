"""Numba's njit whose cache knows what a kernel was compiled from.

Numba keeps compiled code until the file of the function itself changes. What it calls in other files, and constants
from there, are part of that code, so that a version brought up to date would go on computing with the old ones, and
say nothing. Here the code is kept until anything changes that its file imports from its own package, directly or not.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numba
import numpy as np
from numba.core.caching import CacheImpl, CompileResultCacheImpl, FunctionCache
from numpy.typing import ArrayLike, NDArray

_IMPORT = re.compile(r"^\s*from\s+(\.*)([\w.]*)\s+import\s+(\([^)]*\)|[^\n]*)|^\s*import\s+([\w.]+)", re.MULTILINE)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: `numba.njit` with these options; with cache=True see the module."""
    kept = options.pop("cache", False)

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = numba.njit(**options)(function)
        if kept:
            dispatcher._cache = _Cache(function)  # what `enable_caching` does with numba's own
        return dispatcher

    return decorate


def read_only(x: ArrayLike) -> NDArray[np.float64]:
    """A contiguous view of an array of floats, or of a copy, through which nothing can be written.

    Kernels are compiled for each kind of array that they are called with: read-only columns of a recording are another
    one than what was worked out from them. Large kernels take seconds to compile, so they are given one kind.
    """
    view = np.ascontiguousarray(x, dtype=np.float64).view()
    view.flags.writeable = False
    return view


def writeable(x: ArrayLike) -> NDArray[np.float64]:
    """The same array of floats where it is contiguous and may be written to, else a copy: see `read_only`."""
    array = np.ascontiguousarray(x, dtype=np.float64)
    return array if array.flags.writeable else array.copy()


@cache
def sources(path: Path) -> frozenset[Path]:
    """The files of its package that a file is made of: itself and all that it imports, directly or not."""
    found: set[Path] = set()
    waiting = [path.resolve()]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += _imported(one)
    return frozenset(found)


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    """Files of its package that a file names in an import, wherever in it that stands."""
    root = path.parent
    while (root.parent / "__init__.py").exists():
        root = root.parent
    out = []
    for dots, module, names, whole in _IMPORT.findall(path.read_text(encoding="utf-8")):
        if dots:
            folder = path.parents[len(dots) - 1]
            parts = module.split(".") if module else []
        else:
            parts = (module or whole).split(".")
            if parts[0] != root.name:
                continue
            folder, parts = root, parts[1:]
        at = folder.joinpath(*parts)
        out += [at.with_suffix(".py") if parts else at / "__init__.py", at / "__init__.py"]
        out += [at / f"{name}.py" for name in re.findall(r"\w+", names)]
    return tuple(p for p in dict.fromkeys(out) if p.is_file())


@cache
def _digest(path: Path) -> str:
    """Of the contents of all `sources` of a file."""
    out = hashlib.sha256()
    for one in sorted(sources(path)):
        out.update(one.read_bytes())
    return out.hexdigest()


class _WithImports:
    """Makes a place of numba's cache forget what was compiled from other sources."""

    _py_file: str

    def get_source_stamp(self) -> tuple[Any, str]:
        """Numba's own stamp, of the file, and that of what it imports."""
        file = Path(self._py_file)
        return super().get_source_stamp(), _digest(file) if file.is_file() else ""  # type: ignore[misc]


class _Impl(CompileResultCacheImpl):  # type: ignore[misc]
    # the places that numba would take, in its order
    _locator_classes: ClassVar[list[Any]] = [  # type: ignore[misc]
        type(place.__name__, (_WithImports, place), {}) for place in CacheImpl._locator_classes
    ]


class _Cache(FunctionCache):  # type: ignore[misc]
    _impl_class = _Impl

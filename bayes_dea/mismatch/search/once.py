"""What is dear to work out of objects that have no value to compare by, remembered by which objects they are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Once(Generic[T]):
    """Results by the identity of the objects that they are of, which stay with them: no other one takes their place."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, ...], tuple[tuple[object, ...], T]] = {}

    def __call__(self, of: tuple[object, ...], work: Callable[[], T]) -> T:
        """What `work` gives, called the first time that it is asked for these objects."""
        key = tuple(map(id, of))
        if key not in self._known:
            self._known[key] = of, work()
        return self._known[key][1]

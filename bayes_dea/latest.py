"""The last few results of a piece of work that is asked for again and again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Results by what they were worked out from: a key, and an object beside it that counts by identity."""

    def __init__(self, kept: int = 2) -> None:
        """kept: how many are."""
        self._kept = kept
        self._known: tuple[tuple[object, object, T], ...] = ()

    def __call__(self, key: object, beside: object, work: Callable[[], T]) -> T:
        """What `work` gives, called where it is not among the last ones; not to be written to."""
        known = self._known  # as a whole: another thread may put its own in its place
        for at, (k, b, found) in enumerate(known):
            if b is beside and k == key:
                if at > 0:
                    self._known = (known[at], *known[:at], *known[at + 1 :])
                return found
        found = work()
        self._known = ((key, beside, found), *known[: self._kept - 1])
        return found

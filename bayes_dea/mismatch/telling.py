"""How far a phase of a diagnosis is: what long work is given to say it."""

from __future__ import annotations

from collections.abc import Callable

#: called with (done, of, text)
Tell = Callable[[float, float, str], None]


def silence(_done: float, _of: float, _text: str) -> None:
    """Nobody listens."""

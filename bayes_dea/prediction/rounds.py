"""A command that is corrected round by round: by what the mean of all draws, simulated whole, misses of the wish."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .inverse import ABOVE, FAST, MET, NEGATIVE, Inverted

Array = NDArray[np.float64]
#: why a row is not what was asked for, beside those of `inverse`: the rounds did not bring it there
LEFT = 1 + max(MET, ABOVE, NEGATIVE, FAST)
#: a round that is worse than the best one by more than this does not take its place
_WORSE = 1.001


def in_rounds(
    find: Callable[[Array, Callable[[float], None]], Inverted],
    answer: Callable[[Inverted, Callable[[float], None]], Array],
    wish: Array,
    enough: float,
    rounds: int,
    tell: Callable[[float, float], None],
) -> tuple[Inverted, Array]:
    """The command of the best round, and what it misses (n,) where it is not forbidden.

    find: the command for a goal (n,), by a part of the model; answer: what the whole model does with it (n,). Both are
    told whom to tell the share that is done. enough: a miss that needs no further round. Where limits forbid what the
    goal needs it stays at the wish: what no voltage does would pile up.
    """
    goal = wish.copy()
    best, least = None, np.inf
    for number in range(rounds):

        def finding(share: float, before: float = number) -> None:
            tell(before + 0.5 * share, rounds)

        def answering(share: float, before: float = number + 0.5) -> None:
            tell(before + 0.5 * share, rounds)

        found = find(goal, finding)
        off = wish - answer(found, answering)
        miss = np.where(found.flag == MET, off, 0.0)
        size = float(np.sqrt(np.mean(off**2)))
        if best is None or size <= _WORSE * least:
            best, least = (found, miss), min(size, least)
        if np.max(np.abs(miss)) < enough or not np.isfinite(size):
            break
        goal = np.where(found.flag == MET, goal + miss, wish)
    assert best is not None
    return best

"""What drives the chain from node to node: lengths of steps, and the command in each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..latest import Latest

Array = NDArray[np.float64]
#: a step is cut into pieces of at most so many volts: the stress is the square of the voltage, and is taken as straight
_RAMP_V = 100.0


@dataclass(frozen=True)
class Steps:
    """Steps of h (m,) s, the voltage straight from u0 to u1 (m,) V in each.

    rows (m,): of the recording that each spans. at (k,): the steps at whose ends strains are asked for; None for all.
    """

    h: Array
    u0: Array
    u1: Array
    rows: NDArray[np.int64]
    at: NDArray[np.int64] | None = None

    @cached_property
    def supplied(self) -> Latest[Steps]:
        """What supplies with limits made of them last, by their numbers: no material changes any of it."""
        return Latest()

    @property
    def in_pieces(self) -> Steps:
        """The same, with those in which the voltage goes far in pieces."""
        return self._cut or self

    @cached_property
    def _cut(self) -> Steps | None:
        """What `in_pieces` gives where something is cut. None where nothing is: a reference to itself would keep it."""
        far = np.abs(self.u1 - self.u0)
        if not far.max(initial=0.0) > _RAMP_V:  # nan has no answer, and needs none
            return None
        n = np.maximum(np.ceil(far / _RAMP_V), 1.0).astype(np.int64)
        last = np.cumsum(n) - 1
        before = np.arange(n.sum()) - np.repeat(last - n + 1, n)
        h, start, rise = (np.repeat(x / n, n) for x in (self.h, self.u0 * n, self.u1 - self.u0))
        at = last if self.at is None else last[self.at]
        return Steps(h, start + rise * before, start + rise * (before + 1), np.ones_like(before), at)

    def asked(self, y: NDArray[Any]) -> NDArray[Any]:
        """Of what is known at the end of every step (m,), what is asked for."""
        return y if self.at is None else y[self.at]

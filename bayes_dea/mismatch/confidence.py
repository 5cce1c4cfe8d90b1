"""Raw probability to confidence: a monotone map learned on the virtual bench, kept with its provenance."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache

import numpy as np

from ..priors import prior_folder
from .search.hypotheses import NONE

FILE = "confidence.toml"
#: most that is given to one of several explanations that act: what splits them is a few nats, and equations that are a
#: little off, or on no list, are worth as much
_SHARED = 0.8


@cache
def _map() -> tuple[tuple[float, ...], tuple[float, ...]]:
    path = prior_folder() / "diagnosis" / FILE
    if not path.is_file():
        return (0.0, 1.0), (0.0, 1.0)
    with path.open("rb") as file:
        table = tomllib.load(file)
    return tuple(map(float, table["raw"])), tuple(map(float, table["confidence"]))


def confidence_of(raw: float, members: Sequence[str]) -> float:
    """Confidence of a verdict from its raw probability and the explanations that cannot be told apart.

    Where there is more than one of these, it is never above the probability itself (CONTRACT 4), and where the
    verdict, the first of them, and another say that something acts, never above 0.8: only the set is claimed.
    """
    x, y = _map()
    confidence = float(np.clip(np.interp(raw, x, y), 0.0, 1.0))
    if len(members) > 1:
        confidence = min(confidence, raw)
    acting = [m for m in members if m != NONE]
    return min(confidence, _SHARED) if len(acting) > 1 and members[0] != NONE else confidence

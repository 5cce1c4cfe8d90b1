"""Raw probability to confidence: a monotone map learned on the virtual bench, kept with its provenance."""

from __future__ import annotations

import tomllib
from functools import cache

import numpy as np

from ..priors import prior_folder

FILE = "confidence.toml"


@cache
def _map() -> tuple[tuple[float, ...], tuple[float, ...]]:
    path = prior_folder() / "diagnosis" / FILE
    if not path.is_file():
        return (0.0, 1.0), (0.0, 1.0)
    with path.open("rb") as file:
        table = tomllib.load(file)
    return tuple(map(float, table["raw"])), tuple(map(float, table["confidence"]))


def calibrated(raw: float) -> float:
    """Confidence of a verdict from its raw probability."""
    x, y = _map()
    return float(np.clip(np.interp(raw, x, y), 0.0, 1.0))

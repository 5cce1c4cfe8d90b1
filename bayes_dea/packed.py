"""Columns of numbers in few bytes, for files and pages: steps of a stated size, differences, bytes by rank, deflate.

A column becomes whole multiples of its step above its smallest value (0 stands for "no value"), or the differences of
neighbours where those are smaller. The lowest bytes of all numbers come first, then the next ones, so that deflate
sees what repeats. A page decodes it with what every browser has (`DecompressionStream`).
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_MOST_BYTES = 6  # 2^48 steps: more than any clock of a bench counts, and exact in a double


@dataclass(frozen=True)
class Packed:
    """`columns`: name, n, offset, step, bytes, delta of each column, in the order in which they lie in `data`."""

    columns: tuple[Mapping[str, Any], ...]
    data: bytes = field(repr=False)


def pack(columns: Mapping[str, tuple[ArrayLike, float]], level: int = 6) -> Packed:
    """Pack {name: (values (n,), step)}; values that are not finite come back as NaN, others to half a step.

    Raises ValueError for a step that is not positive or a column that spans more than 2^47 steps.
    """
    described, pieces = [], []
    for name, (values, step) in columns.items():
        x = np.asarray(values, dtype=np.float64)
        if not (step > 0 and np.isfinite(step)):
            raise ValueError(f"column {name}: a step must be positive, got {step}")
        good = np.isfinite(x)
        offset = float(x[good].min()) if good.any() else 0.0
        steps = np.rint((x - offset) / step)
        if good.any() and steps[good].max() >= 2.0 ** (8 * _MOST_BYTES - 1):
            raise ValueError(f"column {name}: spans more than 2^47 steps of {step}")
        q = np.where(good, steps + 1, 0).astype(np.int64)
        d = np.diff(q, prepend=0)
        zigzag = np.where(d >= 0, 2 * d, -2 * d - 1)
        # noise is smaller as it is, a smooth curve as its differences
        delta = bool(q.size and np.log1p(zigzag).sum() < np.log1p(np.abs(q - np.median(q))).sum())
        u = zigzag if delta else q
        width = max(1, -(-int(u.max()).bit_length() // 8)) if u.size else 1
        rows = np.ascontiguousarray(u.astype("<u8")).view(np.uint8).reshape(-1, 8)
        pieces.append(np.ascontiguousarray(rows[:, :width].T).tobytes())
        described.append(
            {"name": name, "n": int(x.size), "offset": offset, "step": float(step), "bytes": width, "delta": delta}
        )
    return Packed(tuple(described), zlib.compress(b"".join(pieces), level))


def unpack(packed: Packed) -> dict[str, Array]:
    """The columns again, (n,) each. Raises ValueError when the bytes are not those of these columns."""
    try:
        raw = np.frombuffer(zlib.decompress(packed.data), np.uint8)
    except zlib.error as error:
        raise ValueError(f"packed columns are damaged: {error}") from error
    if raw.size != sum(int(c["n"]) * int(c["bytes"]) for c in packed.columns):
        raise ValueError("packed columns are damaged: their length is not the one described")
    out, at = {}, 0
    for c in packed.columns:
        n, width = int(c["n"]), int(c["bytes"])
        u = np.zeros(n, np.int64)
        for k in range(width):
            u |= raw[at : at + n].astype(np.int64) << (8 * k)
            at += n
        q = np.cumsum((u >> 1) ^ -(u & 1)) if c["delta"] else u
        out[str(c["name"])] = np.where(q > 0, float(c["offset"]) + (q - 1) * float(c["step"]), np.nan)
    return out

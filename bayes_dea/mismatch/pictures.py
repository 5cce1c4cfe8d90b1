"""Numbers behind the pictures of a diagnosis: residuals before and after, and maps of the excess."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .diagnosis import Diagnosis
from .where.features import HARMONICS, SINCE_EDGE
from .where.locate import residuals

Array = NDArray[np.float64]
_MOST_POINTS = 4000
_LEVELS = 6


def picture_data(result: Diagnosis) -> dict[str, NDArray[Any]]:
    """Arrays by name, for diagnosis.npz; arrays of recording i end in _i."""
    before, after = residuals(result.base), residuals(result.corrected)
    pieces, looks = result.base.problem.pieces, result.looks
    out: dict[str, NDArray[Any]] = {
        "names": np.array([p.name for p in pieces]),
        "force": np.array([p.channel == "force" for p in pieces]),
    }
    for i, (piece, f) in enumerate(zip(pieces, looks, strict=True)):
        drawn = _Drawn(f.time_s.size, piece.blocks.behind_missing())
        out[f"time_{i}"] = drawn(f.time_s)
        out[f"input_{i}"] = drawn(f.level * (1e3 if piece.channel == "force" else 1.0))
        out[f"before_{i}"] = drawn.line(before.raw[i])
        out[f"after_{i}"] = drawn.line(after.raw[i])
    out.update(_edge_map(result, before.raw))
    out.update(_harmonics(result, before.raw))
    if result.proof:
        worst = max(result.proof, key=lambda h: (h.answered, h.rmse_before / h.noise, h.recording))
        drawn = _Drawn(worst.time_s.size, worst.behind_missing)
        out["worst_name"] = np.array(worst.recording)
        out["worst_force"] = np.array(worst.channel == "force")
        out["worst_time"] = drawn(worst.time_s)
        out["worst_before"] = drawn.line(worst.before)
        out["worst_after"] = drawn.line(worst.after)
    return out


class _Drawn:
    """What is drawn of n blocks: as many as a picture shows, and no line over readings that are missing for long."""

    def __init__(self, n: int, behind_missing: NDArray[np.int64]) -> None:
        keep = np.linspace(0, n - 1, min(n, _MOST_POINTS)).astype(np.int64)
        # the blocks on either side of what is missing stay, with nothing between them
        self._keep = np.union1d(keep, np.concatenate([behind_missing - 1, behind_missing]))
        self._at = np.searchsorted(self._keep, behind_missing)

    def __call__(self, x: Array) -> NDArray[np.float32]:
        """x (n,) of those, the value before it where nothing is."""
        kept = x[self._keep]
        return np.insert(kept, self._at, kept[self._at - 1]).astype(np.float32)

    def line(self, y: Array) -> NDArray[np.float32]:
        """The same, nan where nothing is."""
        return np.insert(y[self._keep], self._at, np.nan).astype(np.float32)


def _edge_map(result: Diagnosis, raw: list[Array]) -> dict[str, Array]:
    voltage = [i for i, p in enumerate(result.base.problem.pieces) if p.channel == "displacement"]
    top = max((float(np.max(result.looks[i].level)) for i in voltage), default=0.0) or 1.0
    levels = np.linspace(0.0, top, _LEVELS + 1)
    borders = np.concatenate([SINCE_EDGE[:-1], [300.0]])
    total = np.zeros((2, _LEVELS, SINCE_EDGE.size - 1))
    count = np.zeros_like(total)
    for i in voltage:
        f, weight = result.looks[i], result.base.problem.pieces[i].blocks.count
        for side, sign in enumerate((1, -1)):
            own = np.flatnonzero((np.sign(f.jump) == sign) & np.isfinite(f.since_edge_s))
            row = np.clip((f.level[own] / top * _LEVELS).astype(int), 0, _LEVELS - 1)
            column = np.clip(np.searchsorted(SINCE_EDGE, f.since_edge_s[own], side="right") - 1, 0, SINCE_EDGE.size - 2)
            np.add.at(total[side], (row, column), weight[own] * raw[i][own])
            np.add.at(count[side], (row, column), weight[own])
    return {
        "edge_map": np.where(count > 0, total / np.maximum(count, 1), np.nan),
        "edge_levels": levels,
        "edge_since": borders,
    }


def _harmonics(result: Diagnosis, raw: list[Array]) -> dict[str, Array]:
    rows, names, frequencies = [], [], []
    for i, (piece, f) in enumerate(zip(result.base.problem.pieces, result.looks, strict=True)):
        inside = np.isfinite(f.phase)
        if f.frequency_Hz <= 0 or piece.channel != "displacement":
            continue
        w = piece.blocks.count[inside].astype(float)
        w /= w.sum()
        turn = 2 * np.pi * f.phase[inside]
        rows.append([2 * abs(np.sum(w * raw[i][inside] * np.exp(-1j * k * turn))) for k in range(1, HARMONICS + 1)])
        names.append(piece.name)
        frequencies.append(f.frequency_Hz)
    order = [int(k) for k in np.argsort(frequencies)]
    return {
        "harmonics": np.array([rows[k] for k in order]),
        "wave_names": np.array([names[k] for k in order]),
        "frequencies": np.array([frequencies[k] for k in order]),
    }

"""Numbers behind the pictures of a diagnosis: residuals before and after, and maps of the excess."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .diagnosis import Diagnosis
from .where.features import HARMONICS, SINCE_EDGE
from .where.locate import residuals

Array = NDArray[np.float64]
_MOST_POINTS = 4000
_LEVELS = 6


def picture_data(result: Diagnosis) -> dict[str, Array]:
    """Arrays by name, for diagnosis.npz; arrays of recording i end in _i."""
    before, after = residuals(result.base), residuals(result.corrected)
    pieces, looks = result.base.problem.pieces, result.looks
    out: dict[str, Array] = {
        "names": np.array([p.name for p in pieces]),
        "force": np.array([p.channel == "force" for p in pieces]),
    }
    for i, (piece, f) in enumerate(zip(pieces, looks, strict=True)):
        keep = np.unique(np.linspace(0, piece.blocks.n - 1, min(piece.blocks.n, _MOST_POINTS)).astype(int))
        out[f"time_{i}"] = f.time_s[keep].astype(np.float32)
        out[f"input_{i}"] = (f.level[keep] * (1e3 if piece.channel == "force" else 1.0)).astype(np.float32)
        out[f"before_{i}"] = before.raw[i][keep].astype(np.float32)
        out[f"after_{i}"] = after.raw[i][keep].astype(np.float32)
    out.update(_edge_map(result, before.raw))
    out.update(_harmonics(result, before.raw))
    if result.proof:
        worst = max(result.proof, key=lambda h: (h.answered, h.rmse_before / h.noise, h.recording))
        keep = np.unique(np.linspace(0, worst.time_s.size - 1, min(worst.time_s.size, _MOST_POINTS)).astype(int))
        out["worst_name"] = np.array(worst.recording)
        out["worst_force"] = np.array(worst.channel == "force")
        out["worst_time"] = worst.time_s[keep].astype(np.float32)
        out["worst_before"] = worst.before[keep].astype(np.float32)
        out["worst_after"] = worst.after[keep].astype(np.float32)
    return out


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

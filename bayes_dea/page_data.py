"""What a page needs of a recording to be zoomed into: every sample near the edges of its input, and for all of it the
minimum, mean and maximum of short bins, from which a browser makes the coarser levels.

One recording of 720 s at 1 kHz becomes some 100 kB.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .campaign.order import differences, median
from .campaign.scratch import BLOCK, pieces
from .noise.edges import find_edges
from .noise.kinks import find_kinks
from .packed import Packed, pack

Array = NDArray[np.float64]
_ALL_SAMPLES, _ALL_BINS = 900_000, 270_000  # of a whole campaign: what a page of 8 MB can carry


@dataclass(frozen=True)
class PageSettings:
    """reach_s: every sample within this time of an edge is kept. samples: but at most so many; bins: at most."""

    reach_s: float = 2.0
    samples: int = 60_000
    bins: int = 22_500

    @classmethod
    def shared(cls, recordings: int) -> PageSettings:
        """Settings for one of so many recordings on a page."""
        n = max(recordings, 1)
        samples, bins = min(cls.samples, _ALL_SAMPLES // n), min(cls.bins, _ALL_BINS // n)
        return cls(samples=max(4_000, samples), bins=max(1_500, bins))


@dataclass(frozen=True)
class PageData:
    """One recording, reduced.

    packed: columns of the samples kept (`s_*`: t, y, p, sd, u) and of the bins (`b_*`: t0, t1, n, kept, y/r/p/u with
    _min, _mean, _max, sd); y measured, p predicted, r = y - p, u input, all SI. The rows of a bin with kept = 1 are all
    among the samples. edges_s: times of the edges. reach_s: every sample within it of an edge is kept (None: every
    sample there is). rows_per_bin, step_s: median step of time.
    """

    packed: Packed = field(repr=False)
    edges_s: tuple[float, ...]
    reach_s: float | None
    rows_per_bin: int
    step_s: float

    def to_bytes(self) -> bytes:
        """One piece of bytes: the length of a JSON header (4 bytes, little endian), the header, the packed columns."""
        header = {
            "columns": [dict(c) for c in self.packed.columns],
            "edges_s": [float(f"{t:.9g}") for t in self.edges_s],
            "reach_s": self.reach_s,
            "rows_per_bin": self.rows_per_bin,
            "step_s": self.step_s,
        }
        text = json.dumps(header, separators=(",", ":")).encode()
        return len(text).to_bytes(4, "little") + text + self.packed.data

    @classmethod
    def from_bytes(cls, content: bytes) -> PageData:
        """Back from `to_bytes`. Raises ValueError when the bytes are none of its."""
        end = 4 + int.from_bytes(content[:4], "little")
        try:
            h = json.loads(content[4:end])
            packed = Packed(tuple(h["columns"]), content[end:])
            reach = None if h["reach_s"] is None else float(h["reach_s"])
            return cls(packed, tuple(h["edges_s"]), reach, int(h["rows_per_bin"]), float(h["step_s"]))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"the samples kept for the page are damaged: {error!r}") from error


def reduce_recording(
    time_s: ArrayLike,
    u: ArrayLike,
    y: ArrayLike,
    mean: ArrayLike,
    sd: ArrayLike,
    noise_sd: float,
    resolution: float | None = None,
    settings: PageSettings | None = None,
) -> PageData:
    """Reduce a recording (n,): input u, measured y (NaN where not observed), prediction with the sd of a sample.

    noise_sd and resolution (quantisation step of y) say how fine the numbers have to be kept.
    """
    s = settings or PageSettings()
    t, u, y, mean, sd = (np.asarray(v, dtype=np.float64) for v in (time_s, u, y, mean, sd))
    n = t.size
    step = median(differences(t)) if n > 1 else 1.0
    rows = max(1, -(-n // s.bins))
    edges = _edges(u)
    start = np.arange(0, n, rows)
    kept, reach = (np.ones(start.size, dtype=bool), None) if n <= s.samples else _near(t, edges, s, step, rows)
    keep = (start[kept, None] + np.arange(rows)).ravel()
    keep = keep[keep < n]
    fine = _step_of(y, noise_sd, resolution)
    smooth, tick = noise_sd / 64 if noise_sd > 0 else fine, step / 1000
    drive = max(float(np.nanmax(u) - np.nanmin(u)) if n else 0.0, 1e-9) / 20_000
    columns: dict[str, tuple[Array, float]] = {
        "s_t": (t[keep], tick),
        "s_y": (y[keep], fine),
        "s_p": (mean[keep], smooth),
        "s_sd": (sd[keep], smooth),
        "s_u": (u[keep], drive),
        "b_t0": (t[start], tick),
        "b_t1": (t[np.append(start[1:], n) - 1], tick),
        "b_n": (np.zeros(start.size), 1.0),
        "b_kept": (kept.astype(np.float64), 1.0),
    }
    units = {"y": fine, "r": smooth, "p": smooth, "u": drive}
    for name, unit in units.items():
        for what in ("min", "mean", "max"):
            columns[f"b_{name}_{what}"] = (np.empty(start.size), unit)
    columns["b_sd"] = (np.empty(start.size), smooth)
    # pieces of whole bins
    for some in pieces(start.size, max(1, BLOCK // rows)):
        part = slice(some.start * rows, min(some.stop * rows, n))
        first = start[some] - part.start
        r = y[part] - mean[part]
        columns["b_n"][0][some] = np.add.reduceat(np.isfinite(r).astype(np.float64), first)
        for name, values in (("y", y[part]), ("r", r), ("p", mean[part]), ("u", u[part])):
            for what, of in _bins(values, first).items():
                columns[f"b_{name}_{what}"][0][some] = of
        columns["b_sd"][0][some] = _bins(sd[part], first)["mean"]
    return PageData(pack(columns), tuple(float(t[i]) for i in edges), reach, rows, step)


def _edges(u: Array) -> NDArray[np.int64]:
    """Rows at which the input jumps or bends; of a run of neighbours the first."""
    at = np.union1d(find_edges(u), find_kinks(u))
    return at[np.diff(at, prepend=-1_000) > 12] if at.size else at


def _near(
    t: Array, edges: NDArray[np.int64], s: PageSettings, step: float, rows: int
) -> tuple[NDArray[np.bool_], float | None]:
    """Bins (nb,) with a row within the reach of an edge, and that reach, shortened until they are few enough."""
    times = t[edges]
    reach = s.reach_s
    bins = -(-t.size // rows)
    if not times.size:
        return np.zeros(bins, dtype=bool), reach
    while True:
        first = np.searchsorted(t, times - reach - 1e-9 * step)
        last = np.searchsorted(t, times + reach + 1e-9 * step, side="right")
        change = np.zeros(bins + 1, dtype=np.int64)
        np.add.at(change, first // rows, 1)
        np.add.at(change, (last - 1) // rows + 1, -1)
        near = np.cumsum(change[:-1]) > 0
        if int(near.sum()) * rows <= s.samples or reach < 5 * step:  # whole ones are kept
            return near, reach
        reach *= 0.7


def _bins(x: Array, start: NDArray[np.int64]) -> dict[str, Array]:
    """Minimum, mean and maximum of what is finite in each bin; NaN where nothing is."""
    good = np.isfinite(x)
    count = np.add.reduceat(good.astype(np.float64), start)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(np.where(good, x, 0.0), start) / count
    return {"min": np.fmin.reduceat(x, start), "mean": mean, "max": np.fmax.reduceat(x, start)}


def _step_of(y: Array, noise_sd: float, resolution: float | None) -> float:
    """Step in which the readings are kept: their own where they are quantised as stated, else finer than the noise."""
    good = np.empty(0)
    for part in pieces(y.size, BLOCK):
        good = np.append(good, y[part][np.isfinite(y[part])])[:20_000]
        if good.size == 20_000:
            break
    if resolution and good.size:
        steps = (good - good.min()) / resolution
        if np.abs(steps - np.rint(steps)).max() < 0.01:
            return float(resolution)
    if noise_sd > 0:
        return noise_sd / 64
    return max(float(np.ptp(good)) if good.size else 0.0, 1e-12) / 30_000

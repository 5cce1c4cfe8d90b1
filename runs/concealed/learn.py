"""The map from raw probability to confidence, learned on campaigns that no score is quoted from.

    python runs/concealed/learn.py STUDY [STUDY ...] --out priors/diagnosis/confidence.toml --keep teaching.jsonl.gz

STUDY: a folder of study.py, or packed rows that --keep left.
confidence = (1 - lapse) * sigmoid(a + b * logit(raw)), b > 0: rising, with three numbers to learn, so that a few
hundred campaigns are enough. The lapse says that a verdict may be wrong whatever its evidence. Weak priors of a (0 +-
1) and log b (0 +- 0.5) keep a small study from claiming what it has not seen. That of the lapse (4 %, a factor of 1.6
either way) is stronger: what was wrong on these seeds has been looked at and mended, so that they show fewer lapses
than seeds that nobody has seen, and the benches of others are not this one.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from kept import packed
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit
from scores import Row, brier, finished, hit, read_rows

from bayes_dea import __version__
from bayes_dea.results import write_bytes, write_text

#: raw probabilities are not told apart beyond this
_EDGE = 1e-6
GRID = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99, 0.995, 0.999,
        0.9999, 0.99999, 0.999999, 1.0)
Array = NDArray[np.float64]


def mapped(raw: Array, theta: Array) -> Array:
    """Confidence of raw probabilities; theta: a, log b, logit of the lapse."""
    x = logit(np.clip(raw, _EDGE, 1.0 - _EDGE))
    return np.asarray((1.0 - expit(theta[2])) * expit(theta[0] + np.exp(theta[1]) * x))


def learn(rows: Sequence[Row]) -> Array:
    """Three numbers of the map, most probable after the rows."""
    raw = np.array([r["raw"] for r in rows], float)
    right = np.array([hit(r) for r in rows], bool)
    center = np.array([0.0, 0.0, logit(0.04)])
    width = np.array([1.0, 0.5, 0.5])

    def cost(theta: Array) -> float:
        c = np.clip(mapped(raw, theta), 1e-12, 1.0 - 1e-12)
        return float(-np.sum(np.log(np.where(right, c, 1.0 - c))) + 0.5 * np.sum(((theta - center) / width) ** 2))

    return np.asarray(minimize(cost, center, method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9}).x)


def table(rows: Sequence[Row], theta: Array, studies: Sequence[str]) -> str:
    """The file of the map, with where it comes from."""
    seeds = sorted(r["seed"] for r in rows)
    values: list[Any] = [round(float(v), 5) for v in mapped(np.array(GRID), theta)]
    right = sum(hit(r) for r in rows)
    return (
        "# Confidence of a verdict from its raw probability: learned, monotone, linear between the points.\n"
        f"# From {len(rows)} campaigns of the virtual bench, {right} verdicts right, seeds {seeds[0]} to {seeds[-1]}"
        f" ({', '.join(studies)}),\n"
        f"# bayes-dea {__version__}, {datetime.now(UTC):%Y-%m-%d}; made by runs/concealed/learn.py.\n"
        f"# (1 - lapse) sigmoid(a + b logit(raw)): a = {theta[0]:.3f}, b = {np.exp(theta[1]):.3f}, "
        f"lapse = {expit(theta[2]):.4f}.\n"
        f"raw = {list(GRID)}\nconfidence = {values}\n"
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", type=Path, nargs="+", help="folders with rows.jsonl, packed rows")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--keep", type=Path, help="file for the rows, packed; a later map may have them, too")
    a = parser.parse_args()
    found = {r["seed"]: r for p in a.study for r in read_rows(p / "rows.jsonl" if p.is_dir() else p)}
    rows = finished([found[s] for s in sorted(found)])
    if len(rows) < 50:
        parser.error(f"{len(rows)} finished campaigns; a map needs at least 50")
    if max(r["seed"] for r in rows) >= 1_000_000:
        parser.error("seeds from 1,000,000 on are for scores; a map must not have seen them")
    theta = learn(rows)
    write_text(a.out, table(rows, theta, [folder.name for folder in a.study]))
    if a.keep is not None:
        write_bytes(a.keep, packed(rows))
    after = [r | {"mapped": float(mapped(np.array([r["raw"]]), theta)[0])} for r in rows]
    print(f"{len(rows)} campaigns; Brier {brier(rows, 'raw'):.4f} raw, {brier(after, 'mapped'):.4f} after, same rows")


if __name__ == "__main__":
    main()

"""What the rows of a study say: hits, confidence, power, false alarms, coverage, seconds. Numbers only."""

from __future__ import annotations

import gzip
import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

Row = dict[str, Any]
#: edges of the bins of the reliability diagram
BINS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0 + 1e-12)
#: edges of sizes, in resolution steps
STEPS = (1.0, 2.0, 5.0, 12.0, 30.0, 80.0, 1e9)
#: nats by which the truth has to lead every rival to be called something that the recordings can name
NAMEABLE_NATS = 340.0
#: nats of lead below which the best equations of another effect are as good (odds of a hundred): only a set can be said
ALIKE_NATS = 4.6
#: seconds of one core that a diagnosis may take
MOST_S = 60.0


@dataclass(frozen=True)
class Rate:
    """`hits` of `n`, with the exact (Clopper-Pearson) 95 % interval."""

    hits: int
    n: int

    @property
    def rate(self) -> float | None:
        """Share, None of nothing."""
        return self.hits / self.n if self.n else None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share."""
        low = float(beta.ppf(0.025, self.hits, self.n - self.hits + 1)) if self.hits else 0.0
        high = float(beta.ppf(0.975, self.hits + 1, self.n - self.hits)) if self.hits < self.n else 1.0
        return low, high

    def json(self) -> dict[str, Any]:
        """Plain types."""
        return {"hits": self.hits, "n": self.n, "rate": self.rate, "interval_95": list(self.interval)}


def read_rows(file: Path) -> list[Row]:
    """Rows by seed, of a rows.jsonl or a packed one; the last line may be cut off by an interruption."""
    text = ""
    if file.is_file():
        text = gzip.decompress(file.read_bytes()).decode() if file.suffix == ".gz" else file.read_text(encoding="utf-8")
    rows: dict[int, Row] = {}
    for line in text.splitlines():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[int(row["seed"])] = row
    return [rows[s] for s in sorted(rows)]


def finished(rows: Iterable[Row]) -> list[Row]:
    """Rows with a verdict."""
    return [r for r in rows if "verdict" in r]


def hit(row: Row) -> bool:
    """The verdict is right: names of a pair in any order."""
    return _same(row["verdict"], row["truth"])


def in_set(row: Row) -> bool:
    """The truth is in the set that cannot be told apart."""
    return any(_same(m, row["truth"]) for m in row["set"])


def _same(names: str, others: str) -> bool:
    return set(names.split("+")) == set(others.split("+"))


def group(row: Row) -> str:
    """none, single, pair or unknown: what is true of a campaign."""
    if row["truth"] in ("none", "unknown"):
        return str(row["truth"])
    return "pair" if "+" in row["truth"] else "single"


def rate(rows: Sequence[Row], what: Callable[[Row], bool]) -> Rate:
    """How many rows are so."""
    return Rate(sum(bool(what(r)) for r in rows), len(rows))


def nats(row: Row) -> float:
    """By how much what was concealed changes the recordings, after the refit of everything else."""
    return float(row["sizes"].get("all", {}).get("nats", 0.0))


def nameable(row: Row) -> bool:
    """The true equations explain the recordings better than every rival by so much that they can name the effect.

    Rows of studies without that figure: by how much it changes them, which counts pairs that nothing tells apart, too.
    """
    lead = row.get("lead")
    return bool((nats(row) if lead is None else lead) >= NAMEABLE_NATS)


def _as_well(row: Row) -> bool:
    """A rival explains the recordings as well. A sensor's limit is read off the readings, whatever explains them."""
    lead = row.get("lead")
    return lead is not None and lead < ALIKE_NATS and "sensor_clipping" not in row["truth"].split("+")


def claimable(row: Row) -> list[str]:
    """What may be claimed of a truth: all of it, or, where one of several effects is below a step beside the others,
    what is left without that one (CONTRACT 1). Where each of two is, they are one and the same, and either may be."""
    small = [e for e, size in row.get("beside", {}).items() if size < 1.0]
    names = row["truth"].split("+")
    return ["+".join(n for n in names if n != e) for e in small] or [row["truth"]]


def _hidden(row: Row) -> bool:
    """One of several effects is less than the sensor resolves beside the others."""
    return claimable(row) != [row["truth"]]


def steps(row: Row) -> float:
    """Its size in resolution steps, on the recording most affected."""
    return float(row["sizes"].get("all", {}).get("steps", 0.0))


def brier(rows: Sequence[Row], key: str = "confidence") -> float | None:
    """Mean squared distance of confidence from what was right."""
    return float(np.mean([(r[key] - hit(r)) ** 2 for r in rows])) if rows else None


def reliability(rows: Sequence[Row], key: str = "confidence") -> list[dict[str, Any]]:
    """Mean confidence and hit rate by bin of confidence."""
    out = []
    for low, high in pairwise(BINS):
        inside = [r for r in rows if low <= r[key] < high]
        if inside:
            out.append({"low": low, "high": min(high, 1.0), "mean": float(np.mean([r[key] for r in inside])),
                        **rate(inside, hit).json()})
    return out


def power(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Detection, naming and set by size: of single effects."""
    out = []
    for low, high in pairwise(STEPS):
        inside = [r for r in rows if group(r) == "single" and low <= steps(r) < high]
        if inside:
            out.append({
                "low": low, "high": high if high < 1e8 else None, "detected": rate(inside, _detected).json(),
                "named": rate(inside, hit).json(), "in_set": rate(inside, in_set).json(),
            })
    return out


def _detected(row: Row) -> bool:
    return bool(row["verdict"] != "none")


def confusion(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """How often each truth was given which verdict."""
    table: dict[str, Counter[str]] = {}
    for r in rows:
        table.setdefault(_sorted(r["truth"]), Counter())[_sorted(r["verdict"])] += 1
    return [{"truth": t, "verdicts": dict(c.most_common())} for t, c in sorted(table.items())]


def _sorted(names: str) -> str:
    return "+".join(sorted(names.split("+")))


def coverage(rows: Sequence[Row]) -> dict[str, Any]:
    """Whether the 90 % interval of each parameter of a rightly named effect holds the true value."""
    inside: dict[str, list[bool]] = {}
    for r in rows:
        if group(r) not in ("single", "pair") or not hit(r):
            continue
        found = next((h["parameters"] for h in r["hypotheses"] if h["name"] == r["verdict"]), {})
        for true in r["effects"].values():
            for name, value in true.items():
                f = found.get(name)
                if f and value is not None and f["q05"] is not None and f["q95"] is not None:
                    inside.setdefault(name, []).append(bool(f["q05"] <= value <= f["q95"]))
    every = [x for v in inside.values() for x in v]
    return {
        "all": Rate(sum(every), len(every)).json(),
        "by_parameter": {k: Rate(sum(v), len(v)).json() for k, v in sorted(inside.items())},
    }


def _repaired(row: Row) -> bool:
    p = row["proof"]
    return bool(p["rmse_after_m"] <= 1.05 * p["noise_m"])


def _spread(values: list[float]) -> dict[str, float]:
    """Median, 95 % quantile and the largest; nothing of none."""
    if not values:
        return {}
    return {"median": float(np.median(values)), "q95": float(np.quantile(values, 0.95)), "max": max(values)}


def scores(rows: Sequence[Row]) -> dict[str, Any]:
    """Everything that the page shows."""
    done = finished(rows)
    by = {g: [r for r in done if group(r) == g] for g in ("none", "single", "pair", "unknown")}
    acting = by["single"] + by["pair"]
    strong = [r for r in acting if nameable(r)]
    # something is seen, but a rival explains it as well, or nearly; and what lies between
    weaker = [r for r in acting if not nameable(r) and _detected(r)]
    alike = [r for r in weaker if _as_well(r)]
    hidden, seen = ([r for r in alike if _hidden(r) is below] for below in (True, False))
    between = [r for r in weaker if not _as_well(r)]
    named = [r for r in acting if hit(r) and r["proof"].get("rmse_after_m") is not None]
    judged = strong + by["none"] + by["unknown"]
    timed = [r for r in done if "processor_s" in r]
    return {
        "campaigns": len(rows), "failed": len(rows) - len(done), "seeds": [r["seed"] for r in rows],
        "codes": dict(Counter(str(r.get("code")) for r in rows)),
        "groups": {g: {"n": len(v), "right": rate(v, hit).json(), "in_set": rate(v, in_set).json()}
                   for g, v in by.items()},
        "nameable": {"nats": NAMEABLE_NATS, "right": rate(strong, hit).json(), "in_set": rate(strong, in_set).json(),
                     "largest_set": max((len(r["set"]) for r in strong), default=0)},
        "alike": {"in_set": rate(alike, in_set).json(), "largest_set": max((len(r["set"]) for r in alike), default=0),
                  "claimed_with_more_than_0.8": rate(alike, lambda r: r["confidence"] > 0.8).json()},
        # of these: all that is true is at least a step, whatever else is in; and one of several is not
        "alike_seen": {
            "in_set": rate(seen, in_set).json(), "largest_set": max((len(r["set"]) for r in seen), default=0),
            "claimed_with_more_than_0.8": rate(seen, lambda r: r["confidence"] > 0.8).json(),
        },
        "alike_hidden": {
            "right": rate(hidden, lambda r: any(_same(r["verdict"], c) for c in claimable(r))).json(),
            "in_set": rate(hidden, lambda r: any(_same(m, c) for c in claimable(r) for m in r["set"])).json(),
        },
        "between": {"right": rate(between, hit).json(), "in_set": rate(between, in_set).json()},
        "false_alarms": rate(by["none"], _detected).json(),
        "unknown_named": rate(by["unknown"], lambda r: r["verdict"] not in ("unknown", "none")).json(),
        "brier": brier(judged), "brier_raw": brier(judged, "raw"), "brier_all": brier(done),
        "reliability": reliability(done), "reliability_raw": reliability(done, "raw"),
        "power": power(done), "confusion": confusion(done), "coverage": coverage(done),
        "repaired_within_5_percent": rate(named, _repaired).json(),
        "seconds": _spread([float(r["seconds"]) for r in done]),
        "processor_s": _spread([float(r["processor_s"]) for r in timed])
        | {"within": rate(timed, lambda r: r["processor_s"] <= MOST_S).json()},
    }

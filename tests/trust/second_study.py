"""How often a diagnosis is right on campaigns of the second bench, which was written from the contract alone.

    python tests/trust/second_study.py --n 90 --seed 9000 --workers 2 --out second

Each campaign is drawn, written to a folder, read and diagnosed from that folder alone, as a user would do it, and
compared with the truth that lies beside the folder; then the folder is removed. With two workers 2 to 4 campaigns a
minute are done. Every campaign's row is appended to OUT/rows.jsonl when it is done; an interrupted study goes on where
it was. At the end: how many of each kind were named rightly, how many sets of explanations that cannot be told apart
hold the truth, the Brier score of the confidences, and the seconds that a diagnosis took.

Seeds 9000 to 9089 and 9200 to 9289 are those told of in reports/concealed.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
import traceback
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

# one thread a process: pools that fight over cores cost more than they give, and sums over threads differ in their last
# digits, from which a strength is found step by step
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
MODEL = "hooke+gm3"
KINDS = ("none", "single", "pair", "unknown")
SHARES = (0.12, 0.58, 0.1, 0.2)
#: beside a campaign's seed, so that its kind is drawn apart from the rest of it
_KIND_STREAM = 77


def kind_of(seed: int) -> str:
    """The kind of campaign that a seed stands for."""
    return str(np.random.default_rng([seed, _KIND_STREAM]).choice(KINDS, p=SHARES))


def one(seed: int, out: Path, short: bool = False) -> dict[str, Any]:
    """Diagnose one campaign; a failure is a finding, kept and counted."""
    import warnings

    warnings.simplefilter("ignore")
    kind = kind_of(seed)
    row: dict[str, Any] = {"seed": seed, "kind": kind}
    folder = out / f"c{seed}"
    try:
        simulated(seed, kind, folder, short)
        row |= diagnosed(folder)
    except Exception as error:
        row |= {"error": f"{type(error).__name__}: {error}", "trace": traceback.format_exc(limit=-4)}
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return row | revealed(folder)


def simulated(seed: int, kind: str, folder: Path, short: bool) -> None:
    """Write a campaign; its truth goes beside the folder."""
    from tests.trust.second_bench.protocol import FULL, SHORT
    from tests.trust.second_bench.write import write

    write(seed, kind, folder, SHORT if short else FULL)


def revealed(folder: Path) -> dict[str, Any]:
    """What was concealed; nothing where it never came to that."""
    file = folder.with_name(folder.name + ".truth.json")
    if not file.exists():
        return {}
    truth = json.loads(file.read_text(encoding="utf-8"))
    concealed = truth["truth"]
    return {
        "concealed": concealed,
        "truth": "unknown" if concealed.startswith("unknown:") else concealed,
        **{key: truth[key] for key in ("parameters", "sizes", "noise")},
    }


def diagnosed(folder: Path) -> dict[str, Any]:
    """What a user is told about a folder of recordings."""
    import bayes_dea as bd

    began, cpu = time.perf_counter(), time.process_time()
    s = bd.diagnose(bd.load_campaign(folder), MODEL, seed=1).summary
    return {
        "seconds": time.perf_counter() - began,
        "cpu_seconds": time.process_time() - cpu,
        "seconds_by": s["seconds_by"],
        "verdict": s["verdict"],
        "confidence": s["confidence"],
        "set": s["indistinguishable"],
        "p_value": s["mismatch"]["p_value"],
        "adequacy": s["adequacy_p_value"],
        "hypotheses": s["hypotheses"][:6],
        "proof": {k: s["proof"].get(k) for k in ("rmse_before_m", "rmse_after_m", "noise_m")},
        "warnings": s["warnings"][:4],
        "statement": s["statement"],
        "version": s["version"],
    }


def same(one_name: str, other: str) -> bool:
    """Whether two names mean the same effects, in whatever order they are joined."""
    return set(one_name.split("+")) == set(other.split("+"))


def right(row: dict[str, Any]) -> bool:
    """Whether the verdict is the truth; a campaign that failed is not right."""
    return "error" not in row and same(row["verdict"], row["truth"])


def holds(row: dict[str, Any]) -> bool:
    """Whether one of the explanations that cannot be told apart is the truth."""
    return "error" not in row and any(same(member, row["truth"]) for member in row["set"])


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Counts, Brier score and seconds by kind, and over all; what failed has no confidence and no seconds."""
    out = {}
    for kind in (*KINDS, "all"):
        members = [r for r in rows if kind in (r["kind"], "all")]
        told = [r for r in members if "error" not in r]
        seconds = [r["seconds"] for r in told]
        out[kind] = {
            "n": len(members),
            "failed": len(members) - len(told),
            "right": sum(map(right, members)),
            "set": sum(map(holds, members)),
            "brier": float(np.mean([(r["confidence"] - right(r)) ** 2 for r in told])) if told else None,
            "median_s": float(np.median(seconds)) if told else None,
            "longest_s": max(seconds, default=None),
        }
    return out


def table(rows: Sequence[dict[str, Any]]) -> str:
    """The summary as lines to read."""
    lines: list[tuple[str, ...]] = [("kind", "n", "right", "set holds", "failed", "Brier", "median", "longest")]
    for kind, s in summary(rows).items():
        brier = "-" if s["brier"] is None else f"{s['brier']:.3f}"
        seconds = ["-" if s[k] is None else f"{s[k]:.0f} s" for k in ("median_s", "longest_s")]
        lines.append((kind, *(str(s[k]) for k in ("n", "right", "set", "failed")), brier, seconds[0], seconds[1]))
    return "\n".join(line[0].ljust(8) + "".join(cell.rjust(11) for cell in line[1:]) for line in lines)


def read(file: Path) -> dict[int, dict[str, Any]]:
    """Rows by seed; a line that an interruption cut off is left out, and its campaign done again."""
    out: dict[int, dict[str, Any]] = {}
    if file.exists():
        for line in file.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            out[row["seed"]] = row
    return out


def append(file: Path, row: dict[str, Any]) -> None:
    """A row on a line of its own, also behind one that was cut off."""
    cut = file.exists() and file.stat().st_size > 0 and not file.read_bytes().endswith(b"\n")
    with file.open("a", encoding="utf-8") as out:
        out.write(("\n" if cut else "") + json.dumps(row, default=plain) + "\n")


def plain(value: Any) -> Any:
    """Numbers of numpy as those of Python."""
    return value.item() if hasattr(value, "item") else str(value)


def carried_out(seeds: Iterable[int], out: Path, workers: int, short: bool) -> Iterator[dict[str, Any]]:
    """Rows as they are done; one worker is this process itself."""
    if workers == 1:
        yield from (one(seed, out, short) for seed in seeds)
        return
    with ProcessPoolExecutor(workers) as pool:
        for future in as_completed([pool.submit(one, seed, out, short) for seed in seeds]):
            yield future.result()


def progress(row: dict[str, Any]) -> str:
    """A row as a line to read."""
    if "error" in row:
        return f"FAILED seed {row['seed']} {row.get('concealed', row['kind'])}: {row['error'][:200]}"
    return (
        f"{'right' if right(row) else 'WRONG'} seed {row['seed']} {row['concealed']} | {row['verdict']} "
        f"{row['confidence']:.3f} {row['set']} {row['seconds']:.0f} s"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=90, help="campaigns (default: 90)")
    parser.add_argument("--seed", type=int, default=9000, help="of the first campaign (default: 9000)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=Path("second"), help="folder of rows and truths")
    parser.add_argument("--short", action="store_true", help="seconds a recording: to try the script, no study")
    a = parser.parse_args(arguments)
    a.out.mkdir(parents=True, exist_ok=True)
    file = a.out / "rows.jsonl"
    wanted = range(a.seed, a.seed + a.n)
    done = read(file)
    missing = [seed for seed in wanted if seed not in done]
    if len(missing) < a.n:
        print(f"{a.n - len(missing)} of {a.n} campaigns are done already", flush=True)
    began = time.perf_counter()
    for k, row in enumerate(carried_out(missing, a.out, max(a.workers, 1), a.short), 1):
        append(file, row)
        print(f"{k}/{len(missing)} {time.perf_counter() - began:.0f} s  {progress(row)}", flush=True)
    rows = read(file)
    print(table([rows[seed] for seed in wanted if seed in rows]))
    return 0


if __name__ == "__main__":
    # the repository's root in place of this folder, where numba, looking for a package, finds the script coverage.py
    sys.path[0] = str(ROOT)
    sys.exit(main())

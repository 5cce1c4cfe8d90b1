"""All speed measurements by one command.

    python tests/benchmarks/run.py --out reports/benchmarks
    python tests/benchmarks/run.py --quick --only forward_waves --out out

Writes benchmarks.json, README.md and benchmarks.png. With --only the other parts of an existing benchmarks.json are
kept. Needs the extras "dev" and "bench" (dynesty, PINTS, control).
"""

# ruff: noqa: E402
from __future__ import annotations

import os

# before numpy is loaded: one thread, or BLAS would count double
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import importlib.metadata
import json
import platform
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import forward, goals, likelihood, nonlinear, problems, processes, sampling, search

NAMES = (
    "forward_waves",
    "forward_creep",
    "likelihood",
    "map",
    "sampling",
    "evidence",
    "nonlinear",
    "start_up",
    "loading",
    "calibration",
)


def parts(quick: bool, folder: Path, paper: Path | None) -> dict[str, Callable[[], Any]]:
    """Every measurement as a call without arguments. folder: for files; paper: the large campaign, if there is one."""
    scale = 0.1 if quick else 1.0
    rounds = 3 if quick else 7

    def files() -> Path:
        target = folder / "creep_and_waves"
        return target if target.exists() else sampling.write_files(target, scale)

    def large() -> Path:
        if paper is not None:
            return paper
        target = folder / "large"
        if not target.exists():
            import bayes_dea as bd

            bd.run_bench(target, "quickstart" if quick else "paper", 1)
        return target

    def signals() -> tuple[problems.Signal, ...]:
        return tuple(
            problems.signal(p) for shape in ("sine", "triangle", "rectangle") for p in problems.waves(shape, scale)
        )

    return {
        "forward_waves": lambda: forward.measure(signals(), rounds),
        "forward_creep": lambda: forward.measure((problems.signal(problems.creep(scale)),), rounds),
        "likelihood": lambda: likelihood.measure(problems.noisy_campaign(scale), rounds),
        "map": lambda: search.measure(problems.noisy_campaign(scale), runs=2 if quick else 8),
        "sampling": lambda: sampling.measure(files(), 1 if quick else 3, 3.0 if quick else 20.0),
        "evidence": lambda: sampling.evidence(files(), nested=not quick),
        "nonlinear": lambda: nonlinear.measure(problems.thirteen_recordings(scale), rounds),
        "start_up": lambda: processes.start_up(2 if quick else 7),
        "loading": lambda: processes.loading(large()),
        "calibration": lambda: processes.calibration(large(), folder / "out"),
    }


def meta(quick: bool) -> dict[str, Any]:
    """What the numbers belong to: versions and how busy the machine was; nothing that names it."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    packages = ("numpy", "scipy", "numba", "emcee", "pints", "control", "dynesty")
    return {
        "date": time.strftime("%Y-%m-%d"),
        "python": f"Python {platform.python_version()}",
        "quick": quick,
        "versions": {p: importlib.metadata.version(p) for p in packages},
        "processors": os.cpu_count(),
        "load": round(load, 1),
    }


def main() -> None:
    """Measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for benchmarks.json, README.md and the figure"
    )
    parser.add_argument(
        "--quick", action="store_true", help="a tenth of the samples, fewer rounds: shows that everything runs"
    )
    parser.add_argument(
        "--only", action="append", choices=NAMES, help="measure this part alone; may be given several times"
    )
    parser.add_argument(
        "--campaign", type=Path, help="an existing `bayes-dea bench --preset paper` campaign, instead of a new one"
    )
    parser.add_argument(
        "--page", action="store_true", help="measure nothing: draw page and figure of benchmarks.json again"
    )
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    target = arguments.out / "benchmarks.json"
    results: dict[str, Any] = {}
    if (arguments.only or arguments.page) and target.exists():
        results = json.loads(target.read_text(encoding="utf-8"))
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        for name, call in parts(arguments.quick, Path(folder), arguments.campaign).items():
            if arguments.page or (arguments.only and name not in arguments.only):
                continue
            began = time.perf_counter()
            results[name] = call()
            print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    if not arguments.page:
        results["meta"] = meta(arguments.quick)
    results["goals"] = goals.goals(results)
    target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (arguments.out / "README.md").write_text(goals.markdown(results), encoding="utf-8")
    goals.figure(results, arguments.out / "benchmarks.png")
    print(
        "\n".join(
            f"{g['job']:<50} goal {g['goal']:>8g} {g['unit']:<12} reached {g['reached']:.3g}"
            for g in results["goals"]
        )
    )


if __name__ == "__main__":
    main()

"""The whole study: teach, learn the map of confidence, judge on campaigns that it has not seen, draw the page.

    python runs/concealed/make.py --out study --workers 2

Interrupted, the same command goes on where it was. Diagnoses of the fresh campaigns are made with the new map.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def run(*words: object) -> None:
    """One script, with its own output."""
    subprocess.run([sys.executable, *map(str, words)], check=True, env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--teach", type=int, default=400, help="campaigns that teach the map")
    parser.add_argument("--fresh", type=int, default=400, help="campaigns that are scored")
    parser.add_argument("--none", type=int, default=1000, help="campaigns with nothing concealed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("study"))
    parser.add_argument("--report", type=Path, default=HERE.parents[1] / "reports" / "concealed")
    a = parser.parse_args()
    study = HERE / "study.py"
    common = ("--workers", a.workers)
    run(study, "--n", a.teach, "--seed", 100_000, "--out", a.out / "teach", *common)
    run(HERE / "learn.py", a.out / "teach", "--out", HERE.parents[1] / "priors" / "diagnosis" / "confidence.toml")
    run(study, "--n", a.fresh, "--seed", 1_000_000, "--out", a.out / "fresh", *common)
    run(study, "--n", a.none, "--seed", 2_000_000, "--kind", "none", "--out", a.out / "none", *common)
    run(HERE / "judge.py", a.out / "fresh", "--none", a.out / "none", "--out", a.report)


if __name__ == "__main__":
    main()

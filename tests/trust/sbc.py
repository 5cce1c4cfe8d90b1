"""Simulation-based calibration of the whole pipeline, from the command line.

    python tests/trust/sbc.py --model hooke+gm3 --n 200 --workers 2

Every replicate is appended to OUT/sbc_MODEL.jsonl when it is done, so that an interrupted run goes on where it was.
At the end (or with --only-report) the ranks of the first n replicates are judged and drawn into REPORT.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from sbc_pipeline import Design, replicate

from bayes_dea import __version__
from bayes_dea.calibration import CalibrationSettings
from bayes_dea.checks.sbc import ecdf_inside
from bayes_dea.fit.ensemble import EnsembleSettings

#: draws that a truth is ranked among: far fewer than the effective ones
KEEP = 99
SEED = 20250
HERE = Path(__file__).resolve().parent


def settings(max_steps: int) -> CalibrationSettings:
    """As `bayes_dea.calibrate`, with more walkers in place of more steps: a step of 96 costs hardly more than of 32."""
    return CalibrationSettings(walkers=96, sampler=EnsembleSettings(max_steps=max_steps))


def _one(spec: str, seed: int, index: int, max_steps: int) -> dict[str, Any]:
    from threadpoolctl import threadpool_limits

    try:
        with threadpool_limits(1):
            return replicate(spec, seed, index, KEEP, settings=settings(max_steps)).line()
    except Exception as error:  # a replicate that fails is a finding: it is kept and counted, the run goes on
        return {"index": index, "error": f"{type(error).__name__}: {error}", "trace": traceback.format_exc(limit=-4)}


def store(folder: Path, spec: str) -> Path:
    """File of a model's replicates."""
    return folder / f"sbc_{spec.replace('+', '_')}.jsonl"


def read(path: Path) -> dict[int, dict[str, Any]]:
    """Replicates by index; a line cut off by an interruption is left out."""
    out: dict[int, dict[str, Any]] = {}
    if path.exists():
        for line in path.read_text(encoding="utf-8").splitlines():
            try:
                row = json.loads(line)
            except json.JSONDecodeError:
                continue
            out[row["index"]] = row
    return out


def run(models: list[str], n: int, seed: int, workers: int, folder: Path, max_steps: int) -> None:
    """Work out what is missing of replicates 0..n-1 of each model, the models in turn."""
    folder.mkdir(parents=True, exist_ok=True)
    done = {m: read(store(folder, m)) for m in models}
    jobs = [(m, i) for i in range(n) for m in models if i not in done[m]]
    began, count = time.perf_counter(), 0
    with ProcessPoolExecutor(workers) as pool:
        futures = {pool.submit(_one, m, seed, i, max_steps): m for m, i in jobs}
        for future in as_completed(futures):
            row = future.result()
            with store(folder, futures[future]).open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            count += 1
            if count % 10 == 0 or count == len(jobs):
                print(f"{count} of {len(jobs)} replicates, {time.perf_counter() - began:.0f} s", flush=True)


def judge(rows: list[dict[str, Any]], spec: str) -> dict[str, Any]:
    """Which quantities keep inside their band, alone (95 %) and all at once (Bonferroni)."""
    good = [r for r in rows if not r.get("error")]
    names = list(good[0]["ranks"])
    quantities = {}
    for name in names:
        ranks = np.array([r["ranks"][name] for r in good])
        inside, worst = ecdf_inside(ranks, KEEP, 0.95)
        inside_all, worst_all = ecdf_inside(ranks, KEEP, 1 - 0.05 / len(names))
        u = (ranks + 0.5) / (KEEP + 1)
        quantities[name] = {"inside_95": inside, "inside_joint_95": inside_all, "distance": round(worst, 3),
                            "distance_joint": round(worst_all, 3), "mean": round(float(u.mean()), 4),
                            "variance_over_uniform": round(float(u.var() * 12), 3), "ranks": ranks.tolist()}
    ratio = np.array([r["gain_sd"] / r["gain_sd_drawn"] for r in good])
    return {
        "model": spec, "replicates": len(good), "failed": len(rows) - len(good),
        "errors": sorted({r["error"] for r in rows if r.get("error")}),
        "outside_95": [k for k, v in quantities.items() if not v["inside_95"]],
        "outside_joint_95": [k for k, v in quantities.items() if not v["inside_joint_95"]],
        "expected_outside_95": round(0.05 * len(names), 2),
        "converged": float(np.mean([r["converged"] for r in good])),
        "steps_median": float(np.median([r["steps"] for r in good])),
        "seconds_median": float(np.median([r["seconds"] for r in good])),
        "seconds_total": float(np.sum([r["seconds"] for r in good])),
        "replicates_with_dropouts": int(sum(r["dropouts"] > 0 for r in good)),
        "dropouts": int(sum(r["dropouts"] for r in good)),
        "replicates_with_mains": int(sum(r["mains"] > 0 for r in good)),
        "truth_above_map": int(sum(r["map_loss"] > 0.05 for r in good)),
        "all_swarms_agree": float(np.mean([r["map_agree"] == 8 for r in good])),
        "gain_sd_used_over_drawn": {"q05": float(np.quantile(ratio, 0.05)), "q50": float(np.median(ratio)),
                                    "q95": float(np.quantile(ratio, 0.95))},
        "quantities": quantities,
    }


def report(models: list[str], n: int, seed: int, folder: Path, out: Path, max_steps: int) -> bool:
    """Write JSON and figures; whether every quantity of every model is inside its joint band."""
    from figures import draw_ranks

    out.mkdir(parents=True, exist_ok=True)
    fine = True
    for spec in models:
        rows = [r for i, r in sorted(read(store(folder, spec)).items()) if i < n]
        if not rows:
            continue
        result = judge(rows, spec)
        fine &= not result["outside_joint_95"] and not result["failed"]
        name = f"sbc_{spec.replace('+', '_')}"
        head = {"command": f"python tests/trust/sbc.py --model {spec} --n {n} --seed {seed} --max-steps {max_steps}",
                "date": time.strftime("%Y-%m-%d"), "version": __version__, "seed": seed, "draws_ranked_among": KEEP,
                "max_steps": max_steps, "design": vars(Design())}
        (out / f"{name}.json").write_text(json.dumps({**head, **result}, indent=1) + "\n", encoding="utf-8")
        draw_ranks(result, KEEP, out / f"{name}.png")
        print(f"{spec}: {result['replicates']} replicates, {result['failed']} failed, outside their own 95 % band: "
              f"{result['outside_95'] or 'none'} (of {len(result['quantities'])}, expected "
              f"{result['expected_outside_95']}); outside the joint band: {result['outside_joint_95'] or 'none'}; "
              f"converged {result['converged']:.0%}, {result['seconds_median']:.1f} s each")
    return fine


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", action="append", help="SPEC; may be given several times")
    parser.add_argument("--n", type=int, default=200, help="replicates")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--max-steps", type=int, default=3000, help="of each ensemble, where it does not stop before")
    parser.add_argument("--out", type=Path, default=HERE / "out", help="folder of the replicates")
    parser.add_argument("--report", type=Path, default=HERE.parents[1] / "reports" / "trust")
    parser.add_argument("--only-report", action="store_true")
    a = parser.parse_args()
    models = a.model or ["hooke+gm3", "hooke+gkv3", "pz3"]
    if not a.only_report:
        run(models, a.n, a.seed, a.workers, a.out, a.max_steps)
    return 0 if report(models, a.n, a.seed, a.out, a.report, a.max_steps) else 1


if __name__ == "__main__":
    # one thread a process: the likelihood is small, and pools fighting over cores cost more than they give
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())

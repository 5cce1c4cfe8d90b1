"""Agreement with references: evidences with a nested sampler, posteriors with posteriordb. A command of its own.

    python tests/benchmarks/evidence.py --out reports/benchmarks
    python tests/benchmarks/evidence.py --only posteriordb --out out

Writes evidence.json, evidence.md and evidence.png. The nested sampler is dynesty (extra "dev"); the references of
posteriordb are looked for in ../shared/data/peers/posteriordb, or in the folder that --posteriordb names.
"""

# ruff: noqa: E402
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bayes_dea.comparison.anneal import anneal
from bayes_dea.comparison.integrate import bridged, integrate, normal_mixture
from bayes_dea.fit.diagnostics import ess
from bayes_dea.fit.ensemble import EnsembleSettings, sample
from bayes_dea.fit.evidence import nested_log_evidence
from bayes_dea.fit.polish import polish_newton
from benchmarks.evidence_posteriordb import Reference, all_references
from benchmarks.evidence_problems import Problem, actuator, linear_gaussian, mixture, read, unknown_noise

#: evidences agree within this, or within three standard errors of the nested sampler where that is more (nats)
GOAL_NATS = 0.3
GOAL_SE = 4.0
_FOLDER = Path(__file__).resolve().parents[3] / "shared/data/peers/posteriordb"


def problems(folder: Path | None) -> dict[str, Callable[[], Problem]]:
    """The five of them by a short name; the mixture needs data of posteriordb."""
    out: dict[str, Callable[[], Problem]] = {
        "linear_gaussian": linear_gaussian,
        "unknown_noise": unknown_noise,
        "gm1": lambda: actuator("hooke+gm1", 60.0, "hooke+gm1 on a creep of 60 s"),
        "gm2_short": lambda: actuator("hooke+gm2", 20.0, "hooke+gm2 on a creep shorter than its mode"),
    }
    if folder is not None:
        out["mixture"] = lambda: mixture(np.array(read(folder, "low_dim_gauss_mix")["y"]))
    return out


def ours(p: Problem, seed: int = 1, bridge: bool = True) -> dict[str, dict[str, float]]:
    """Log evidence with standard error by each of our ways."""
    rng = np.random.default_rng(seed)
    top = polish_newton(p.log_prob, p.start)
    covariance = np.linalg.inv(-top.hessian)
    if not np.all(np.linalg.eigvalsh(covariance) > 0):
        covariance = np.eye(top.x.size)
    began = time.perf_counter()
    direct = integrate(p.log_prob, top.x, covariance, rng)
    out = {"importance" if direct.method == "importance" else direct.method: {
        "log_evidence": direct.log_value, "se": direct.se, "seconds": time.perf_counter() - began}}
    if bridge:
        began = time.perf_counter()
        run = bridged(p.log_prob, direct.draws, direct.proposal, rng)
        out["bridge"] = {"log_evidence": run.log_value, "se": run.se, "seconds": time.perf_counter() - began}
    began = time.perf_counter()
    wide = normal_mixture(top.x, 2.25 * covariance)
    population = anneal(wide.draw, wide.log_density, p.log_prob, rng)
    out["annealed"] = {"log_evidence": population.log_ratio, "se": population.se,
                       "seconds": time.perf_counter() - began}
    return out


def compare_evidence(p: Problem, live_points: int, seed: int = 1) -> dict[str, Any]:
    """Our evidences, the nested sampler's, the closed form where there is one."""
    found = ours(p, seed)
    began = time.perf_counter()
    value, se = nested_log_evidence(
        p.log_likelihood, p.prior_transform, p.start.size, np.random.default_rng(seed), live_points=live_points,
        sample="rslice" if p.start.size > 4 else "auto",
    )  # fmt: skip
    nested = {"log_evidence": value, "se": se, "seconds": time.perf_counter() - began}
    reference = p.exact if p.exact is not None else value
    worst = max(abs(v["log_evidence"] - reference) for v in found.values())
    return {"problem": p.name, "exact": p.exact, "ours": found, "nested": nested, "worst_nats": worst,
            "worst_to_nested_nats": max(abs(v["log_evidence"] - value) for v in found.values()),
            "agrees": bool(worst < GOAL_NATS or (p.exact is None and worst < 3 * se))}


def compare_posterior(r: Reference, max_steps: int = 6000, seed: int = 1) -> dict[str, Any]:
    """Means and mean squares of a run of ours against the references, in combined Monte-Carlo standard errors."""
    rng = np.random.default_rng(seed)
    began = time.perf_counter()
    top = polish_newton(r.log_prob, r.start)
    covariance = np.linalg.inv(-top.hessian)
    d = r.start.size
    g = normal_mixture(top.x, covariance)
    start = np.stack([g.draw(max(32, 4 * d), rng) for _ in range(2)])
    good = np.isfinite(r.log_prob(start.reshape(-1, d))).reshape(start.shape[:2])
    start = np.where(good[..., None], start, top.x + 0.01 * (start - top.x))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = sample(r.log_prob, start, EnsembleSettings(max_steps=max_steps, ess_limit=2000.0), rng)
    e, n, w, _ = run.chains.shape
    natural = r.natural(run.chains.reshape(-1, d)).reshape(e, n, w, d)
    rows = []
    for i, name in enumerate(r.names):
        for power, mean, mcse in ((1, r.mean[i], r.mean_mcse[i]), (2, r.square[i], r.square_mcse[i])):
            v = natural[..., i] ** power
            own = float(np.std(v) / np.sqrt(ess(v, "mean")))
            z = float((v.mean() - mean) / np.hypot(own, mcse))
            rows.append({"quantity": name if power == 1 else f"{name}^2", "ours": float(v.mean()), "mcse": own,
                         "reference": float(mean), "reference_mcse": float(mcse), "z": z})
    worst = max(abs(x["z"]) for x in rows)
    return {"posterior": r.name, "converged": run.converged, "steps": run.steps, "evaluations": run.evaluations,
            "seconds": time.perf_counter() - began, "rows": rows, "worst_z": worst, "agrees": bool(worst < GOAL_SE)}


def figure(results: dict[str, Any], path: Path) -> None:
    """Differences of evidences, and of means in standard errors."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    evidences, posteriors = results.get("evidence", []), results.get("posteriordb", [])
    f = Figure(figsize=(9.5, 3.4), dpi=130)
    FigureCanvasAgg(f)
    left, right = f.subplots(1, 2)
    shapes = {"importance": "o", "annealed": "^", "bridge": "s", "nested": "x"}
    colours = {"importance": "#0072B2", "annealed": "#E69F00", "bridge": "#D55E00", "nested": "#1a1a1a"}
    for i, e in enumerate(evidences):
        reference = e["exact"] if e["exact"] is not None else e["nested"]["log_evidence"]
        for j, (name, v) in enumerate([*e["ours"].items(), ("nested", e["nested"])]):
            left.errorbar(v["log_evidence"] - reference, -i + 0.24 - 0.16 * j, xerr=2 * v["se"], fmt=shapes[name],
                          color=colours[name], markersize=4.5, label=name if i == 0 or name == "annealed" else None)
    left.axvspan(-GOAL_NATS, GOAL_NATS, color="#eeeeee", zorder=0)
    left.set_yticks(-np.arange(len(evidences)), [e["problem"].replace(", ", "\n", 1) for e in evidences], fontsize=7)
    left.set_xlabel("log evidence less the reference (nats), two standard errors")
    handles = dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    left.legend(handles.values(), handles.keys(), fontsize=7, frameon=False, ncols=4, loc="lower center",
                bbox_to_anchor=(0.5, 1.0))
    for i, p in enumerate(posteriors):
        z = [x["z"] for x in p["rows"]]
        right.plot(z, np.full(len(z), -i), "o", color="#0072B2", markersize=3.5, alpha=0.7)
    right.axvspan(-GOAL_SE, GOAL_SE, color="#eeeeee", zorder=0)
    right.set_xlim(-5, 5)
    right.set_yticks(-np.arange(len(posteriors)), [p["posterior"].split("-")[0] for p in posteriors], fontsize=7)
    right.set_xlabel("mean and mean square less posteriordb's\n(combined Monte-Carlo standard errors)")
    f.tight_layout()
    f.savefig(path)


def markdown(results: dict[str, Any]) -> str:
    """The tables beside the figure."""
    lines = ["# Agreement with references", "", "Written by `python tests/benchmarks/evidence.py`; all numbers are in "
             "`evidence.json`.", "", "![Differences to the references](evidence.png)", "", "## Evidences", "",
             f"Goal: within {GOAL_NATS} nats of the closed form, or of dynesty (or three of its standard errors).", "",
             "| problem | reference | importance or annealed | bridge | annealed | dynesty | agrees |",
             "|---|---|---|---|---|---|---|"]

    def cell(v: dict[str, float] | None) -> str:
        return "" if v is None else f"{v['log_evidence']:.3f} ± {v['se']:.3f} ({v['seconds']:.1f} s)"

    for e in results.get("evidence", []):
        exact = "dynesty" if e["exact"] is None else f"{e['exact']:.3f} (closed form)"
        lines.append(f"| {e['problem']} | {exact} | {cell(e['ours'].get('importance'))} | "
                     f"{cell(e['ours'].get('bridge'))} | {cell(e['ours'].get('annealed'))} | {cell(e['nested'])} | "
                     f"{'yes' if e['agrees'] else 'no'} |")
    lines += ["", "## Posteriors of posteriordb", "", f"Goal: every mean and mean square within {GOAL_SE:g} combined "
              "Monte-Carlo standard errors.", "", "| posterior | quantities | largest difference (standard errors) | "
              "sampler converged | s | agrees |", "|---|---|---|---|---|---|"]
    for p in results.get("posteriordb", []):
        lines.append(f"| {p['posterior']} | {len(p['rows'])} | {p['worst_z']:.2f} | "
                     f"{'yes' if p['converged'] else 'no'} | {p['seconds']:.0f} | {'yes' if p['agrees'] else 'no'} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", choices=("evidence", "posteriordb"))
    parser.add_argument("--posteriordb", type=Path, default=_FOLDER)
    parser.add_argument("--live-points", type=int, default=500)
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    target = a.out / "evidence.json"
    results: dict[str, Any] = json.loads(target.read_text()) if target.exists() else {}
    folder = a.posteriordb if a.posteriordb.is_dir() else None
    if a.only != "posteriordb":
        results["evidence"] = []
        for name, make in problems(folder).items():
            results["evidence"].append(compare_evidence(make(), a.live_points))
            print(name, json.dumps(results["evidence"][-1]), file=sys.stderr, flush=True)
    if a.only != "evidence" and folder is not None:
        results["posteriordb"] = []
        for name, make_reference in all_references(folder).items():
            results["posteriordb"].append(compare_posterior(make_reference()))
            last = results["posteriordb"][-1]
            print(name, last["worst_z"], last["converged"], f"{last['seconds']:.0f} s", file=sys.stderr, flush=True)
    target.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    (a.out / "evidence.md").write_text(markdown(results), encoding="utf-8")
    figure(results, a.out / "evidence.png")


if __name__ == "__main__":
    main()

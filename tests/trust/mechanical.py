"""Coverage with compressions and relaxations: the material's parameters where a measured position drives the force.

    python tests/trust/mechanical.py --out reports/trust

Campaigns of the virtual bench in which nothing is concealed and the plates press to identify; every one is fitted as a
diagnosis begins, and the truth is compared with Laplace's intervals. About six seconds a campaign.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "runs" / "concealed"))

from study import campaign_of  # noqa: E402

from bayes_dea.assemble import assemble  # noqa: E402
from bayes_dea.bench.concealed import draw_case  # noqa: E402
from bayes_dea.gauss_newton.noise_prior import noise_prior  # noqa: E402
from bayes_dea.gauss_newton.problem import Problem  # noqa: E402
from bayes_dea.gauss_newton.reduced import reduce_campaign  # noqa: E402
from bayes_dea.gauss_newton.refit import Fit  # noqa: E402
from bayes_dea.mismatch.diagnosis import DiagnosisSettings  # noqa: E402
from bayes_dea.mismatch.search.first_fit import first_fit  # noqa: E402
from bayes_dea.mismatch.where.locate import residuals, scan  # noqa: E402
from bayes_dea.models.model import build_model  # noqa: E402
from bayes_dea.results import write_json  # noqa: E402

#: half a 90 % interval in standard deviations, and the step of a derivative
INTERVAL, STEP = 1.6449, 1e-4


def log_sd(fit: Fit, name: str) -> float:
    """Posterior standard deviation of the logarithm of a parameter."""
    model = fit.problem.model
    slope = np.zeros(fit.q.size)
    for j in range(model.dimension):
        ends = []
        for way in (STEP, -STEP):
            q = fit.q[None, : model.dimension].copy()
            q[0, j] += way
            ends.append(float(np.log(model.physical(q)[name][0])))
        slope[j] = (ends[0] - ends[1]) / (2 * STEP)
    return float(np.sqrt(slope @ fit.covariance @ slope))


def one(seed: int) -> dict[str, Any] | None:
    """Deviations of a campaign's parameters in standard deviations; None where nothing presses to identify."""
    case = draw_case(seed, "none")
    pressed = {"compression", "relaxation"}
    if not any(r.role == "identify" and r.protocol.kind in pressed for r in case.plan.recordings):
        return None
    model = build_model(case.model)
    assembled = assemble(campaign_of(case), model, 1)
    pieces = [p for p in reduce_campaign(assembled) if p.identify]
    problem, prior = Problem.of(assembled, model, pieces), noise_prior(assembled)
    fit = first_fit(assembled, problem, prior, np.random.default_rng(0), DiagnosisSettings().map)
    if fit is None:
        return {"seed": seed, "model": case.model, "answer": False}
    found, material = fit.values(), case.plan.material
    truth = {"Y_Pa": material.Y_Pa}
    fast = sorted((n for n in found if n.startswith("tau_")), key=lambda n: found[n])
    for name, i in zip(fast, np.argsort(material.tau_s), strict=True):
        truth[name] = material.tau_s[i]
        truth[f"k_{name.split('_')[1]}_Pa"] = material.k_Pa[i]
    sd = {name: log_sd(fit, name) for name in truth}
    r = residuals(fit)
    chi2 = [float(np.mean(r.e[r.start[i] : r.start[i + 1]] ** 2)) for i, p in enumerate(pieces) if p.channel == "force"]
    return {
        "seed": seed, "model": case.model, "answer": True, "log_sd": sd, "force_chi2": chi2,
        "z": {name: float(np.log(found[name] / value)) / sd[name] for name, value in truth.items()},
        "p_value": scan(fit, np.random.default_rng(0)).p_value,
    }  # fmt: skip


def main() -> None:
    """Run, judge, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=730_000)
    parser.add_argument("--n", type=int, default=60, help="campaigns drawn; in about a third plates press to identify")
    parser.add_argument("--out", type=Path, default=Path("reports/trust"))
    given = parser.parse_args()
    rows = []
    for seed in range(given.seed, given.seed + given.n):
        row = one(seed)
        if row is not None:
            rows.append(row)
            print(seed, row["model"], {k: round(v, 2) for k, v in row.get("z", {}).items()}, flush=True)
    good = [r for r in rows if r["answer"]]
    z = np.array([v for r in good for v in r["z"].values()])
    hits = int(np.sum(np.abs(z) < INTERVAL))
    # parameters of a campaign are not independent: an interval by campaigns would be wider
    low, high = (float(beta.ppf(p, hits + a, z.size - hits + b)) for p, a, b in ((0.025, 0, 1), (0.975, 1, 0)))
    summary = {
        "campaigns": len(rows), "without_answer": len(rows) - len(good), "parameters": z.size, "inside_90": hits,
        "interval_95": [low, high], "sd_of_z": float(z.std()), "largest_z": float(np.abs(z).max()),
        "force_chi2": float(np.mean([c for r in good for c in r["force_chi2"]])),
        "inadequate_at_1_percent": sum(r["p_value"] < 0.01 for r in good),
        "median_log_sd": {k: float(np.median([v for r in good for n, v in r["log_sd"].items() if n.startswith(k)]))
                          for k in ("Y", "k_", "tau_")},
    }  # fmt: skip
    print(summary)
    given.out.mkdir(parents=True, exist_ok=True)
    write_json(given.out / "mechanical.json", {"summary": summary, "rows": rows})


if __name__ == "__main__":
    main()

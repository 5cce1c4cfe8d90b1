"""Coverage of predictive bands on recordings never fitted, over campaigns of the virtual bench.

    python tests/trust/coverage.py --n 40

The bench has its own equations and integrator. Each campaign is of a material of its own, its noise larger or smaller
than stated; even ones have white noise, odd ones AR(1) noise with a correlation of 0.5 to 0.9. hooke+gm3 is fitted to
the recordings to identify, everything else as `bayes_dea.calibrate` does it. Every campaign is appended to OUT when it
is done, so that an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bayes_dea import __version__
from bayes_dea.bench.nuisance import ChannelFaults, Faults
from bayes_dea.bench.plan import CampaignPlan, RecordingPlan
from bayes_dea.bench.protocols import Creep, Wave
from bayes_dea.bench.rig import Material
from bayes_dea.bench.simulate import simulate
from bayes_dea.calibration import CalibrationSettings, calibrate
from bayes_dea.campaign import Actuator, Campaign, Sensor, campaign_from_recordings, recording_from_arrays
from bayes_dea.fit.ensemble import EnsembleSettings

SEED = 4711
HERE = Path(__file__).resolve().parent
#: blocks with fewer samples are left out of the coverage of block means: quantisation and edges are not noise there
_SMALLEST_BLOCK = 4


def plan_of(index: int, seed: int) -> CampaignPlan:
    """The plan of one campaign: three holds and a sine to identify; a hold, a rectangle, a triangle to validate."""
    rng = np.random.default_rng([seed, index])
    correlation = 0.0 if index % 2 == 0 else float(rng.uniform(0.5, 0.9))
    scale = float(np.exp(0.3 * rng.standard_normal()))

    def creep(voltage_V: float, role: str) -> RecordingPlan:
        protocol = Creep(voltage_V, 240.0, conditioning_on_s=10.0, conditioning_off_s=10.0)
        return RecordingPlan(f"creep_{voltage_V:04.0f}V.csv", protocol, role, 250.0, zeroed=True)

    return CampaignPlan("coverage", (
        creep(500.0, "identify"), creep(800.0, "identify"), creep(1100.0, "identify"),
        RecordingPlan("sine_1Hz.csv", Wave("sine", 1.0), "identify", 250.0),
        creep(1000.0, "validate"),
        RecordingPlan("rectangle_1Hz.csv", Wave("rectangle", 1.0), "validate", 250.0),
        RecordingPlan("triangle_0.1Hz.csv", Wave("triangle", 0.1, cycles=3.0), "validate", 250.0)),
        material=Material.drawn(rng),
        faults=Faults(displacement=ChannelFaults(noise_scale=scale, noise_correlation=correlation)))


def campaign_of(plan: CampaignPlan, seed: int) -> tuple[Campaign, float]:
    """The plan carried out, as a campaign in memory; and the true gain."""
    geometry = asdict(plan.geometry)
    actuator = Actuator(**geometry)
    recordings, gain = [], 0.0
    for s in simulate(plan, seed):
        gain = s.truth["displacement"]["gain"]
        recordings.append(recording_from_arrays(s.plan.file, s.plan.protocol.kind, s.columns, s.plan.role, actuator,
                                                zeroed=s.plan.zeroed))
    sheet = plan.sensors.displacement
    sensor = Sensor(sheet.fluctuation, sheet.accuracy, sheet.resolution)
    return campaign_from_recordings(recordings, {"displacement": sensor}, actuator, name=plan.name), gain


def one(index: int, seed: int) -> dict[str, Any]:
    """Calibrate campaign `index` and look at what was not fitted."""
    from threadpoolctl import threadpool_limits

    began = time.perf_counter()
    plan = plan_of(index, seed)
    faults = plan.faults.displacement
    campaign, gain = campaign_of(plan, 1000 * seed + index)
    with threadpool_limits(1), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        result = calibrate(campaign, "hooke+gm3", index,
                           CalibrationSettings(walkers=96, draws=1000, predictive_draws=200,
                                               sampler=EnsembleSettings(max_steps=4000)))
    truth = {**plan.material.parameters(), "rho_displacement": faults.noise_correlation, "gain_displacement": gain,
             "sigma_displacement_m": faults.noise_scale * plan.sensors.displacement.fluctuation}
    entries = {**result.summary["parameters"], **result.summary["noise"]}
    inside = {k: bool(entries[k]["q05"] <= v <= entries[k]["q95"]) for k, v in truth.items()}
    z = {k: float((v - entries[k]["mean"]) / entries[k]["sd"]) for k, v in truth.items()}
    recordings = []
    for p in result.predictions:
        # blocks: how many means lie in the band of a mean, where noise has averaged out and parameters count
        large = p.count >= _SMALLEST_BLOCK
        within = np.abs(p.observed - p.mean)[large] <= 1.6449 * p.sd_block[large]
        recordings.append({"name": p.name, "role": p.role, "n": p.n, "coverage_90": p.coverage_90,
                           "coverage_50": p.coverage_50, "blocks_90": float(within.mean()), "blocks": int(large.sum()),
                           "rmse_m": p.rmse, "chi2": p.chi2_reduced})
    unseen = [r for r in recordings if r["role"] == "validate"]
    return {"index": index, "noise": "white" if index % 2 == 0 else "correlated",
            "correlation": faults.noise_correlation, "noise_scale": faults.noise_scale,
            "truth": truth, "inside_90": inside, "z": z,
            "coverage_90": float(np.mean([r["coverage_90"] for r in unseen])),
            "coverage_50": float(np.mean([r["coverage_50"] for r in unseen])),
            "blocks_90": float(np.mean([r["blocks_90"] for r in unseen])),
            "recordings": recordings, "converged": result.converged, "steps": result.sampling.steps,
            "dropouts_or_mains": [w for w in result.summary["warnings"] if "drop-out" in w or "mains" in w],
            "seconds": time.perf_counter() - began}


def read(path: Path) -> dict[int, dict[str, Any]]:
    """Campaigns by index."""
    rows = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
    return {r["index"]: r for r in rows}


def summarise(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Means over campaigns, all and by kind of noise."""
    kinds = {"all": rows, "white": [r for r in rows if r["noise"] == "white"],
             "correlated": [r for r in rows if r["noise"] == "correlated"]}

    def mean_of(key: str) -> dict[str, Any]:
        out = {}
        for kind, members in kinds.items():
            v = np.array([r[key] for r in members])
            out[kind] = {"mean": float(v.mean()), "se": float(v.std(ddof=1) / np.sqrt(v.size)) if v.size > 1 else None,
                         "smallest": float(v.min()), "largest": float(v.max())}
        return out

    by_recording = {}
    for name in [r["name"] for r in rows[0]["recordings"]]:
        members = [x for r in rows for x in r["recordings"] if x["name"] == name]
        means = {key: float(np.mean([m[key] for m in members])) for key in ("coverage_90", "blocks_90", "chi2")}
        by_recording[name] = {"role": members[0]["role"], **means}
    names = list(rows[0]["inside_90"])
    inside = {kind: {n: float(np.mean([r["inside_90"][n] for r in members])) for n in names}
              for kind, members in kinds.items()}
    return {"campaigns_fitted": len(rows), "coverage_90": mean_of("coverage_90"), "coverage_50": mean_of("coverage_50"),
            "blocks_90": mean_of("blocks_90"), "by_recording": by_recording, "parameters_inside_90": inside,
            "parameters_inside_90_mean": {k: float(np.mean(list(v.values()))) for k, v in inside.items()},
            "converged": float(np.mean([r["converged"] for r in rows])),
            "campaigns_with_false_dropouts_or_mains": int(sum(bool(r["dropouts_or_mains"]) for r in rows)),
            "seconds_median": float(np.median([r["seconds"] for r in rows])),
            "campaigns": rows}


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=40, help="campaigns, half of them with white noise")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=HERE / "out", help="folder of what is done")
    parser.add_argument("--report", type=Path, default=HERE.parents[1] / "reports" / "trust")
    parser.add_argument("--only-report", action="store_true")
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    path = a.out / "coverage.jsonl"
    if not a.only_report:
        missing = [i for i in range(a.n) if i not in read(path)]
        with ProcessPoolExecutor(a.workers) as pool:
            for k, future in enumerate(as_completed([pool.submit(one, i, a.seed) for i in missing]), 1):
                with path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(future.result()) + "\n")
                print(f"{k} of {len(missing)} campaigns", flush=True)
    result = summarise([r for i, r in sorted(read(path).items()) if i < a.n])
    a.report.mkdir(parents=True, exist_ok=True)
    head = {"command": f"python tests/trust/coverage.py --n {a.n} --seed {a.seed}", "date": time.strftime("%Y-%m-%d"),
            "version": __version__, "model": "hooke+gm3", "seed": a.seed}
    (a.report / "coverage.json").write_text(json.dumps({**head, **result}, indent=1) + "\n", encoding="utf-8")
    from figures import draw_coverage

    draw_coverage(result, a.report / "coverage.png")
    mean = result["coverage_90"]["all"]["mean"]
    for kind in ("all", "white", "correlated"):
        print(f"{kind}: 90 % bands hold {result['coverage_90'][kind]['mean']:.2%} of the samples, "
              f"{result['blocks_90'][kind]['mean']:.2%} of block means; 90 % intervals hold "
              f"{result['parameters_inside_90_mean'][kind]:.1%} of the true values")
    return 0 if 0.88 <= mean <= 0.92 else 1


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())

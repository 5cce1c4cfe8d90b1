"""How often the diagnosis is right: campaigns of the virtual bench with an effect concealed in each.

    python runs/concealed/study.py --n 200 --seed 1000 --workers 2 --out study

Every campaign's row is appended to OUT/rows.jsonl when it is done; an interrupted study goes on where it was. Seeds
below 1,000,000 teach (thresholds, the map of confidence); a score is only quoted from seeds that neither has seen.
"""

from __future__ import annotations

import argparse
import json
import os
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def campaign_of(case: Any) -> Any:
    """A drawn case as a campaign in memory."""
    import bayes_dea as bd
    from bayes_dea.bench.concealed import case_campaign

    g = case.plan.geometry
    actuator = bd.Actuator(
        g.name,
        g.layers,
        g.layer_thickness_m,
        g.relative_permittivity,
        g.electrode_area_m2,
        g.total_area_m2,
        g.stack_height_m,
        g.layer_mass_kg,
        g.max_voltage_V,
        g.max_frequency_Hz,
    )
    recordings = [
        bd.recording_from_arrays(p.file, p.protocol.kind, columns, p.role, actuator, zeroed=p.zeroed)
        for p, columns in case_campaign(case)
    ]
    sheets = case.plan.sensors
    sensors = {
        name: bd.Sensor(s.fluctuation, s.accuracy, s.resolution)
        for name in ("displacement", "force", "position")
        for s in [getattr(sheets, name)]
    }
    return bd.campaign_from_recordings(recordings, sensors, actuator, name=case.plan.name)


def one(seed: int, kind: str | None) -> dict[str, Any]:
    """Diagnose one drawn campaign."""
    import warnings

    warnings.simplefilter("ignore")
    from beside import sizes_beside
    from kept import code_digest
    from lead import lead_of

    from bayes_dea.bench.concealed import draw_case
    from bayes_dea.mismatch.diagnosis import diagnose

    row: dict[str, Any] = {"seed": seed, "kind": kind, "code": code_digest()}
    try:
        case = draw_case(seed, kind)
        row |= {
            "truth": case.verdict,
            "concealed": case.truth,
            "effects": case.effects,
            "model": case.model,
            "sizes": {n: {"steps": size.steps, "nats": size.nats} for n, size in case.sizes.items()},
        }
        campaign = campaign_of(case)
        began, worked = time.perf_counter(), time.process_time()
        result = diagnose(campaign, case.model, seed=1)
        s = result.summary
        row |= {
            "seconds": time.perf_counter() - began,
            # of one core, whatever runs beside it
            "processor_s": time.process_time() - worked,
            "seconds_by": s["seconds_by"],
            "verdict": s["verdict"],
            "confidence": s["confidence"],
            "raw": next(h["probability"] for h in s["hypotheses"] if h["name"] == s["verdict"]),
            "set": s["indistinguishable"],
            "p_value": s["mismatch"]["p_value"],
            "adequacy": s["adequacy_p_value"],
            "hypotheses": s["hypotheses"][:8],
            "proof": {k: s["proof"].get(k) for k in ("rmse_before_m", "rmse_after_m", "noise_m", "elpd_gain")},
            "noise": result.base.noise.sigma,
            "mechanical": any(p.channel == "force" for p in result.base.problem.pieces),
        }
        # after the rest: what fails here is no failed diagnosis
        row["lead"] = lead_of(case, campaign, result)
        beside = sizes_beside(case, campaign, result.base, result.assembled)
        row |= {} if beside is None else {"beside": beside}
    except Exception as error:  # a campaign that fails is a finding: it is kept and counted
        row |= {"error": f"{type(error).__name__}: {error}", "trace": traceback.format_exc(limit=-4)}
    return row


def plain(value: Any) -> Any:
    """Numbers of numpy as those of Python."""
    return value.item() if hasattr(value, "item") else str(value)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1000, help="seed of the first campaign")
    parser.add_argument("--kind", help="none, single, pair, unknown, or the name of an effect; drawn by default")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("study"))
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    file = a.out / "rows.jsonl"
    done = {json.loads(line)["seed"] for line in file.read_text().splitlines()} if file.exists() else set()
    jobs = [s for s in range(a.seed, a.seed + a.n) if s not in done]
    began = time.perf_counter()
    with ProcessPoolExecutor(a.workers) as pool:
        futures = [pool.submit(one, s, a.kind) for s in jobs]
        for k, future in enumerate(as_completed(futures), 1):
            row = future.result()
            with file.open("a", encoding="utf-8") as out:
                out.write(json.dumps(row, default=plain) + "\n")
            right = row.get("verdict") == row.get("truth")
            print(
                f"{k}/{len(jobs)} {time.perf_counter() - began:.0f} s  {'right' if right else 'WRONG'} "
                f"seed {row['seed']} "
                f"truth {row.get('truth')} verdict {row.get('verdict')} "
                f"{row.get('confidence', 0):.3f} set {row.get('set')} "
                f"{row.get('processor_s', 0):.0f} s {row.get('error', '')[:200]}",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""How large each of several concealed effects is beside the others: RMS of what it changes on the recording that it
moves most, after the refit of everything else, in resolution steps.

    python runs/concealed/beside.py reports/concealed/rows.jsonl.gz --out reports/concealed/rows.jsonl.gz

adds that to the rows of two effects that lack it (some seconds a campaign; an interrupted run goes on from its --out).
What is below one step is not to be claimed (CONTRACT 1), and of two effects one may be so once the other is in, however
large it would be alone: a lag beside a leak, a limit of the sensor where the supply saturates.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: cuts readings off, which no fit of the rest has: its size is not seen here
_CUTS_OFF = "sensor_clipping"
#: rows between two writes of the file
_EVERY = 10


def sizes_beside(case: Any, campaign: Any, base: Any, assembled: Any) -> dict[str, float] | None:
    """Steps by effect of a case with several; None for others, or where the true equations cannot be fitted. A limit
    of the sensor has none.

    base: fit of the plain model. Of recordings to validate the commands alone are used. The other effects are refitted
    from where the truth stands, and from where the plain model does: the better one counts.
    """
    from lead import fit_of_the_truth, names_of

    from bayes_dea.gauss_newton.noise_prior import noise_prior
    from bayes_dea.gauss_newton.reduced import reduce_campaign
    from bayes_dea.mismatch.search.hypotheses import extended
    from bayes_dea.mismatch.search.relabel import within
    from bayes_dea.mismatch.search.weigh import Weighed
    from bayes_dea.mismatch.where.size import effect_size, size_elsewhere

    if "+" not in case.truth or set(case.effects) != set(case.truth.split("+")):
        return None
    whole = fit_of_the_truth(case, campaign, base, assembled)
    if whole is None:
        return None
    unseen = [p for p in reduce_campaign(assembled) if not p.identify and p.channel == "displacement"]
    own = {p.name: p for p in whole.problem.model.parameters}
    prior, names, steps = noise_prior(assembled), names_of(case), {}
    for effect in (e for e in case.truth.split("+") if e != _CUTS_OFF):
        model = extended(base.problem.model, [n for n in names if n != effect], own)
        starts = (_on(base, whole), whole)
        found = [within(Weighed(tuple(names), f, f.log_evidence, 0.1, 0.0), base, model, prior) for f in starts]
        without = min((w.fit for w in found if w is not None), key=lambda f: f.objective, default=None)
        if without is None:
            return None
        size_m = max(effect_size(without, whole), size_elsewhere(without, whole, unseen))
        steps[effect] = size_m / case.plan.sensors.displacement.resolution
    return steps


def _on(base: Any, whole: Any) -> Any:
    """The truth's effects on the base as the plain model has it: where a fit may begin."""
    from dataclasses import replace

    mine, plain = whole.problem.model.priors.names, base.problem.model.priors.names
    q = whole.q.copy()
    for i, name in enumerate(plain):
        q[mine.index(name)] = base.q[i]
    q[whole.problem.model.dimension :] = base.q[base.problem.model.dimension :]
    return replace(whole, q=q)


def of_seed(seed: int, kind: str | None) -> dict[str, float] | None:
    """The same of a drawn case, whose plain model is fitted here."""
    import numpy as np
    from study import campaign_of

    from bayes_dea.bench.concealed import draw_case
    from bayes_dea.find_map import MapSettings
    from bayes_dea.gauss_newton.journal import Journal
    from bayes_dea.mismatch.laps import Laps
    from bayes_dea.mismatch.prepare import prepared
    from bayes_dea.models.model import build_model

    case = draw_case(seed, kind)
    campaign = campaign_of(case)
    ready = prepared(
        campaign, build_model(case.model), MapSettings(), 1, np.random.default_rng(1), Journal(None),
        lambda *_: None, Laps(),
    )  # fmt: skip
    return sizes_beside(case, campaign, ready.seen.base, ready.assembled)


def main() -> None:
    """Command line."""
    import warnings

    from kept import packed
    from scores import NAMEABLE_NATS, group, read_rows

    from bayes_dea.results import write_bytes

    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--below", type=float, default=NAMEABLE_NATS, help="nats of lead below which rows are asked")
    a = parser.parse_args()
    rows = read_rows(a.rows)
    known = {r["seed"]: r["beside"] for r in read_rows(a.out) if "beside" in r}
    rows = [r | {"beside": known[r["seed"]]} if r["seed"] in known else r for r in rows]
    todo = [i for i, r in enumerate(rows) if group(r) == "pair" and "beside" not in r and r.get("lead") is not None]
    todo = sorted((i for i in todo if rows[i]["lead"] < a.below), key=lambda i: rows[i]["lead"])
    for k, i in enumerate(todo, 1):
        steps = of_seed(rows[i]["seed"], rows[i].get("kind"))
        rows[i] |= {} if steps is None else {"beside": steps}
        r = rows[i]
        print(f"{k}/{len(todo)} seed {r['seed']} {r['truth']} lead {r['lead']:.1f} {steps}", flush=True)
        if k % _EVERY == 0:
            write_bytes(a.out, packed(rows))
    write_bytes(a.out, packed(rows))


if __name__ == "__main__":
    main()

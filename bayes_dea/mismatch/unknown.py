"""What can be said of a mismatch that nothing on the list explains: where it lives and what it looks like."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .features import Features
from .locate import residuals
from .name import Explanation

#: terms that are tried: name, stage, what they act on
_TERMS = (
    ("V^2", "electrostatic", "voltage"),
    ("V^4", "electrostatic", "voltage"),
    ("displacement^2", "mechanical", "strain"),
    ("rate of the command", "mechanical", "strain rate"),
    ("|rate| of the command", "mechanical", "strain rate"),
    ("time since an edge < 30 ms", "electrical", "edges"),
    ("time since an edge 30 ms - 1 s", "mechanical", "fast creep"),
    ("time since an edge > 1 s", "mechanical", "slow creep"),
    ("time of the recording", "sensor", "time"),
    ("direction of travel", "mechanical", "direction"),
)


def repair(best: Explanation, looks: list[Features]) -> dict[str, Any]:
    """Linear terms beside the best fit, chosen by stepwise evidence (BIC), each with its size.

    Returns the "repair" of diagnosis.json: the stage most of the mismatch lives in, what it acts on, a form in words,
    and the terms in m (sd from the regression, inclusion probability from the difference in BIC).
    """
    fit = best.weighed.fit
    res = residuals(fit)
    columns = []
    for i, (piece, f) in enumerate(zip(fit.problem.pieces, looks, strict=True)):
        v = f.level / max(float(np.max(np.abs(f.level))), 1e-300)
        since = np.where(np.isfinite(f.since_edge_s), f.since_edge_s, 1e9)
        x = fit.clean[i] / max(float(np.max(np.abs(fit.clean[i]))), 1e-300)
        t = np.linspace(0, 1, v.size)
        own = np.stack(
            [
                v**2,
                v**4,
                x**2,
                f.speed,
                np.abs(f.speed),
                (since < 0.03) * np.sign(f.jump),
                ((since >= 0.03) & (since < 1.0)) * np.sign(f.jump),
                ((since >= 1.0) & (since < 1e8)) * np.sign(f.jump),
                t,
                np.sign(np.where(np.abs(f.speed) > 0.02, f.speed, 0.0)),
            ]
        )
        sigma, _ = fit.noise.of(piece)
        columns.append(own * np.sqrt(piece.blocks.count) / sigma)
    A = res.project(res.spread(columns))
    e = res.e
    chosen: list[int] = []
    left = float(e @ e)
    for _ in range(4):
        scores = []
        for k in range(A.shape[1]):
            if k in chosen:
                continue
            B = A[:, [*chosen, k]]
            c, *_ = np.linalg.lstsq(B, e, rcond=1e-10)
            scores.append((float(np.sum((e - B @ c) ** 2)), k))
        rest, k = min(scores)
        if left - rest < math.log(e.size) + 4.0:
            break
        chosen.append(k)
        left = rest
    terms: list[dict[str, Any]] = []
    if chosen:
        B = A[:, chosen]
        c, *_ = np.linalg.lstsq(B, e, rcond=1e-10)
        cov = np.linalg.pinv(B.T @ B)
        for n, k in enumerate(chosen):
            others = A[:, [j for j in chosen if j != k]]
            without = e - others @ np.linalg.lstsq(others, e, rcond=1e-10)[0] if others.shape[1] else e
            gain = 0.5 * (float(without @ without) - left) - 0.5 * math.log(e.size)
            terms.append(
                {
                    "term": _TERMS[k][0],
                    "mean": float(c[n]),
                    "sd": math.sqrt(max(float(cov[n, n]), 0.0)),
                    "unit": "m",
                    "inclusion_probability": 1.0 / (1.0 + math.exp(-min(max(gain, -50.0), 50.0))),
                }
            )
    stage, acts = (_TERMS[chosen[0]][1], _TERMS[chosen[0]][2]) if chosen else ("unknown", "no term that was tried")
    words = " + ".join(f"{t['mean'] * 1e6:.2g} um x ({t['term']})" for t in terms) or "no simple form"
    return {"stage": stage, "acts_on": acts, "form": words, "terms": terms, "partial": best.weighed.name}

"""comparison.json: the ranking and everything that stands behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..campaign.named import campaign_words
from ..models.model import Model
from ..quantities import statistics
from .common import CommonData
from .experiment import telling_apart
from .kept import Done, scores_of
from .partners import Partner, exact_partner, in_corner
from .questions import DECIDES_NATS, DECIDES_SE, questions
from .weigh import difference, probabilities, probability_interval, stacking_weights
from .widths import prior_width
from .words import notes_of, statement, warnings_of

Array = NDArray[np.float64]
#: pairs for which an experiment is looked for
_MOST_PAIRS = 3


def summarise(
    data: CommonData,
    built: Mapping[str, Model],
    groups: Sequence[Sequence[str]],
    chosen: Sequence[str],
    done: Mapping[str, Done],
    rng: np.random.Generator,
    again: Sequence[str] = (),
) -> dict[str, Any]:
    """Everything that comparison.json says, but seconds and seed. again: how commands name the campaign."""
    recordings = _scored(done)
    partners = [
        exact_partner(data, built[c], built[n], done[c])
        for g, c in zip(groups, chosen, strict=True) for n in g if n != c
    ]  # fmt: skip
    cornered = in_corner(done, chosen)
    hidden = {p.model for p in (*partners, *cornered)}
    ranked = [c for c in chosen if c not in hidden]
    entries = [_entry(name, done[name], recordings) for name in ranked]
    _weigh(entries, recordings, rng)
    entries.sort(key=_rank)
    equivalent = _equivalent(groups, cornered)
    pairs = _pairs(entries)
    unresolved = _unresolved(entries)
    apart = [_apart(done, e, entries[0], data) for e in unresolved[:_MOST_PAIRS]]
    summary: dict[str, Any] = {
        "models": list(built),
        "campaign": data.campaign.name,
        "statement": "",
        "ranking": entries,
        "equivalent": equivalent,
        "partners": [_partner(p, done) for p in (*partners, *cornered)],
        "pairs": pairs,
        "cannot_tell": [[entries[0]["model"], e["model"]] for e in unresolved],
        "tell_apart": [a for a in apart if a is not None],
        "questions": questions(entries, data.campaign),
        "recordings": recordings,
        "notes": [*data.notes, *notes_of(entries)],
        "version": __version__,
        "conventions": dict(data.campaign.conventions),
        "inputs": [dict(i) for i in data.campaign.inputs],
        "warnings": [],
    }
    summary["statement"] = statement(summary)
    summary["warnings"] = [*data.warnings, *warnings_of(summary, done, again or campaign_words(data.campaign))]
    return summary


def _scored(done: Mapping[str, Done]) -> list[dict[str, Any]]:
    """Recordings that were left out, in the campaign's order."""
    first = max(done.values(), key=lambda d: len(d.scores))
    return [{"recording": s.recording, "role": s.role, "channel": s.channel, "n": s.n} for s in first.scores]


def _entry(name: str, d: Done, recordings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    scores = scores_of(d, [r["recording"] for r in recordings])
    widths = {f: prior_width(d.fit.posterior, d.whole.draws, f) for f in (0.5, 2.0)}
    posterior = d.fit.posterior
    return {
        "model": name,
        "probability": math.nan,
        "probability_q05": math.nan,
        "probability_q95": math.nan,
        "log_evidence": d.whole.log_value,
        "log_evidence_se": d.whole.se,
        "log_evidence_by": d.whole.method,
        "log_evidence_laplace": d.fit.laplace,
        "prior_widths": {
            "halved": widths[0.5].change, "doubled": widths[2.0].change, "by": "reweighting the draws",
            "trusted": widths[0.5].trusted and widths[2.0].trusted,
        },
        "elpd": float(np.sum(scores)) if scores.size and np.isfinite(scores).all() else math.nan,
        "elpd_se": math.nan,
        "elpd_diff": math.nan,
        "elpd_diff_se": math.nan,
        "elpd_mc_se": float(np.sqrt(sum(s.mc_se**2 for s in d.scores))) if d.scores else math.nan,
        "stacking_weight": math.nan,
        "scores": scores.tolist(),
        "n_parameters": posterior.model.dimension,
        "parameters": _parameters(d),
        "noise": _noise(d),
        "rmse_m": d.rmse_m,
        "log_likelihood": d.fit.log_likelihood,
        "map_log_posterior": d.fit.log_posterior,
        "swarms_agree": [d.fit.agree, d.fit.swarms],
        "pareto_k": d.whole.pareto_k,
        "converged": bool(d.whole.converged and np.isfinite(d.whole.log_value)),
        "spared": d.spared,
        "seconds": float(sum(d.seconds.values())),
    }


def _parameters(d: Done) -> dict[str, dict[str, Any]]:
    posterior = d.fit.posterior
    units = posterior.model.units()
    values = posterior.model.reported(posterior.model_part(d.whole.draws))
    at = posterior.model.reported(posterior.model_part(d.fit.x[None]))
    return {name: {**statistics(v), "unit": units[name], "map": float(at[name][0])} for name, v in values.items()}


def _noise(d: Done) -> dict[str, dict[str, float]]:
    return {name: statistics(v) for name, v in d.fit.posterior.noise_quantities(d.whole.draws).items()}


def _weigh(entries: list[dict[str, Any]], recordings: Sequence[Mapping[str, Any]], rng: np.random.Generator) -> None:
    """Probabilities, differences of scores and stacking weights, into the entries."""
    value = np.array([e["log_evidence"] for e in entries], float)
    se = np.array([e["log_evidence_se"] for e in entries], float)
    scores = np.array([e["scores"] for e in entries], float).reshape(len(entries), len(recordings))
    weights = stacking_weights(scores.T, [e["model"] for e in entries])
    band = probability_interval(value, se, rng)
    elpd = np.array([e["elpd"] for e in entries], float)
    best = int(np.nanargmax(elpd)) if np.isfinite(elpd).any() else None
    for i, (e, p) in enumerate(zip(entries, probabilities(value), strict=True)):
        e["probability"] = float(p)
        e["probability_q05"], e["probability_q95"] = float(band[i, 0]), float(band[i, 1])
        e["stacking_weight"] = float(weights[i])
        known = scores[i][np.isfinite(scores[i])]
        e["elpd_se"] = float(np.sqrt(known.size) * np.std(known, ddof=1)) if known.size > 1 else math.nan
        if best is not None:
            e["elpd_diff"], e["elpd_diff_se"] = difference(scores[i], scores[best])


def _rank(e: Mapping[str, Any]) -> tuple[bool, float]:
    return (not math.isfinite(e["log_evidence"]), -e["log_evidence"] if math.isfinite(e["log_evidence"]) else 0.0)


def _equivalent(groups: Sequence[Sequence[str]], cornered: Sequence[Partner]) -> list[list[str]]:
    """Names that are one and the same function, exactly or on these recordings; corners join what they fall into."""
    out = [list(g) for g in groups]
    for p in cornered:
        here = next(g for g in out if p.of in g)
        there = next(g for g in out if p.model in g)
        if here is not there:
            here.extend(there)
            out.remove(there)
    return [g for g in out if len(g) > 1]


def _partner(p: Partner, done: Mapping[str, Done]) -> dict[str, Any]:
    of = done[p.of].whole.log_value
    return {
        "model": p.model,
        "same_as": p.of,
        "why": p.why,
        "log_evidence": p.log_evidence,
        "log_evidence_se": p.log_evidence_se,
        "through_priors_alone": None if p.log_evidence is None else p.log_evidence - of,
        "likelihood_gap_nats": p.gap,
    }


def _pairs(entries: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Every pair of ranked models: evidence and score of the first minus those of the second."""
    out = []
    for i, a in enumerate(entries):
        for b in entries[i + 1 :]:
            d, se = difference(np.array(a["scores"], float), np.array(b["scores"], float))
            out.append({
                "models": [a["model"], b["model"]],
                "log_evidence_diff": a["log_evidence"] - b["log_evidence"],
                "log_evidence_diff_se": math.hypot(a["log_evidence_se"], b["log_evidence_se"]),
                "elpd_diff": d,
                "elpd_diff_se": se,
            })  # fmt: skip
    return out


def _unresolved(entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Models that the evidence leaves within odds of 20 to 1 of the best."""
    top = entries[0]["log_evidence"]
    return [
        e for e in entries[1:]
        if top - e["log_evidence"] < DECIDES_NATS + 2 * math.hypot(e["log_evidence_se"], entries[0]["log_evidence_se"])
    ]  # fmt: skip


def _apart(
    done: Mapping[str, Done], e: Mapping[str, Any], best: Mapping[str, Any], data: CommonData
) -> dict[str, Any] | None:
    mechanical = any(r.is_mechanical for r in data.campaign.recordings)
    found = telling_apart(done[best["model"]].fit, done[e["model"]].fit, mechanical)
    return None if found is None else {"models": [best["model"], e["model"]], **found}


__all__ = ["DECIDES_NATS", "DECIDES_SE", "summarise"]

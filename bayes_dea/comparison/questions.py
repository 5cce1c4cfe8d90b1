"""The reference paper's questions, answered by what was compared: viscoelasticity, Hooke's law, number of elements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..campaign.schema import Campaign
from ..models.spec import parse_spec
from .weigh import difference

Entry = Mapping[str, Any]
#: nats beyond which an evidence decides (odds of 20 to 1), and errors beyond which a difference of scores does
DECIDES_NATS, DECIDES_SE = 3.0, 2.0


def questions(entries: Sequence[Entry], campaign: Campaign) -> list[dict[str, Any]]:
    """What the recordings say to each question that the list of models can answer."""
    found = [_viscoelastic(entries), _hooke(entries, campaign), _elements(entries)]
    return [f for f in found if f is not None]


def _best(entries: Sequence[Entry]) -> Entry | None:
    known = [e for e in entries if math.isfinite(e["log_evidence"])]
    return max(known, key=lambda e: e["log_evidence"]) if known else None


def _against(a: Entry, b: Entry) -> dict[str, Any]:
    """Evidence and prediction of a minus those of b."""
    gain, se = difference(np.array(a["scores"]), np.array(b["scores"]))
    return {
        "models": [a["model"], b["model"]],
        "log_evidence_diff": a["log_evidence"] - b["log_evidence"],
        "log_evidence_diff_se": math.hypot(a["log_evidence_se"], b["log_evidence_se"]),
        "elpd_diff": gain,
        "elpd_diff_se": se,
        "rmse_m": [a["rmse_m"], b["rmse_m"]],
    }


def _viscoelastic(entries: Sequence[Entry]) -> dict[str, Any] | None:
    static = _best([e for e in entries if _static(e["model"])])
    moving = _best([e for e in entries if not _static(e["model"])])
    if static is None or moving is None:
        return None
    numbers = _against(moving, static)
    nats = numbers["log_evidence_diff"]
    answer = "yes" if nats > DECIDES_NATS else "no" if nats < -DECIDES_NATS else "undecided"
    text = (
        f"{_verdict(answer)}: {moving['model']} has {_nats(nats)} {'more' if nats > 0 else 'less'} log evidence than "
        f"{static['model']}, which has no memory"
    )
    if moving["rmse_m"] and static["rmse_m"]:
        text += (
            f", and leaves {1e6 * moving['rmse_m']:.3g} instead of {1e6 * static['rmse_m']:.3g} um of the displacement "
            "unexplained (RMS)"
        )
    return {"question": "Is a viscoelastic model needed?", "answer": answer, "text": text + ".", **numbers}


def _hooke(entries: Sequence[Entry], campaign: Campaign) -> dict[str, Any] | None:
    pairs = []
    by_name = {e["model"]: e for e in entries}
    for e in entries:
        s = parse_spec(e["model"])
        if s.law in (None, "hooke") or not math.isfinite(e["log_evidence"]):
            continue
        twin = by_name.get(e["model"].replace(str(s.law), "hooke", 1))
        if twin is not None and math.isfinite(twin["log_evidence"]):
            pairs.append((e, twin))
    if not pairs:
        return None
    other, hooke = max(pairs, key=lambda p: p[0]["log_evidence"] - p[1]["log_evidence"])
    numbers = _against(hooke, other)
    nats = numbers["log_evidence_diff"]
    answer = "yes" if nats > DECIDES_NATS else "no" if nats < -DECIDES_NATS else "undecided"
    reach = largest_strain(campaign)
    text = (
        f"{_verdict(answer)}, up to {100 * reach:.3g} % of strain, the largest in these recordings: {hooke['model']} "
        f"has {_nats(nats)} {'more' if nats > 0 else 'less'} log evidence than {other['model']}, the best of the "
        "curved laws"
    )
    if reach < 0.2:
        text += f"; nothing is said about 20 %, for which a compression by {20} % of the height would be needed"
    return {"question": "Is Hooke's law enough up to 20 % of strain?", "answer": answer, "text": text + ".",
            "largest_strain": reach, **numbers}


def _elements(entries: Sequence[Entry]) -> dict[str, Any] | None:
    families: dict[tuple[str | None, str, tuple[str, ...]], dict[int, Entry]] = {}
    for e in entries:
        s = parse_spec(e["model"])
        if s.network in ("gm", "gkv", "gkm") and math.isfinite(e["log_evidence"]):
            families.setdefault((s.law, s.network, s.effects), {})[s.elements] = e
    family = max(families.values(), key=len, default={})
    if len(family) < 2:
        return None
    best = max(family, key=lambda n: family[n]["log_evidence"])
    top = family[best]["log_evidence"]
    near = sorted(n for n in family if top - family[n]["log_evidence"] < DECIDES_NATS)
    if len(near) > 1:
        answer, text = "undecided", f"the recordings cannot decide between {_listed(near)} elements"
    else:
        answer = "yes" if best == 3 else "no"
        second = max((n for n in family if n != best), key=lambda n: family[n]["log_evidence"])
        text = (
            f"{best} {'element is' if best == 1 else 'elements are'} best of {_listed(sorted(family))}, "
            f"{_nats(top - family[second]['log_evidence'])} of log evidence before {second}"
        )
    if 3 not in family:
        answer = "undecided"
        text += "; three were not among them"
    return {"question": "Are three elements best?", "answer": answer, "text": text[0].upper() + text[1:] + ".",
            "best": best, "not_excluded": near,
            "log_evidence": {str(n): family[n]["log_evidence"] for n in sorted(family)}}


def _static(name: str) -> bool:
    return parse_spec(name).network == "none"


def _verdict(answer: str) -> str:
    return {"yes": "Yes", "no": "No", "undecided": "Undecided"}[answer]


def _nats(value: float) -> str:
    size = abs(value)
    return f"{size:.1f} nats" if size < 100 else f"{size:,.0f} nats"


def _listed(numbers: Sequence[int]) -> str:
    return f"{', '.join(str(n) for n in numbers[:-1])} and {numbers[-1]}"


def largest_strain(campaign: Campaign) -> float:
    """Largest strain that a recording reaches, from what was recorded."""
    out = 0.0
    for r in campaign.recordings:
        a = r.actuator
        if r.is_voltage and a.layers and a.layer_thickness_m:
            y = r.columns["displacement_m"]
            y = y[np.isfinite(y)]
            out = max(out, float(np.quantile(y, 0.999) - np.quantile(y, 0.001)) / (a.layers * a.layer_thickness_m))
        elif r.is_mechanical and a.stack_height_m:
            out = max(out, float(np.nanmax(r.columns["position_m"]) - np.nanmin(r.columns["position_m"]))
                      / a.stack_height_m)
    return out

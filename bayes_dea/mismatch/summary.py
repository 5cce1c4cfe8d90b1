"""diagnosis.json of a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..assemble import Assembled
from ..campaign.named import campaign_words
from ..campaign.schema import Campaign
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit
from ..models.model import Model, build_model
from ..priors import Prior
from .confidence import confidence_of
from .go_on import calibrate_command
from .judge import Judged
from .prove import HeldOut
from .readings.clipped import Limit
from .readings.own_gains import Gains
from .readings.own_limits import limit_as_shown
from .readings.reread import Foreign, Rereading
from .readings.swinging import Swinging
from .readings.uneven import Uneven
from .search.hypotheses import MAINS, NONE, UNKNOWN, effect_priors, extended, most_for_unknown
from .search.naming import Naming
from .verdict import silent
from .where.locate import excess_by, where
from .words import silent_note, statement

Array = NDArray[np.float64]
#: what the proof says of a repair beside the best partial explanation, the forces where there are some
_OF_REPAIR = ("rmse_before_m", "rmse_after_m", "rmse_before_N", "rmse_after_N", "elpd_gain", "elpd_gain_se")
#: how what is said of a recording of another actuator begins
ANOTHER = "of another actuator"
#: places (n, k) of the parameters that effects add, in their coordinates and order, and weights (n,)
Draws = tuple[Array, Array]


def summarise(
    assembled: Assembled,
    judged: Judged,
    proof: list[HeldOut],
    how: str,
    ask: dict[str, Any],
    seed: int,
    campaign: Campaign,
    model: Model,
    drawn: Draws | None = None,
    shown: bool = False,
    mended: Sequence[HeldOut] = (),
) -> dict[str, Any]:
    """drawn: posterior of the verdict's own parameters; shown: the end of the sensor's range is a reading; mended: what
    the terms of a repair do beside the best partial explanation."""
    naming, looks, facts = judged.naming, judged.looks, judged.facts
    verdict, p, physics = judged.ruling.verdict, judged.ruling.probability, judged.ruling.physics
    members = judged.ruling.members
    none = naming.none
    detected = none.scan.detected
    confidence = confidence_of(p[verdict], members)
    if verdict == UNKNOWN:
        confidence = min(confidence, most_for_unknown(naming.skipped))
    hypotheses = []
    for name in sorted(p, key=lambda k: -p[k]):
        entry: dict[str, Any] = {
            "name": name,
            "probability": p[name],
            **_evidence(naming, physics[name], judged.ruling.nats.get(name, 0.0)),
            "parameters": {},
        }
        if physics[name] in naming.weighed:
            entry["parameters"] = own_parameters(
                naming.labellings.get(physics[name], [naming.weighed[physics[name]].fit]),
                model,
                drawn if name == verdict else None,
            )
        for fact in facts:
            if fact.name in name.split("+"):
                entry["parameters"] |= fact.parameters
        if shown and "y_max_m" in entry["parameters"]:
            entry["parameters"]["y_max_m"].update(limit_as_shown(naming.weighed[physics[name]].fit))
        hypotheses.append(entry)
    corrected = _corrected(model, naming, verdict)
    fitted = naming.weighed.get(physics[verdict], naming.best.weighed).fit.problem.model
    out: dict[str, Any] = {
        "model": model.name,
        "campaign": campaign.name,
        "verdict": verdict,
        "confidence": confidence,
        "indistinguishable": members,
        "statement": "",
        "mismatch": {
            "detected": detected,
            "p_value": none.scan.p_value,
            "where": where(none.weighed.fit, none.scan, looks),
            "by": excess_by(none.weighed.fit, none.scan),
            "reduced_chi2": none.scan.reduced_chi2,
            "threshold": none.scan.threshold,
            "in_readings": False,
        },
        "hypotheses": hypotheses,
        "proof": proof_summary(proof, how),
        "next_experiment": ask,
        "corrected_model": corrected,
        "corrected_priors": _corrected_priors(corrected, fitted, campaign),
        "adequate": naming.best.adequate,
        "adequacy_p_value": naming.best.scan.p_value,
        "skipped": naming.skipped,
        "not_visible": sorted(n for n in naming.weighed if "+" not in n and n not in naming.visible),
        "seed": seed,
        "version": __version__,
        "conventions": dict(campaign.conventions),
        "inputs": campaign.inputs,
        "warnings": list(assembled.warnings),
    }
    if judged.mended is not None:
        out["repair"] = judged.mended
    if mended:
        whole = proof_summary(list(mended), how)
        out["proof"]["repair"] = {k: whole[k] for k in _OF_REPAIR if k in whole}
    out["next_command"] = calibrate_command(out, campaign_words(campaign))
    out["statement"] = statement(out, naming, physics[verdict], judged.ruling.delays_s)
    if silent(naming):
        note = silent_note(out)
        out["warnings"].insert(0, note)
        out["statement"] = f"{note[0].upper()}{note[1:]}."
    return out


def _evidence(naming: Naming, physics: str, nats: float) -> dict[str, float | None]:
    """Log evidence and its standard error; none of a name that the readings rule out by themselves."""
    value = naming.log_evidence.get(physics)
    if value is None or nats == -math.inf:
        return {"log_evidence": None, "log_evidence_se": None}
    return {"log_evidence": value + nats, "log_evidence_se": naming.log_evidence_se.get(physics)}


def _corrected(model: Model, naming: Naming, verdict: str) -> str:
    """SPEC of the repaired model; mains is part of every noise model and needs no name."""
    if verdict == UNKNOWN:
        return naming.best.weighed.fit.problem.model.name
    names = [n for n in verdict.split("+") if n not in (NONE, MAINS)]
    if not names:
        return model.name
    mended = extended(model, names, {})
    return mended.name if mended is not None else model.name


def _corrected_priors(corrected: str, fitted: Model, campaign: Campaign) -> dict[str, str]:
    """Priors that a corrected SPEC needs to be the model that was fitted: those that are not what its files say.

    Of laws of an effect beside its plain one, of what depends on the campaign (how far a sensor within its accuracy may
    drift), and of what the user said. fitted: the model that was; what the readings showed by themselves is not in it.
    """
    usual = build_model(corrected)
    known = {p.name: p.prior for p in fitted.parameters}
    given = effect_priors(usual.spec.effects, campaign)
    out = {}
    for p in usual.parameters:
        prior = known.get(p.name, given.get(p.name, p.prior))
        if prior != p.prior:
            out[p.name] = str(prior)
    return out


def say_odd(mismatch: dict[str, Any], odd: Rereading, campaign: Campaign) -> None:
    """Put a recording of another actuator, which was left out, into the "mismatch" of a summary."""
    _say_foreign(mismatch, campaign, Foreign(odd.odd, odd.ratio, odd.ratio_se), f"{ANOTHER}: left out")


def say_foreign(mismatch: dict[str, Any], foreign: Foreign, campaign: Campaign) -> None:
    """Put one to validate into it."""
    _say_foreign(mismatch, campaign, foreign, ANOTHER)


def _say_foreign(mismatch: dict[str, Any], campaign: Campaign, foreign: Foreign, what: str) -> None:
    excess = abs(foreign.ratio - 1.0) / max(foreign.se, 5e-4)
    _say_of_whole(mismatch, campaign, foreign.recording, what, math.erfc(excess / math.sqrt(2)), excess)


def say_uneven(mismatch: dict[str, Any], uneven: Uneven, campaign: Campaign) -> None:
    """Put a recording that scatters unlike others into the "mismatch" of a summary."""
    what = f"scatters more at rest than {uneven.calm}"
    _say_of_whole(mismatch, campaign, uneven.noisy, what, uneven.p_value, uneven.noisy_m / uneven.calm_m)


def say_swinging(mismatch: dict[str, Any], swings: Swinging, campaign: Campaign) -> None:
    """Put what swings at rest into the "mismatch" of a summary."""
    what = f"swings at {swings.frequency_Hz:.3g} Hz at rest"
    _say_of_whole(mismatch, campaign, swings.recording, what, swings.p_value, math.sqrt(swings.ratio))


def say_gains(mismatch: dict[str, Any], gains: Gains, campaign: Campaign) -> None:
    """Put recordings that have gains of their own into the "mismatch" of a summary: the two that differ most."""
    p_value = math.erfc(gains.sigmas / math.sqrt(2))
    for name in reversed(gains.widest):
        what = f"a gain of its own: {gains.ratio[name]:.3f} times the others'"
        excess = abs(gains.ratio[name] - 1.0) / max(gains.se[name], 1e-12)
        _say_of_whole(mismatch, campaign, name, what, p_value, excess)


def _say_of_whole(
    mismatch: dict[str, Any], campaign: Campaign, name: str, what: str, p_value: float, excess: float
) -> None:
    """Put what the readings of a whole recording show by themselves into the "mismatch" of a summary."""
    t = next(r for r in campaign.recordings if r.name == name).time_s
    mismatch["detected"] = mismatch["in_readings"] = True
    mismatch["p_value"] = min(mismatch["p_value"], max(p_value, 1e-300))
    row = {"recording": name, "t_start_s": float(t[0]), "t_end_s": float(t[-1]), "what": what,
           "excess": round(excess, 2)}  # fmt: skip
    mismatch["where"] = [row, *mismatch["where"]]


def say_clipped(mismatch: dict[str, Any], limit: Limit, pieces: tuple[Piece, ...]) -> None:
    """Put the readings at the end of the sensor's range into the "mismatch" of a summary."""
    rows = []
    for piece in pieces:
        at = np.flatnonzero(limit.at(piece)) if piece.channel == "displacement" else np.empty(0, dtype=int)
        if at.size:
            t = piece.recording.time_s
            rows.append(
                {
                    "recording": piece.name,
                    "t_start_s": float(t[at[0]]),
                    "t_end_s": float(t[at[-1]]),
                    "what": f"{at.size} readings at the end of the sensor's range",
                    "excess": round(math.sqrt(at.size), 2),
                }
            )
    mismatch["detected"] = mismatch["in_readings"] = True
    # each of them would have to be the highest value by chance, a half at most
    mismatch["p_value"] = max(min(mismatch["p_value"], 0.5 ** min(limit.readings, 900)), 1e-300)
    mismatch["where"] = [*rows, *mismatch["where"]]


def own_parameters(fits: Sequence[Fit], model: Model, drawn: Draws | None = None) -> dict[str, dict[str, Any]]:
    """Posterior of the parameters that effects add, in physical units: of draws, or from the Laplace approximation.

    fits: the maximum, and others of the same explanation that differ in which mode is called what; each counts by its
    evidence. "map" is of the likeliest.
    """
    known = set(model.priors.names)
    m = fits[0].problem.model
    share = np.exp(np.array([f.log_evidence for f in fits]) - max(f.log_evidence for f in fits))
    best = fits[int(np.argmax(share))]
    own = [i for i, p in enumerate(m.priors.free) if p.name not in known]
    out = {}
    for column, i in enumerate(own):
        parameter = m.priors.free[i]
        prior = parameter.prior
        if drawn is not None:
            x, weight = drawn[0][:, column], drawn[1]
        else:
            parts = [_normal(float(f.q[i]), math.sqrt(max(float(f.covariance[i, i]), 0.0)), prior) for f in fits]
            x = np.concatenate([p[0] for p in parts])
            weight = np.concatenate([w * p[1] for w, p in zip(share / share.sum(), parts, strict=True)])
        order = np.argsort(x, kind="stable")
        x, weight = x[order], weight[order]
        value = np.exp(np.clip(x, -300.0, 300.0)) if prior.is_log else x
        mean, centre = float(weight @ value), float(best.q[i])
        cdf = np.cumsum(weight) - 0.5 * weight
        q05, q50, q95 = (float(np.interp(p, cdf, value)) for p in (0.05, 0.5, 0.95))
        alone = drawn is None and len(fits) == 1
        spread = float(fits[0].covariance[i, i]) if alone else float(weight @ (x - float(weight @ x)) ** 2)
        prior_sd = prior.coordinate_sd()
        out[parameter.name] = {
            "mean": mean,
            "sd": math.sqrt(max(float(weight @ (value - mean) ** 2), 0.0)),
            "q05": q05,
            "q50": q50,
            "q95": q95,
            "unit": parameter.unit,
            "map": float(math.exp(centre) if prior.is_log else centre),
            "contraction": max(0.0, 1.0 - max(spread, 0.0) / prior_sd**2) if prior_sd > 0 else None,
        }
    return out


def _normal(centre: float, sd: float, prior: Prior) -> tuple[Array, Array]:
    """Places (161,) of a normal density and their weights, none outside what the prior allows."""
    u = np.linspace(-4, 4, 161)
    x, weight = centre + sd * u, np.exp(-0.5 * u**2)
    if prior.family in ("uniform", "loguniform"):
        low, high = (math.log(prior.a), math.log(prior.b)) if prior.is_log else (prior.a, prior.b)
        inside = np.where((x >= low) & (x <= high), weight, 0.0)
        weight = inside if inside.sum() > 0 else weight
    return x, weight / weight.sum()


def proof_summary(proof: list[HeldOut], how: str) -> dict[str, Any]:
    """The "proof" of diagnosis.json; force recordings stand apart because their unit is another."""
    out: dict[str, Any] = {"held_out": [], "how": how}
    for h in proof:
        unit = "m" if h.channel == "displacement" else "N"
        out["held_out"].append(
            {
                "recording": h.recording,
                "n": h.n,
                # there for every recording (CONTRACT 4), null where nothing is in metres
                "rmse_before_m": None,
                "rmse_after_m": None,
                f"rmse_before_{unit}": h.rmse_before,
                f"rmse_after_{unit}": h.rmse_after,
                f"noise_{unit}": h.noise,
                "elpd_before": h.elpd_before,
                "elpd_after": h.elpd_after,
            }
        )

    def pooled(values: list[tuple[int, float]]) -> float | None:
        total = sum(n * v * v for n, v in values)
        return math.sqrt(total / sum(n for n, _ in values)) if values and math.isfinite(total) else None

    for unit, channel in (("m", "displacement"), ("N", "force")):
        own = [h for h in proof if h.channel == channel]
        if own or unit == "m":
            out[f"rmse_before_{unit}"] = pooled([(h.n, h.rmse_before) for h in own])
            out[f"rmse_after_{unit}"] = pooled([(h.n, h.rmse_after) for h in own])
            out[f"noise_{unit}"] = pooled([(h.n, h.noise) for h in own])
    gains = np.array([h.elpd_after - h.elpd_before if h.answered else math.nan for h in proof])
    out["elpd_gain"] = float(gains.sum()) if gains.size else None
    out["elpd_gain_se"] = float(math.sqrt(gains.size) * gains.std(ddof=1)) if gains.size > 1 else None
    return out

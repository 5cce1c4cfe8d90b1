"""The road from a campaign to a verdict: fit, locate, name, prove, ask."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..assemble import Assembled, assemble
from ..campaign.schema import Campaign
from ..errors import InputError
from ..find_map import MapSettings, find_map
from ..fit.swarm import SwarmSettings
from ..models.effects import registered_effects
from ..models.model import Model, build_model
from .ask import next_experiment
from .confidence import calibrated
from .features import Features, features
from .locate import excess_by, where
from .name import MAINS, NONE, UNKNOWN, Explanation, Naming, name_physics
from .noise_prior import NoisePrior, noise_prior
from .problem import Problem
from .prove import HeldOut, held_out
from .reduced import reduce_campaign
from .refit import Fit, refit
from .unknown import repair
from .words import statement

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]
#: what is not coherent over one resolution step is not claimed where no resolution is stated
_RESOLUTION_M = 0.15e-6


@dataclass(frozen=True)
class DiagnosisSettings:
    """Effort of a diagnosis."""

    map: MapSettings = field(
        default_factory=lambda: MapSettings(
            swarms=3, swarm=SwarmSettings(particles=32, max_iterations=120, stall_iterations=15, tolerance=0.02)
        )
    )
    workers: int = 1
    most_effects: int = 3


@dataclass(frozen=True)
class Diagnosis:
    """A verdict with everything behind it; `summary` is diagnosis.json."""

    assembled: Assembled = field(repr=False)
    base: Fit = field(repr=False)
    corrected: Fit = field(repr=False)
    naming: Naming = field(repr=False)
    proof: list[HeldOut] = field(repr=False)
    looks: list[Features] = field(repr=False)
    summary: dict[str, Any]

    @property
    def verdict(self) -> str:
        """Name of the physics that was left out, none or unknown."""
        return str(self.summary["verdict"])


def diagnose(
    campaign: Campaign,
    model: Model | str,
    seed: int = 1,
    settings: DiagnosisSettings | None = None,
    report: Report | None = None,
    priors: Mapping[str, Any] | None = None,
) -> Diagnosis:
    """Find where a model and recordings differ, name the physics that was left out, and prove the repair.

    Recordings with role "validate" are touched by the proof alone. Raises InputError for input that cannot be
    diagnosed.
    """
    s = settings or DiagnosisSettings()
    say = report or (lambda *_: None)
    if isinstance(model, str):
        model = build_model(model, priors)
    began = time.perf_counter()
    laps: dict[str, float] = {}

    def lap(name: str) -> None:
        laps[name] = time.perf_counter() - began - sum(laps.values())

    r_map, r_name = np.random.default_rng(seed).spawn(2)
    say("reading noise", 0, 1, campaign.name)
    assembled = assemble(campaign, model, s.workers)
    lap("assemble")
    say("fitting", 0, 1, model.name)
    found, posterior = find_map(
        assembled.posterior,
        assembled.search_model,
        list(assembled.search_groups),
        r_map,
        s.map,
        assembled.refresh if assembled.has_blocks else None,
    )
    lap("map")
    pieces = reduce_campaign(assembled)
    prior = noise_prior(assembled)
    problem = Problem.of(assembled, model, [p for p in pieces if p.identify])
    zeros = posterior.zeros_part(found.x[None])
    q0 = np.concatenate(
        [posterior.model_part(found.x[None])[0], [float(v[0]) for v in zeros.values()], np.zeros(problem.gain_sd.size)]
    )
    base = refit(problem, q0, prior.start(), prior)
    if base is None:
        raise InputError(f"{model.name} has no answer on these recordings at its best fit; check the geometry")
    lap("reduce")
    looks = [features(p) for p in problem.pieces]
    resolution = _resolution(campaign)
    naming = name_physics(
        base,
        campaign,
        prior,
        looks,
        r_name,
        resolution_m=resolution,
        overrides=priors,
        report=say,
        most_effects=s.most_effects,
    )
    lap("name")
    verdict, raw = _verdict(naming, assembled, resolution)
    best = naming.best
    corrected = best.weighed.fit if verdict not in (NONE, MAINS) else base
    mended = None
    if verdict == UNKNOWN:
        mended = repair(best, looks)
    say("proving", 0, 1, "recordings kept for validation")
    proof, how = _proof(assembled, base, corrected, pieces, prior)
    lap("prove")
    say("asking", 0, 1, "the next experiment")
    members = _indistinguishable(naming, verdict, raw)
    ask = _ask(naming, members, campaign, base)
    lap("ask")
    summary = _summary(assembled, naming, verdict, raw, members, proof, how, ask, looks, mended, seed, campaign, model)
    lap("write")
    summary["seconds"] = time.perf_counter() - began
    summary["seconds_by"] = laps
    return Diagnosis(assembled, base, corrected, naming, proof, looks, summary)


def _resolution(campaign: Campaign) -> float:
    sensor = campaign.sensors.get("displacement")
    return sensor.resolution if sensor is not None and sensor.resolution else _RESOLUTION_M


def _mains(assembled: Assembled, resolution: float) -> float:
    """Largest amplitude of a mains line found on a displacement, in m; 0 where none exceeds the resolution."""
    found = [
        p.mains.amplitude
        for p in assembled.prepared
        if p.mains is not None and p.channel == "displacement" and p.recording.role == "identify"
    ]
    largest = max(found, default=0.0)
    return float(largest) if largest > resolution else 0.0


def _verdict(naming: Naming, assembled: Assembled, resolution: float) -> tuple[str, dict[str, float]]:
    """The likeliest name, and the probabilities with mains in its place."""
    p = dict(naming.probability)
    if _mains(assembled, resolution) > 0:
        # every hypothesis carries the line in its noise; by itself it is what was left out
        p[MAINS] = p.pop(NONE)
        p[NONE] = 0.0
    return max(p, key=lambda k: p[k]), p


def _indistinguishable(naming: Naming, verdict: str, p: dict[str, float]) -> list[str]:
    """The smallest set with 99 % of the probability, the verdict first."""
    order = [verdict, *sorted((k for k in p if k != verdict), key=lambda k: -p[k])]
    out, total = [], 0.0
    for name in order:
        out.append(name)
        total += p[name]
        if total >= 0.99:
            break
    return out


def _proof(
    assembled: Assembled, base: Fit, corrected: Fit, pieces: tuple[Any, ...], prior: Any
) -> tuple[list[HeldOut], str]:
    """Held-out scores on the recordings to validate, or leaving out those to identify in turn."""
    held = tuple(p for p in pieces if not p.identify)
    if held:
        return held_out(base, corrected, held), "validate"
    if len(base.problem.pieces) < 2:
        return [], "none"
    return leave_out_in_turn(base, corrected, prior), "left out in turn"


def leave_out_in_turn(base: Fit, corrected: Fit, prior: NoisePrior) -> list[HeldOut]:
    """Each fitted recording scored by refits that have not seen it."""
    out = []
    used = base.problem.pieces
    for piece in used:
        rest = tuple(p for p in used if p is not piece)
        fits = []
        for fit in (base, corrected):
            again = refit(replace(fit.problem, pieces=rest), fit.q, fit.noise, prior, max_steps=3, fit_noise=False)
            fits.append(again or fit)
        out += held_out(fits[0], fits[1], (piece,))
    return out


def _ask(naming: Naming, members: list[str], campaign: Campaign, base: Fit) -> dict[str, Any]:
    fits, names = [], []
    for name in members[:2]:
        fit = base if name in (NONE, MAINS) else naming.weighed[name].fit if name in naming.weighed else None
        if fit is not None:
            fits.append(fit)
            names.append(name)
    if len(fits) < 2:
        return {"why": "one explanation is left; more of the recordings at hand would sharpen it", "recording": {}}
    actuator = base.problem.pieces[0].recording.actuator
    return next_experiment(fits, names, actuator)


def _summary(
    assembled: Assembled,
    naming: Naming,
    verdict: str,
    p: dict[str, float],
    members: list[str],
    proof: list[HeldOut],
    how: str,
    ask: dict[str, Any],
    looks: list[Features],
    mended: dict[str, Any] | None,
    seed: int,
    campaign: Campaign,
    model: Model,
) -> dict[str, Any]:
    none = naming.none
    detected = none.scan.detected
    confidence = calibrated(p[verdict], verdict)
    hypotheses = []
    for name in sorted(p, key=lambda k: -p[k]):
        entry: dict[str, Any] = {
            "name": name,
            "probability": p[name],
            "log_evidence": naming.log_evidence.get(NONE if name == MAINS else name),
            "log_evidence_se": naming.log_evidence_se.get(NONE if name == MAINS else name),
            "parameters": {},
        }
        if name in naming.weighed:
            entry["parameters"] = own_parameters(naming.weighed[name].fit, model)
        hypotheses.append(entry)
    out: dict[str, Any] = {
        "model": model.name,
        "verdict": verdict,
        "confidence": confidence,
        "indistinguishable": members,
        "statement": "",
        "mismatch": {
            "detected": detected,
            "p_value": none.scan.p_value,
            "where": where(none.weighed.fit, none.scan, looks),
            "by": excess_by(none.weighed.fit, none.scan, looks),
            "reduced_chi2": none.scan.reduced_chi2,
            "threshold": none.scan.threshold,
        },
        "hypotheses": hypotheses,
        "proof": proof_summary(proof, how),
        "next_experiment": ask,
        "corrected_model": naming.best.weighed.fit.problem.model.name if verdict not in (NONE, MAINS) else model.name,
        "adequate": naming.best.adequate,
        "adequacy_p_value": naming.best.scan.p_value,
        "skipped": naming.skipped,
        "seed": seed,
        "version": __version__,
        "inputs": campaign.inputs,
        "warnings": list(assembled.warnings),
    }
    if mended is not None:
        out["repair"] = mended
    if how != "validate":
        out["warnings"].append(
            'no recording has role "validate": the proof was made by leaving out recordings in turn'
            if proof
            else "there is one recording only: nothing is left to prove the verdict on; record a second one"
        )
    out["statement"] = statement(out, naming, assembled)
    return out


def own_parameters(fit: Fit, model: Model) -> dict[str, dict[str, Any]]:
    """Posterior of the parameters that effects add, in physical units, from the Laplace approximation."""
    known = set(model.priors.names)
    m = fit.problem.model
    cov = fit.covariance
    out = {}
    for i, parameter in enumerate(m.priors.free):
        if parameter.name in known:
            continue
        centre, sd = float(fit.q[i]), math.sqrt(max(float(cov[i, i]), 0.0))
        x = centre + sd * np.linspace(-4, 4, 161)
        weight = np.exp(-0.5 * np.linspace(-4, 4, 161) ** 2)
        prior = parameter.prior
        if prior.family in ("uniform", "loguniform"):
            low, high = (math.log(prior.a), math.log(prior.b)) if prior.is_log else (prior.a, prior.b)
            weight = np.where((x >= low) & (x <= high), weight, 0.0)
        if weight.sum() <= 0:
            weight = np.ones_like(weight)
        weight = weight / weight.sum()
        value = np.exp(np.clip(x, -300.0, 300.0)) if prior.is_log else x
        mean = float(weight @ value)
        cdf = np.cumsum(weight) - 0.5 * weight
        q05, q50, q95 = (float(np.interp(p, cdf, value)) for p in (0.05, 0.5, 0.95))
        prior_sd = prior.coordinate_sd()
        out[parameter.name] = {
            "mean": mean,
            "sd": math.sqrt(max(float(weight @ (value - mean) ** 2), 0.0)),
            "q05": q05,
            "q50": q50,
            "q95": q95,
            "unit": parameter.unit,
            "map": float(math.exp(centre) if prior.is_log else centre),
            "contraction": max(0.0, 1.0 - (sd / prior_sd) ** 2) if prior_sd > 0 else None,
        }
    return out


def proof_summary(proof: list[HeldOut], how: str) -> dict[str, Any]:
    """The "proof" of diagnosis.json; force recordings stand apart because their unit is another."""
    move = [h for h in proof if h.channel == "displacement"]
    out: dict[str, Any] = {"held_out": [], "how": how}
    for h in proof:
        unit = "m" if h.channel == "displacement" else "N"
        out["held_out"].append(
            {
                "recording": h.recording,
                "n": h.n,
                f"rmse_before_{unit}": h.rmse_before,
                f"rmse_after_{unit}": h.rmse_after,
                f"noise_{unit}": h.noise,
                "elpd_before": h.elpd_before,
                "elpd_after": h.elpd_after,
            }
        )

    def pooled(values: list[tuple[int, float]]) -> float | None:
        total = sum(n for n, _ in values)
        return math.sqrt(sum(n * v * v for n, v in values) / total) if total else None

    out["rmse_before_m"] = pooled([(h.n, h.rmse_before) for h in move])
    out["rmse_after_m"] = pooled([(h.n, h.rmse_after) for h in move])
    out["noise_m"] = pooled([(h.n, h.noise) for h in move])
    gains = np.array([h.elpd_after - h.elpd_before for h in proof])
    out["elpd_gain"] = float(gains.sum()) if gains.size else None
    out["elpd_gain_se"] = float(math.sqrt(gains.size) * gains.std(ddof=1)) if gains.size > 1 else None
    return out


__all__ = ["Diagnosis", "DiagnosisSettings", "Explanation", "diagnose", "registered_effects"]

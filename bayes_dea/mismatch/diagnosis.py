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
from .ask import first_experiment, next_experiment
from .clipped import Limit, below, cut_out, expectations, lost_m, restored, sensor_limit
from .confidence import calibrated
from .features import Features, features
from .locate import excess_by, scan, where
from .mains import mains_probability
from .name import ADEQUATE, MAINS, NONE, UNKNOWN, Explanation, Naming, extended, name_physics, prior_odds
from .noise_prior import NoisePrior, noise_prior
from .outliers import false_reading_warning, false_readings, without
from .problem import Problem
from .prove import HeldOut, held_out
from .reduced import Piece, reduce_campaign
from .refit import Fit, refit
from .reread import Rereading, held_out_gains, hold_note, odd_note, odd_one_out, other_holds, stated_hold, with_hold
from .timing import as_timing, sample_step_s, timing_note
from .unknown import repair
from .weigh import Screened
from .words import silent_note, statement

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]
#: what is not coherent over one resolution step is not claimed where no resolution is stated
_RESOLUTION_M = 0.15e-6
#: how often a fit is made again because it showed false readings
_ROUNDS = 3
#: nats by which another hold convention must be ahead to be taken before effects are weighed
_BY_FAR = 100.0
#: recordings that would show less than this share of the effects, however strong, tell nothing
_SILENT = 0.25


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
    limit = sensor_limit(campaign)
    assembled = assemble(campaign if limit is None else cut_out(campaign, limit), model, s.workers)
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
    seen = _Seen(base, pieces, prior)
    if limit is not None:
        seen.keep_below(limit)
    for _ in range(_ROUNDS):
        base = seen.base
        if not seen.spoiled(base):
            break
        seen.base = refit(seen.base.problem, base.q, base.noise, prior) or base
    lap("reduce")
    resolution = _resolution(campaign)

    def named() -> Naming:
        memory: dict[str, Screened] = {}
        for last in range(_ROUNDS, -1, -1):
            base = seen.base
            found = name_physics(
                base,
                campaign,
                prior,
                [features(p) for p in base.problem.pieces],
                r_name,
                resolution_m=resolution,
                overrides=priors,
                report=say,
                most_effects=s.most_effects,
                spoiled=seen.spoiled if last else None,
                established=("sensor_clipping",) if limit is not None else (),
                memory=memory,
            )
            if found is not None:
                break
            seen.base = refit(seen.base.problem, base.q, base.noise, prior) or base
        assert found is not None
        return found

    retimed = _retimed(seen.base, prior, r_name)
    if retimed is not None:
        seen.take(retimed)
    naming = named()
    reread = _reread(naming, prior, r_name)
    if reread is not None:
        say("reading the campaign again", 0, 1, reread.odd or f"hold = {reread.hold}")
        seen.take(reread)
        naming = named()
    base = naming.none.weighed.fit
    looks = [features(p) for p in base.problem.pieces]
    lap("name")
    best = naming.best
    facts = _facts(best.weighed.fit, seen.pieces, limit, resolution)
    step = sample_step_s(base)
    verdict, raw, physics, delays = _verdict(naming, facts, step)
    corrected = best.weighed.fit if physics[verdict] != NONE else base
    mended = None
    if verdict == UNKNOWN:
        mended = repair(best, looks)
    say("proving", 0, 1, "recordings kept for validation")
    seen.spoiled(corrected, identify=False)
    clip = limit.value_m if limit is not None and "sensor_clipping" in verdict.split("+") else math.inf
    scored = seen.pieces
    if limit is not None:
        whole = {p.name: p for p in restored([p for p in scored if not p.identify], campaign, limit)}
        scored = tuple(whole.get(p.name, p) for p in scored)
    proof, how = _proof(base, corrected, scored, prior, clip)
    lap("prove")
    say("asking", 0, 1, "the next experiment")
    members = _indistinguishable(verdict, raw)
    ask = _ask(naming, [physics[m] for m in members], base)
    if _silent(naming) and any(p.channel == "displacement" for p in base.problem.pieces):
        ask = first_experiment(base, base.problem.pieces[0].recording.actuator)
    lap("ask")
    notes = [*seen.notes]
    if verdict in delays:
        notes.append(timing_note(delays[verdict], step))
    if verdict != UNKNOWN:
        notes += held_out_gains(corrected, tuple(p for p in scored if not p.identify))
    assembled = replace(assembled, warnings=(*notes, *assembled.warnings, *seen.warnings.values()))
    summary = _summary(
        assembled, naming, verdict, raw, physics, facts, members, proof, how, ask, looks, mended, seed, campaign, model
    )
    # file names keep their letters
    summary["statement"] = " ".join([*(f"{n}." for n in notes), summary["statement"]])
    if seen.odd is not None:
        _say_odd(summary["mismatch"], seen.odd, campaign)
    if clip < math.inf and limit is not None:
        _say_where(summary["mismatch"], limit, restored(pieces, campaign, limit))
    lap("write")
    summary["seconds"] = time.perf_counter() - began
    summary["seconds_by"] = laps
    return Diagnosis(assembled, base, corrected, naming, proof, looks, summary)


def _resolution(campaign: Campaign) -> float:
    sensor = campaign.sensors.get("displacement")
    return sensor.resolution if sensor is not None and sensor.resolution else _RESOLUTION_M


@dataclass(frozen=True)
class Fact:
    """An effect that the readings show by themselves, whatever the physics: its probability and its parameters."""

    name: str
    probability: float
    parameters: dict[str, dict[str, Any]]


def _facts(fit: Fit, pieces: tuple[Piece, ...], limit: Limit | None, resolution: float) -> list[Fact]:
    out = [Fact(MAINS, mains_probability(fit, resolution), {})]
    if limit is not None:
        lost = lost_m(expectations(fit, pieces), pieces, limit)
        value, sd = limit.value_m, limit.sd_m
        spread = {"mean": value, "sd": sd, "q05": value - 1.5588 * sd, "q50": value, "q95": value + 1.5588 * sd}
        own = {"y_max_m": {**spread, "unit": "m", "map": value, "contraction": 1.0}}
        out.append(Fact("sensor_clipping", 1.0 if lost >= resolution else 0.0, own))
    return [f for f in out if f.probability > 0]


def _verdict(
    naming: Naming, facts: list[Fact], step_s: float
) -> tuple[str, dict[str, float], dict[str, str], dict[str, float]]:
    """The likeliest name, the probabilities with what is established joined on, the physics behind each name.

    And the shift in s, below one sample, that a name carries unsaid.
    """
    shift = as_timing(_as_before(naming) if _silent(naming) else naming.probability, naming, step_s)
    p, physics, delays = shift.probability, shift.physics, shift.delays_s
    for fact in facts:
        # every hypothesis carries it in its noise or its masks; with "none" it is by itself what was left out
        for name in list(p):
            if name == UNKNOWN:
                continue
            joined = _joined(name, fact.name)
            p[joined], p[name] = p[name] * fact.probability, p[name] * (1.0 - fact.probability)
            physics[joined] = physics[name]
            if name in delays:
                delays[joined] = delays[name]
    p = {k: v for k, v in p.items() if v > 0 or k in naming.probability}
    return max(p, key=lambda k: p[k]), p, physics, delays


def _joined(name: str, more: str) -> str:
    """Names of effects in the order of their stages."""
    order = list(registered_effects())
    return "+".join(sorted({*(name.split("+") if name != NONE else []), more}, key=order.index))


def _retimed(base: Fit, prior: NoisePrior, rng: np.random.Generator) -> Rereading | None:
    """Another hold convention that leaves nothing to explain by far: no effect has to be weighed to see that."""
    if scan(base, rng).p_value > ADEQUATE:
        return None
    found = [r for r in other_holds(base, prior, rng) if r.base.log_evidence > base.log_evidence + _BY_FAR]
    return max(found, key=lambda r: r.log_weight) if found else None


def _reread(naming: Naming, prior: NoisePrior, rng: np.random.Generator) -> Rereading | None:
    """Another reading of the campaign that is likelier than every named effect and than "unknown"; None without one."""
    if naming.none.adequate:
        return None
    found = [*other_holds(naming.none.weighed.fit, prior, rng), *odd_one_out(naming.none.weighed.fit, prior, rng)]
    if not naming.best.adequate and naming.best is not naming.none:
        found += odd_one_out(naming.best.weighed.fit, prior, rng)
    if not found:
        return None
    top = max(found, key=lambda r: r.log_weight)
    # "unknown" takes what nothing else explains; another reading does
    rival = max(v for k, v in naming.log_weight.items() if k != UNKNOWN)
    return top if top.log_weight > rival or not naming.best.adequate else None


class _Seen:
    """The base fit and the pieces, false readings masked as fits make them visible."""

    def __init__(self, base: Fit, pieces: tuple[Piece, ...], prior: NoisePrior) -> None:
        self.base, self.pieces, self.prior = base, pieces, prior
        self.warnings: dict[str, str] = {}
        self.notes: list[str] = []
        self.odd: Rereading | None = None
        self._rows: dict[str, NDArray[np.bool_]] = {}

    def take(self, r: Rereading) -> None:
        """Go on with another reading of the campaign."""
        if r.hold:
            self.notes.append(hold_note(r.hold, stated_hold(self.pieces)))
            self.pieces = tuple(with_hold(p, r.hold) for p in self.pieces)
        else:
            self.odd = r
            self.notes.append(odd_note(r))
            self.pieces = tuple(p for p in self.pieces if p.name != r.odd)
        by_name = {p.name: p for p in self.pieces}
        used = tuple(by_name[p.name] for p in self.base.problem.pieces if p.name in by_name)
        plain = self.base.problem.model
        moved = replace(self.base, problem=replace(self.base.problem, pieces=used))
        if r.base.problem.model.name == plain.name:
            moved = replace(r.base, problem=replace(r.base.problem, pieces=used))
        self.base = refit(moved.problem, moved.q, moved.noise, self.prior) or moved

    def keep_below(self, limit: Limit) -> None:
        """Leave out the rows whose expected reading the end of the sensor's range reaches."""
        for _ in range(2):
            masked = {p.name: p for p in below([p for p in self.pieces if p.identify], limit, self.base)}
            self.pieces = tuple(masked.get(p.name, p) for p in self.pieces)
            problem = replace(self.base.problem, pieces=tuple(masked[p.name] for p in self.base.problem.pieces))
            self.base = refit(problem, self.base.q, self.base.noise, self.prior) or self.base

    def spoiled(self, fit: Fit, identify: bool = True) -> bool:
        """Whether a fit shows false readings; they are masked then."""
        rows = false_readings(fit, [p for p in self.pieces if p.identify == identify])
        if not rows:
            return False
        self.pieces = without(self.pieces, rows)
        for name, found in rows.items():
            self._rows[name] = self._rows.get(name, np.zeros_like(found)) | found
        by_name = {p.name: p for p in self.pieces}
        self.warnings = {n: false_reading_warning(by_name[n], r) for n, r in self._rows.items()}
        used = tuple(by_name[p.name] for p in self.base.problem.pieces)
        self.base = replace(self.base, problem=replace(self.base.problem, pieces=used))
        return True


def _indistinguishable(verdict: str, p: dict[str, float]) -> list[str]:
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
    base: Fit, corrected: Fit, pieces: tuple[Piece, ...], prior: NoisePrior, limit_m: float = math.inf
) -> tuple[list[HeldOut], str]:
    """Held-out scores on the recordings to validate, or leaving out those to identify in turn."""
    held = tuple(p for p in pieces if not p.identify)
    if held:
        return held_out(base, corrected, held, limit_m), "validate"
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


def _silent(naming: Naming) -> bool:
    """Whether these recordings would show hardly any effect even where it is strong."""
    screened = len(naming.weighed)
    return screened > 0 and len(naming.visible) < _SILENT * screened


def _as_before(naming: Naming) -> dict[str, float]:
    """Probabilities where what these recordings could not show at any strength is as probable as it was before."""
    odds = prior_odds()
    singles = [n for n in naming.weighed if "+" not in n]
    p = {NONE: odds["none"], UNKNOWN: odds["unknown"], **{n: odds["single"] / len(singles) for n in singles}}
    for name in naming.visible:
        p[name] = naming.probability.get(name, 0.0)
    total = sum(p.values())
    return {k: v / total for k, v in p.items()}


def _ask(naming: Naming, members: list[str], base: Fit) -> dict[str, Any]:
    fits, names = [], []
    for name in list(dict.fromkeys(members))[:2]:
        fit = base if name == NONE else naming.weighed[name].fit if name in naming.weighed else None
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
    physics: dict[str, str],
    facts: list[Fact],
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
    confidence = calibrated(p[verdict])
    hypotheses = []
    for name in sorted(p, key=lambda k: -p[k]):
        entry: dict[str, Any] = {
            "name": name,
            "probability": p[name],
            "log_evidence": naming.log_evidence.get(physics[name]),
            "log_evidence_se": naming.log_evidence_se.get(physics[name]),
            "parameters": {},
        }
        if physics[name] in naming.weighed:
            entry["parameters"] = own_parameters(naming.weighed[physics[name]].fit, model)
        for fact in facts:
            if fact.name in name.split("+"):
                entry["parameters"] |= fact.parameters
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
        "corrected_model": _corrected(model, naming, verdict, physics),
        "adequate": naming.best.adequate,
        "adequacy_p_value": naming.best.scan.p_value,
        "skipped": naming.skipped,
        "not_visible": sorted(n for n in naming.weighed if "+" not in n and n not in naming.visible),
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
    out["statement"] = statement(out, naming, assembled, physics[verdict])
    if _silent(naming):
        note = silent_note(out)
        out["warnings"].insert(0, note)
        out["statement"] = f"{note[0].upper()}{note[1:]}."
    return out


def _corrected(model: Model, naming: Naming, verdict: str, physics: dict[str, str]) -> str:
    """SPEC of the repaired model; mains is part of every noise model and needs no name."""
    if verdict == UNKNOWN:
        return naming.best.weighed.fit.problem.model.name
    names = [n for n in verdict.split("+") if n not in (NONE, MAINS)]
    if not names:
        return model.name
    mended = extended(model, names, {})
    return mended.name if mended is not None else model.name


def _say_odd(mismatch: dict[str, Any], odd: Rereading, campaign: Campaign) -> None:
    """Put a recording of another actuator into the "mismatch" of a summary."""
    t = next(r for r in campaign.recordings if r.name == odd.odd).time_s
    excess = abs(odd.ratio - 1.0) / max(odd.ratio_se, 5e-4)
    mismatch["detected"] = True
    mismatch["p_value"] = min(mismatch["p_value"], max(math.erfc(excess / math.sqrt(2)), 1e-300))
    what = "of another actuator: left out"
    row = {"recording": odd.odd, "t_start_s": float(t[0]), "t_end_s": float(t[-1]), "what": what,
           "excess": round(excess, 2)}  # fmt: skip
    mismatch["where"] = [row, *mismatch["where"]]


def _say_where(mismatch: dict[str, Any], limit: Limit, pieces: tuple[Piece, ...]) -> None:
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
    mismatch["detected"] = True
    # each of them would have to be the highest value by chance, a half at most
    mismatch["p_value"] = max(min(mismatch["p_value"], 0.5 ** min(limit.readings, 900)), 1e-300)
    mismatch["where"] = [*rows, *mismatch["where"]]


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

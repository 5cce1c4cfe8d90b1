"""From a campaign to proposals: what is believed, the menu scored, settings refined, a plan, the result."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..campaign.schema import MECHANICAL_KINDS, VOLTAGE_KINDS, Campaign
from ..errors import InputError
from ..experiments.costs import Costs
from ..experiments.limits import Limits, limits_of, offered_of, refuse_unreal
from ..experiments.menu import menu
from ..models.model import build_model
from ..prediction.calibrated import open_calibration
from ..priors import Parameter, Prior
from ..run_state import Checkpoints
from .belief import Belief, of_calibration, of_posterior
from .hypotheses import FitSettings, fitted_beliefs
from .questions import LARGEST_MISFIT, ROUGH, OfHypotheses, OfParameters, Question
from .rank import Proposal, plan, ranked, with_refined
from .sources import PURPOSES, Named, from_comparison, from_diagnosis, source_file
from .words import statement, why_hypotheses, why_parameters

Report = Callable[[str, float, float, str], None]
#: rest limit where no resolution is stated: that of the reference paper's sensor
_RESOLUTION_M = 0.15e-6
#: share of what is open that an experiment has to tell, or it is said that none does
_LITTLE = 0.15
#: standard error in nats below which none is stated: where every outcome tells all that is open, simulated ones agree
#: to the last digit, and what predicts them is an approximation all the same
_LEAST_SE = 0.005


@dataclass(frozen=True)
class ProposalSettings:
    """workers: threads; plan: experiments in a row; files: proposals that get a command file; refine: patterns whose
    settings are refined, with so many evaluations each; draws: of each posterior that is fitted here.
    max_voltage_V, max_frequency_Hz: limits of the user's own."""

    workers: int = 1
    plan: int = 1
    files: int = 10
    refine: int = 4
    evaluations: int = 24
    draws: int = 3000
    max_voltage_V: float | None = None
    max_frequency_Hz: float | None = None
    costs: Costs = Costs()


@dataclass(frozen=True)
class Proposals:
    """What was found. `summary` is next.json; `ranking` and `plan` the experiments themselves, best first."""

    summary: dict[str, Any] = field(repr=False)
    ranking: tuple[Proposal, ...] = field(repr=False)
    plan: tuple[Proposal, ...] = field(repr=False)
    costs: Costs = Costs()
    pictures: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def best(self) -> dict[str, Any]:
        """The first entry of the ranking."""
        out: dict[str, Any] = self.summary["ranking"][0]
        return out

    def save(self, out: str | Path, report: bool = True) -> Path:
        """Write next.json, the folder next/ with command files, and report.html into a folder; returns it."""
        from .store import save_proposals

        return save_proposals(self, Path(out), report)


def propose(
    campaign: Campaign,
    purpose: str = "parameters",
    model: str | None = None,
    models: str | Sequence[str] | None = None,
    source: str | Path | None = None,
    seed: int = 1,
    settings: ProposalSettings | None = None,
    priors: Mapping[str, Parameter | Prior] | None = None,
    report: Report | None = None,
    checkpoints: str | Path | Checkpoints | None = None,
    anew: bool = False,
) -> Proposals:
    """Rank the experiments that a bench could do next by what they are expected to teach per hour of bench time.

    purpose: "parameters" (of `model`), "models" (which of `models` is right) or "diagnosis" (which of the explanations
    that a diagnosis of `model` left). source: the folder of an earlier calibrate, compare or diagnose on this campaign;
    without it the campaign is fitted here. checkpoints: folder where finished fits are kept, so that a run that was
    interrupted goes on to the same numbers; anew: do not go on.
    Raises InputError for what cannot be asked of this campaign.
    """
    s = settings or ProposalSettings()
    say = report or (lambda *_: None)
    check_request(purpose, model, models, source, s)
    began = time.perf_counter()
    laps: dict[str, float] = {}

    def lap(name: str) -> None:
        laps[name] = time.perf_counter() - began - sum(laps.values())

    say("reading what is known", 0, 1, campaign.name)
    beliefs, named, warnings = _known(campaign, purpose, model, models, source, seed, s, priors, say, checkpoints, anew)
    lap("fit")
    boxes = {b.name: b.model.is_black_box for b in beliefs}
    limits = limits_of(campaign, boxes, s.max_voltage_V, s.max_frequency_Hz)
    limits = _only_seen(limits, beliefs, campaign.name)
    question: Question
    if purpose == "parameters":
        question = OfParameters.of(beliefs[0], seed)
    else:
        question = OfHypotheses.of(beliefs, named.probability, seed)
    resolution = _resolution(campaign)
    experiments = menu(limits)
    ranking = ranked(question, experiments, s.costs, resolution, lambda *at: say("scoring the menu", *at))
    lap("menu")
    ranking = with_refined(question, ranking, s.costs, resolution, s.refine, s.evaluations,
                           lambda *at: say("refining settings", *at))
    lap("refine")
    chosen = plan(question, ranking, s.costs, resolution, s.plan, s.evaluations, lambda *at: say("planning", *at))
    lap("plan")
    summary = _summary(campaign, purpose, question, beliefs, named, limits, ranking, chosen, s, seed,
                       [*limits.notes, *warnings])
    summary["seconds"] = time.perf_counter() - began
    summary["seconds_by"] = laps
    return Proposals(summary, tuple(ranking), tuple(chosen), s.costs)


def check_request(
    purpose: str, model: str | None, models: str | Sequence[str] | None, source: str | Path | None,
    s: ProposalSettings,
) -> None:
    """Raise InputError for options that do not go together, names that are unknown, limits that are
    none, or an earlier run that is not there."""
    if purpose not in PURPOSES:
        raise InputError(f"--for {purpose} is unknown; one of {', '.join(PURPOSES)}")
    if purpose == "models":
        if models is None and source is None:
            raise InputError("--for models: name the structures with --models SPEC,SPEC,..., or give the folder of a "
                             "comparison with --from DIR")
        if model is not None:
            raise InputError("--for models takes --models SPEC,SPEC,..., not --model")
    else:
        if models is not None:
            raise InputError(f"--for {purpose} takes --model SPEC, not --models")
        if model is None and source is None:
            raise InputError(f"--for {purpose}: name the structure with --model SPEC, or give the folder of an earlier "
                             f"{'calibration' if purpose == 'parameters' else 'diagnosis'} with --from DIR")
    if model is not None:
        build_model(model)
    if models is not None:
        from ..comparison.names import expand

        if len(expand(models)) < 2:
            raise InputError("--models: name two structures or more; with one there is nothing to tell apart")
    if not 1 <= s.plan <= 20:
        raise InputError(f"--plan {s.plan}: give a number of experiments from 1 to 20")
    refuse_unreal(s.max_voltage_V, "--max-voltage", "V")
    refuse_unreal(s.max_frequency_Hz, "--max-frequency", "Hz")
    if source is not None:
        source_file(Path(source), purpose)


def _known(
    campaign: Campaign, purpose: str, model: str | None, models: str | Sequence[str] | None, source: str | Path | None,
    seed: int, s: ProposalSettings, priors: Mapping[str, Parameter | Prior] | None, say: Report,
    checkpoints: str | Path | Checkpoints | None, anew: bool,
) -> tuple[list[Belief], Named, list[str]]:
    """Beliefs of the models in question, their probabilities, and warnings."""
    fit = FitSettings(s.workers, s.draws)
    tell = lambda *at: say("fitting", *at)  # noqa: E731
    rng = np.random.default_rng([seed, 11])
    if purpose == "parameters" and source is not None:
        calibrated = open_calibration(source)
        name = calibrated.structure.model.name
        if model is not None and build_model(model).name != name:
            raise InputError(f"--model {model}: {source} calibrated {name}; leave --model out, or calibrate that one")
        notes = same_recordings(calibrated.summary, campaign, str(source))
        if not calibrated.converged:
            notes.append(f"{source}: the sampler had not converged; what is expected of experiments is as rough")
        return [of_calibration(calibrated, campaign, rng)], Named((name,), (1.0,)), notes
    if purpose == "parameters":
        assert model is not None
        built = build_model(model, priors)
        beliefs, notes_ = fitted_beliefs(campaign, {built.name: built}, seed, fit, tell, checkpoints, anew)
        return beliefs, Named((built.name,), (1.0,)), list(notes_)
    if purpose == "models" and source is None:
        return _compared(campaign, models, seed, s, priors, say, checkpoints, anew)
    if purpose == "models":
        assert source is not None
        named, summary = from_comparison(Path(source), models)
    elif source is not None:
        named, summary = from_diagnosis(Path(source), model)
    else:
        named, summary = _diagnosed(campaign, model, seed, s, priors, say)
    notes = [*named.notes]
    if source is not None:
        notes += same_recordings(summary, campaign, str(source))
    built_all = {n: build_model(spec, _concerned(priors, spec))
                 for n, spec in zip(named.names, named.specs or named.names, strict=True)}
    beliefs, notes_ = fitted_beliefs(campaign, built_all, seed, fit, tell, checkpoints, anew)
    return beliefs, named, [*notes, *notes_]


def _concerned(
    priors: Mapping[str, Parameter | Prior] | None, spec: str
) -> dict[str, Parameter | Prior]:
    known = {p.name for p in build_model(spec).parameters}
    return {k: v for k, v in (priors or {}).items() if k in known}


def _compared(
    campaign: Campaign, models: str | Sequence[str] | None, seed: int, s: ProposalSettings,
    priors: Mapping[str, Parameter | Prior] | None, say: Report, checkpoints: str | Path | Checkpoints | None,
    anew: bool,
) -> tuple[list[Belief], Named, list[str]]:
    """The structures compared here; those that hold the probability are the hypotheses."""
    from ..comparison.run import ComparisonSettings, compare
    from .sources import leading

    assert models is not None
    result = compare(campaign, models, seed, ComparisonSettings(workers=s.workers), priors, say, checkpoints, anew)
    same = result.summary["equivalent"]
    if len(result.summary["ranking"]) < 2 and same:
        raise InputError(f"{' and '.join(same[0])} are one and the same function by other names: no experiment tells "
                         "them apart; name another structure with --models")
    named = leading([(e["model"], e["probability"]) for e in result.summary["ranking"] if e["model"] in result.done])
    rng = np.random.default_rng([seed, 12])
    beliefs = []
    for name in named.names:
        d = result.done[name]
        beliefs.append(of_posterior(d.fit.posterior, d.whole.draws[: s.draws], campaign, rng, name))
    return beliefs, named, [*named.notes, *result.summary["warnings"]]


def _diagnosed(
    campaign: Campaign, model: str | None, seed: int, s: ProposalSettings,
    priors: Mapping[str, Parameter | Prior] | None, say: Report,
) -> tuple[Named, Mapping[str, Any]]:
    from ..mismatch.diagnosis import DiagnosisSettings, diagnose
    from .sources import of_diagnosis

    assert model is not None
    result = diagnose(campaign, build_model(model), seed, DiagnosisSettings(workers=s.workers), say, priors)
    return of_diagnosis(result.summary), result.summary


def same_recordings(summary: Mapping[str, Any], campaign: Campaign, where: str) -> list[str]:
    """A warning where an earlier result came from other files than the campaign's."""
    before = {i.get("sha256") for i in summary.get("inputs", []) if str(i.get("file", "")).split(".")[-1] != "toml"}
    now = {i["sha256"] for i in campaign.inputs if str(i["file"]).split(".")[-1] != "toml"}
    if before and now and before != now:
        return [f"{where} was worked out from other recordings than those of {campaign.name}: what is expected counts "
                "from what it knew"]
    return []


def _only_seen(limits: Limits, beliefs: Sequence[Belief], where: str) -> Limits:
    """Without kinds in which a channel answers that nothing is stated of."""
    refused = list(limits.refused)
    for channel, unit, kinds in (("displacement", "m", VOLTAGE_KINDS), ("force", "N", MECHANICAL_KINDS)):
        if not all(channel in b.noise for b in beliefs):
            refused += [(k, f"[sensor.{channel}] states no fluctuation_{unit}") for k in kinds if k in limits.offered]
    return replace(limits, offered=offered_of(where, refused), refused=tuple(refused))


def _resolution(campaign: Campaign) -> float:
    sensor = campaign.sensors.get("displacement")
    return sensor.resolution if sensor is not None and sensor.resolution else _RESOLUTION_M


def _summary(
    campaign: Campaign, purpose: str, question: Question, beliefs: Sequence[Belief], named: Named, limits: Limits,
    ranking: list[Proposal], chosen: list[Proposal], s: ProposalSettings, seed: int, warnings: list[str],
) -> dict[str, Any]:
    names = list(named.names)
    entries = [_entry(question, p, names) for p in ranking]
    later: list[dict[str, Any]] = []
    now = question
    for p in chosen:
        later.append(_entry(now, p, names))
        now = now.after(p.answer)
    with_files(ranking, chosen, entries, later, s.files)
    out: dict[str, Any] = {
        "for": purpose,
        **({"model": names[0]} if purpose == "parameters" else {"models": names}),
        "ranking": entries,
        "statement": "",
        "ranked_by": "nats an hour of bench time" + (
            f", those first that tell at least {100 * question.least_share:.0f} % of what one experiment of the menu "
            "can tell" if question.least_share > 0 else ""),
        "plan": {
            "experiments": later,
            "expected_information_gain_nats": float(sum(p.answer.nats for p in chosen)),
            "cost_s": float(sum(p.cost_s for p in chosen)),
        },
        "not_offered": [{"kind": k, "why": why} for k, why in limits.refused],
        "limits": {"max_voltage_V": limits.voltage_V if "voltage" in limits.offered else None,
                   "max_frequency_Hz": limits.frequency_Hz, "max_stroke_m": limits.stroke_m,
                   "sampling_Hz": limits.voltage_rate_Hz, "sampling_plates_Hz": limits.plate_rate_Hz},
        "costs": asdict(s.costs),
        "seed": seed,
        "version": __version__,
        "conventions": dict(campaign.conventions),
        "inputs": [dict(i) for i in campaign.inputs],
        "warnings": [],
    }
    if isinstance(question, OfParameters):
        ranges = question.range_after(ranking[0].answer.known)
        rough = rough_widths(question.intervals_after(ranking[0].answer.known), ranges)
        out["intervals_after"] = {
            "first": question.intervals_after(ranking[0].answer.known), "plan": _after_plan(question, chosen),
            "first_range": {name: list(r) for name, r in ranges.items()}, "rough": rough,
        }
        if rough:
            warnings = [*warnings, f"the interval that is expected of {', '.join(rough)} is rough: what is known now "
                                   "is far from a normal distribution (little was recorded yet), and the width "
                                   "depends on where in it the truth lies, see first_range. Run next again after the "
                                   "first experiment"]
        subject = f"the parameters of {names[0]}"
        bent = [e for e in entries[:20] if e["misfit"] > LARGEST_MISFIT]
        if bent:
            warnings = [*warnings, f"{len(bent)} of the first 20 experiments answer in a way that is far from "
                                   "quadratic in the parameters: what is expected of them is rough"]
    else:
        out["probabilities"] = dict(zip(names, (float(p) for p in question.probability), strict=True))  # type: ignore[attr-defined]
        now_p = np.array(list(out["probabilities"].values()))
        out["entropy_nats"] = float(-np.sum(now_p * np.log(np.maximum(now_p, 1e-300))))
        subject = "which of " + ", ".join(names) + " is right"
        told = max(p.answer.nats for p in ranking)
        if out["entropy_nats"] < 0.05:
            warnings = [*warnings, f"{names[int(np.argmax(now_p))]} has a probability of {100 * now_p.max():.1f} % "
                                   "already: little is left to be told"]
        elif told < _LITTLE * out["entropy_nats"]:
            warnings = [*warnings, f"no experiment of the menu is expected to tell {' from '.join(names)}: the most "
                                   f"that one tells is {told:.2g} of {out['entropy_nats']:.2g} nats. What is "
                                   "left of the question these sensors and limits may not allow to be answered"]
    if len(chosen) < s.plan:
        warnings = [*warnings, f"the plan ends after {len(chosen)} of {s.plan} experiments: nothing of the menu adds "
                               "to them"]
    out["warnings"] = list(dict.fromkeys(warnings))
    out["statement"] = statement(out, ranking[0].experiment, subject)
    return out


def rough_widths(expected: Mapping[str, float], ranges: Mapping[str, tuple[float, float]]) -> list[str]:
    """Quantities whose expected width is not to be relied on: its range is wide, or it lies outside."""
    out = []
    for name, (low, high) in ranges.items():
        wide = high > ROUGH * max(low, 1e-3)
        outside = not low / ROUGH <= expected.get(name, low) <= high * ROUGH
        if (wide or outside) and expected.get(name, 1.0) < 0.95:
            out.append(name)
    return out


def _after_plan(question: OfParameters, chosen: Sequence[Proposal]) -> dict[str, float]:
    for p in chosen[:-1]:
        question = question.after(p.answer)
    return question.intervals_after(chosen[-1].answer.known)


def _entry(question: Question, p: Proposal, names: list[str]) -> dict[str, Any]:
    if isinstance(question, OfParameters):
        why = why_parameters(question.intervals_after(p.answer.known))
    else:
        why = why_hypotheses(p.answer.detail, names)
    return {
        "experiment": p.experiment.stated,
        "expected_information_gain_nats": p.answer.nats,
        "se": max(p.answer.se, _LEAST_SE),
        "cost_s": p.cost_s,
        "gain_per_hour": p.per_hour,
        "why": why,
        "cost": {"setup_s": p.setup_s, "recording_s": p.experiment.duration_s, "rest_s": p.rest_s},
        "file": None,
        **p.answer.detail,
    }


def with_files(
    ranking: Sequence[Proposal], chosen: Sequence[Proposal], entries: list[dict[str, Any]],
    later: list[dict[str, Any]], count: int,
) -> None:
    """Names of command files: for the first `count` of the ranking, the best of each pattern, and the plan."""
    seen: set[str] = set()
    for i, (p, entry) in enumerate(zip(ranking, entries, strict=True)):
        if i < count or p.experiment.pattern not in seen:
            entry["file"] = f"next/{i + 1:03d}_{p.experiment.name}.csv"
        seen.add(p.experiment.pattern)
    if len(chosen) > 1:
        for i, (p, entry) in enumerate(zip(chosen, later, strict=True)):
            entry["file"] = f"next/plan_{i + 1:02d}_{p.experiment.name}.csv"
    else:
        later[0]["file"] = entries[0]["file"]

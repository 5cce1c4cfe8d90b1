"""The road from a campaign to a verdict: fit, locate, name, prove, ask."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..assemble import Assembled, assemble
from ..campaign.schema import Campaign
from ..errors import InputError
from ..find_map import MapSettings
from ..models.effects import registered_effects
from ..models.model import Model, build_model
from . import second_look
from .ask import first_experiment, next_experiment
from .clipped import beyond_reach, cut_out, restored, sensor_limit
from .descent import Linearisation
from .features import Features, features
from .first_fit import first_fit
from .frame import own_index
from .grid import Screened
from .hypotheses import NONE, UNKNOWN
from .journal import Journal
from .locate import is_adequate
from .name import Explanation, Naming, name_physics, weigh_delay
from .noise_prior import NoisePrior, noise_prior
from .own_gains import MOVED, gains_of, own_gains, worth_a_search
from .own_limits import CLIPPING, limit_of_readings
from .problem import Problem
from .profile import profiled
from .prove import HeldOut, held_out, unanswered, without_validation
from .reduced import Piece, reduce_campaign
from .refit import Fit, refit
from .reread import Rereading, held_out_gains, odd_one_out, other_holds
from .ridge import posterior
from .seen import Seen
from .size import STEP_M
from .summary import Draws, say_clipped, say_gains, say_odd, say_swinging, say_uneven, summarise
from .swinging import swinging
from .telling import Tell, silence
from .timing import sample_step_s, timing_note
from .uneven import uneven_scatter
from .unknown import repair
from .verdict import facts_of, indistinguishable, silent, verdict_of
from .words import sentence, small_note

Array = NDArray[np.float64]
Report = Callable[[str, float, float, str], None]
#: how often a fit is made again because it showed false readings
_ROUNDS = 3
#: nats by which another hold convention must be ahead to be taken before effects are weighed
_BY_FAR = 100.0
#: nats behind the best explanation within which others are known of when the search begins anew
_RIVAL = 30.0


@dataclass(frozen=True)
class DiagnosisSettings:
    """Effort of a diagnosis."""

    map: MapSettings = MapSettings()
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
    #: p-value of what the recordings to validate show beside the verdict, where they contradict it
    contradiction: float | None = None
    #: what is to be said of the recordings themselves
    notes: tuple[str, ...] = ()
    #: the same with its parameters sampled, where that was put off
    sampled: Callable[[], Diagnosis] | None = field(default=None, repr=False, compare=False)

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
    checkpoint: Path | None = None,
) -> Diagnosis:
    """Find where a model and recordings differ, name the physics that was left out, and prove the repair.

    Recordings with role "validate" are touched by the proof alone; only where they contradict the verdict is it
    sought again on all recordings, and proved by leaving those to validate out in turn. Raises InputError for input
    that cannot be diagnosed.

    checkpoint: file that keeps what was worked out; the same diagnosis, interrupted, goes on from it to the same
    numbers.
    """
    s = settings or DiagnosisSettings()
    say = report or (lambda *_: None)
    if isinstance(model, str):
        model = build_model(model, priors)
    began = time.perf_counter()
    journal = Journal(checkpoint)
    try:
        with threadpool_limits(1):  # products of a few hundred rows: threads would wait for each other
            first = _once(campaign, model, seed, s, say, priors, journal)
            second = None
            if first.contradiction is not None:
                say("looking again", 0, 1, "the recordings to validate contradict the verdict")
                everything, in_turn = second_look.all_to_identify(campaign), second_look.to_validate(campaign)
                second = _once(everything, model, seed, s, say, priors, journal, in_turn)
            result = first if second is None else _decided(first, second, campaign)
    finally:
        journal.close()
    result.summary["seconds"] = time.perf_counter() - began
    return result


def _decided(first: Diagnosis, second: Diagnosis, campaign: Campaign) -> Diagnosis:
    """The diagnosis that counts, of one on the recordings to identify and one on all; it says what happened."""
    p_value = first.contradiction
    assert p_value is not None
    best = second.naming.best
    if second_look.overrules(first.summary, second.summary, not best.weighed.effects and best.adequate):
        result = second
        note = second_look.overruled_note(first.summary, second.summary, p_value, second_look.to_validate(campaign))
        result.summary["statement"] = f"{result.summary['statement']} {note}."
    else:
        said = "" if best.small is None else small_note(best.small, best.weighed)
        # a recording of another actuator among those to validate, say
        result = first.sampled() if first.sampled is not None else first
        note = "; ".join(second.notes) or second_look.kept_note(p_value, said)
    result.summary["warnings"].insert(0, note)
    for phase, seconds in (first if result is second else second).summary["seconds_by"].items():
        result.summary["seconds_by"][phase] = result.summary["seconds_by"].get(phase, 0.0) + seconds
    return result


def _once(
    campaign: Campaign,
    model: Model,
    seed: int,
    s: DiagnosisSettings,
    say: Report,
    priors: Mapping[str, Any] | None,
    journal: Journal,
    in_turn: tuple[str, ...] = (),
) -> Diagnosis:
    """One diagnosis. in_turn: recordings to identify that the proof leaves out in turn, where none is to validate."""
    began = time.perf_counter()
    laps: dict[str, float] = {}
    mark = began

    def lap(name: str) -> None:
        nonlocal mark
        now = time.perf_counter()
        laps[name] = laps.get(name, 0.0) + now - mark
        mark = now

    r_map, r_name, r_look, r_draw = np.random.default_rng(seed).spawn(4)
    say("reading noise", 0, 1, campaign.name)
    limit = sensor_limit(campaign)
    usable = campaign if limit is None else cut_out(campaign, limit)
    assembled = assemble(usable, model, s.workers, lambda *at: say("reading noise", *at))
    lap("assemble")
    pieces = reduce_campaign(assembled)
    prior = noise_prior(assembled)
    problem = replace(Problem.of(assembled, model, [p for p in pieces if p.identify]), journal=journal)
    say("fitting", 0, 1, model.name)
    base = first_fit(assembled, problem, prior, r_map, s.map, lambda *at: say("fitting", *at))
    lap("map")
    if base is None:
        raise InputError(f"{model.name} has no answer on these recordings at its best fit; check the geometry")
    seen = Seen(base, pieces, prior)
    say("refining the fit", 0, 1, "false readings")
    if limit is not None:
        seen.keep_below(limit)
    for _ in range(_ROUNDS):
        base = seen.base
        if not seen.spoiled(base):
            break
        seen.base = refit(seen.base.problem, base.q, base.noise, prior) or base
    lap("reduce")
    resolution = _resolution(campaign)

    def named(seen: Seen, begun: Sequence[Fit] = ()) -> Naming:
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
                unseen=[p for p in seen.pieces if not p.identify],
                begun=begun,
            )
            if found is not None:
                break
            seen.base = refit(seen.base.problem, base.q, base.noise, prior) or base
        assert found is not None
        return found

    say("refining the fit", 1, 1, "")
    retimed = _retimed(seen.base, campaign, priors, prior, r_name, lambda *at: say("rereading", *at))
    if retimed is not None:
        seen.take(retimed)
    naming = named(seen)
    reread = _reread(naming, seen.pieces, prior, r_name, lambda *at: say("rereading", *at))
    if reread is not None:
        how = "a gain of each recording" if reread.gains else reread.odd or f"hold = {reread.hold}"
        how = "the end of the sensor's range" if reread.limit else how
        say("reading the campaign again", 0, 1, how)
        begun = _begun(naming, seen.pieces, prior) if reread.gains else []
        seen.take(reread)
        naming = named(seen, begun)
    if not naming.best.adequate and _gains_matter(naming, seen.pieces, prior):
        say("reading the campaign again", 0, 1, "a gain of each recording")
        other = seen.copy()
        other.take(Rereading(seen.base, 0.0, gains=True))
        again = named(other)
        if again.best.adequate:
            seen, naming = other, again
    gains = gains_of(naming.best.weighed.fit) if seen.loose else None
    base = naming.none.weighed.fit
    looks = [features(p) for p in base.problem.pieces]
    lap("name")
    best = naming.best
    facts = facts_of(best.weighed.fit, seen.pieces, limit, resolution)
    step = sample_step_s(base)
    # a limit of the sensor cuts off noise as well
    uneven = uneven_scatter(seen.pieces, resolution) if limit is None else None
    swings = swinging(best.weighed.fit, resolution)
    strange = uneven is not None or swings is not None or (gains is not None and not gains.allowed)
    verdict, raw, physics, delays = verdict_of(naming, facts, step, strange)
    corrected = base if physics[verdict] == NONE else named_fit(naming, physics[verdict])
    mended = None
    if verdict == UNKNOWN:
        # where the best explanation leaves nothing, it is this that no physics explains
        strangest = (swings or gains) if best.adequate else None
        mended = repair(best, looks) if strangest is None else strangest.repair(best.weighed.name)
    say("proving", 0, 1, "recordings kept for validation")
    seen.spoiled(corrected, identify=False)
    clip = limit.value_m if limit is not None and "sensor_clipping" in verdict.split("+") else math.inf
    scored = seen.pieces
    if limit is not None:
        whole = {p.name: p for p in restored([p for p in scored if not p.identify], campaign, limit)}
        scored = tuple(whole.get(p.name, p) for p in scored)
    proof, how = _proof(base, corrected, scored, prior, clip, in_turn, lambda *at: say("proving", *at))
    against = None
    explanation = naming.none if physics[verdict] == NONE else best
    if verdict != UNKNOWN and explanation.adequate:
        # with a shift of less than a sample, of which nothing is claimed
        by_name = {p.name: p for p in seen.pieces}
        ours = tuple(by_name[p.name] for p in corrected.problem.pieces)
        explained = replace(corrected, problem=replace(corrected.problem, pieces=ours))
        say("proving", 2, 3, "all recordings together")
        against = second_look.contradiction(explained, seen.pieces, prior, limit, r_look, resolution)
    lap("prove")
    say("asking", 0, 1, "the next experiment")
    members = indistinguishable(verdict, raw)
    ask = _ask(naming, [physics[m] for m in members], base, lambda *at: say("asking", *at))
    if silent(naming) and any(p.channel == "displacement" for p in base.problem.pieces):
        ask = first_experiment(base, base.problem.pieces[0].recording.actuator, lambda *at: say("asking", *at))
    lap("ask")
    notes = [*seen.notes, *unanswered(proof, corrected.problem.model.name)]
    if uneven is not None:
        notes.append(uneven.note())
    if swings is not None:
        notes.append(swings.note())
    if gains is not None:
        notes.append(gains.note())
    if explanation.small is not None and verdict != UNKNOWN:
        notes.append(small_note(explanation.small, explanation.weighed))
    if verdict in delays:
        notes.append(timing_note(delays[verdict], step))
    if verdict != UNKNOWN and gains is None:
        held = tuple(p for p in scored if not p.identify)
        held = held if limit is None else beyond_reach(held, limit, corrected)
        notes += held_out_gains(corrected, held, lambda *at: say("comparing sizes", *at))
    assembled = replace(assembled, warnings=(*notes, *assembled.warnings, *seen.warnings.values()))

    def told(drawn: Draws | None) -> Diagnosis:
        """All of it in words and numbers; without draws the posterior is Laplace's."""
        summary = summarise(
            assembled, naming, verdict, raw, physics, facts, members, proof, how, ask, looks, mended, seed, campaign,
            model, drawn, seen.shown,
        )  # fmt: skip
        if how != "validate" and not in_turn:
            summary["warnings"].append(without_validation(proof))
        summary["statement"] = " ".join([*map(sentence, notes), summary["statement"]])
        if seen.odd is not None:
            say_odd(summary["mismatch"], seen.odd, campaign)
        if uneven is not None:
            say_uneven(summary["mismatch"], uneven, campaign)
        if swings is not None:
            say_swinging(summary["mismatch"], swings, campaign)
        if gains is not None:
            say_gains(summary["mismatch"], gains, campaign)
        if clip < math.inf and limit is not None:
            say_clipped(summary["mismatch"], limit, restored(pieces, campaign, limit))
        lap("write")
        summary["seconds"] = sum(laps.values())
        summary["seconds_by"] = laps
        return Diagnosis(assembled, base, corrected, naming, proof, looks, summary, against, tuple(seen.notes))

    def sampled() -> Diagnosis:
        nonlocal mark
        mark = time.perf_counter()  # it may have been put off
        found = _drawn(naming, physics[verdict], base, r_draw, lambda *at: say("drawing its parameters", *at))
        lap("draw")
        return told(found)

    if against is not None:
        # what all recordings together overrule need not be sampled
        return replace(told(None), sampled=sampled)
    return sampled()


def _resolution(campaign: Campaign) -> float:
    sensor = campaign.sensors.get("displacement")
    return sensor.resolution if sensor is not None and sensor.resolution else STEP_M


def _retimed(
    base: Fit,
    campaign: Campaign,
    overrides: Mapping[str, Any] | None,
    prior: NoisePrior,
    rng: np.random.Generator,
    tell: Tell = silence,
) -> Rereading | None:
    """Another hold convention that leaves nothing to explain by far: no effect has to be weighed to see that.

    None but a delay: one that is no whole number of samples leaves, read that way, what looks like another effect.
    """
    if is_adequate(base, rng):
        return None
    found = [r for r in other_holds(base, prior, rng, tell) if r.base.log_evidence > base.log_evidence + _BY_FAR]
    if not found:
        return None
    best = max(found, key=lambda r: r.log_weight)
    delayed = weigh_delay(base, campaign, overrides, prior, rng)
    return None if delayed is not None and delayed > best.log_weight else best


def _reread(
    naming: Naming, pieces: tuple[Piece, ...], prior: NoisePrior, rng: np.random.Generator, tell: Tell = silence
) -> Rereading | None:
    """Another reading of the campaign that is likelier than every named effect and than "unknown"; None without one."""
    if naming.none.adequate:
        return None
    fit = naming.none.weighed.fit
    found = [*other_holds(fit, prior, rng, tell), *odd_one_out(fit, prior, rng, tell)]
    if not naming.best.adequate and naming.best is not naming.none:
        found += odd_one_out(naming.best.weighed.fit, prior, rng, tell)
    found += _with_own_gains(naming, pieces, prior, rng, tell)
    if CLIPPING in naming.best.weighed.effects and not naming.best.adequate:
        name = naming.best.weighed.name
        odds = naming.log_weight.get(name, -math.inf) - naming.log_evidence.get(name, 0.0)
        tell(0, 1, "the end of the sensor's range as one of its readings")
        ended = limit_of_readings(naming.best.weighed, odds, prior, rng)
        found += [ended] if ended is not None else []
    if not found:
        return None
    top = max(found, key=lambda r: r.log_weight)
    # "unknown" takes what nothing else explains; another reading does
    rival = max(v for k, v in naming.log_weight.items() if k != UNKNOWN)
    return top if top.log_weight > rival or not naming.best.adequate else None


def _with_own_gains(
    naming: Naming, pieces: tuple[Piece, ...], prior: NoisePrior, rng: np.random.Generator, tell: Tell
) -> list[Rereading]:
    """The base, the best explanation and parts of it with a gain of each recording, where that leaves nothing.

    One of several effects may be there for gains that differ.
    """
    best = naming.best.weighed
    parts = [w for w in naming.weighed.values() if set(w.effects) < set(best.effects) and w.refitted]
    out = []
    for k, w in enumerate({w.name: w for w in (naming.none.weighed, *parts, best)}.values()):
        if w.name not in naming.log_weight:  # too small to be claimed
            continue
        tell(k, len(parts) + 2, f"a gain of each recording, {w.name}")
        loose = own_gains(w.fit, pieces, prior)
        if loose is not None and is_adequate(loose, rng):
            odds = naming.log_weight[w.name] - naming.log_evidence[w.name]
            out.append(Rereading(loose, loose.log_evidence + math.log(MOVED) + odds, gains=True))
    return out


def _gains_matter(naming: Naming, pieces: tuple[Piece, ...], prior: NoisePrior) -> bool:
    """Whether a gain of each recording takes away much of what the base, or the best explanation, leaves."""
    for fit in {id(f): f for f in (naming.none.weighed.fit, naming.best.weighed.fit)}.values():
        loose = own_gains(fit, pieces, prior)
        if loose is not None and worth_a_search(fit, loose, prior):
            return True
    return False


def _begun(naming: Naming, pieces: tuple[Piece, ...], prior: NoisePrior) -> list[Fit]:
    """The best explanation and its rivals with a gain of each recording, for a search with these to know of."""
    if not naming.best.weighed.effects or not naming.best.adequate:
        return []
    least = naming.log_weight[naming.best.weighed.name] - _RIVAL
    near = [w for w in naming.weighed.values() if w.refitted and naming.log_weight.get(w.name, -math.inf) > least]
    fits = [own_gains(w.fit, pieces, prior) for w in near if w.effects]
    return [fit for fit in fits if fit is not None]


def named_fit(naming: Naming, name: str) -> Fit:
    """The fit behind a name; of the best partial explanation where nothing on the list explains it."""
    best = naming.best.weighed
    return best.fit if name in (best.name, UNKNOWN) else naming.weighed[name].fit


def _drawn(
    naming: Naming, name: str, base: Fit, rng: np.random.Generator, tell: Tell = silence
) -> tuple[Array, Array] | None:
    """Draws of the parameters of what is named; None for none, unknown, and where Laplace has to do.

    Where modes may change places (`relabel`) every labelling counts, each by Laplace.
    """
    if name in (NONE, UNKNOWN) or len(naming.labellings.get(name, ())) > 1:
        return None
    fit = named_fit(naming, name)
    own = own_index(base, fit.problem.model)
    pressed = any(p.channel == "force" for p in fit.problem.pieces)
    # reached_by: None for an effect that acts in a press too
    if own.size == 1 and pressed and fit.problem.reached_by(name.split("+")) is None:
        return profiled(fit, int(own[0]), tell)
    return posterior(fit, own, rng, tell) if own.size else None


def _proof(
    base: Fit,
    corrected: Fit,
    pieces: tuple[Piece, ...],
    prior: NoisePrior,
    limit_m: float = math.inf,
    in_turn: tuple[str, ...] = (),
    tell: Tell = silence,
) -> tuple[list[HeldOut], str]:
    """Held-out scores on the recordings to validate, or leaving out those to identify (some of them) in turn."""
    held = tuple(p for p in pieces if not p.identify)
    if held:
        return held_out(base, corrected, held, limit_m, tell), "validate"
    if len(base.problem.pieces) < 2:
        return [], "none"
    return leave_out_in_turn(base, corrected, prior, in_turn, tell), "left out in turn"


def leave_out_in_turn(
    base: Fit, corrected: Fit, prior: NoisePrior, names: tuple[str, ...] = (), tell: Tell = silence
) -> list[HeldOut]:
    """Each fitted recording (or each of `names`) scored by refits that have not seen it."""
    out = []
    used = base.problem.pieces
    asked = [p for p in used if not names or p.name in names]
    for k, piece in enumerate(asked):
        tell(k, len(asked), piece.name)
        left = [i for i, p in enumerate(used) if p is not piece]
        rest = tuple(used[i] for i in left)
        fits = []
        for fit in (base, corrected):
            known = Linearisation(fit.q, [fit.clean[i] for i in left], [fit.slopes[i] for i in left])
            again = refit(
                replace(fit.problem, pieces=rest), fit.q, fit.noise, prior, max_steps=3, fit_noise=False, known=known
            )
            fits.append(again or fit)
        out += held_out(fits[0], fits[1], (piece,))
    return out


def _ask(naming: Naming, members: list[str], base: Fit, tell: Tell = silence) -> dict[str, Any]:
    fits, names = [], []
    for name in list(dict.fromkeys(members))[:2]:
        fit = base if name == NONE else naming.weighed[name].fit if name in naming.weighed else None
        if fit is not None:
            fits.append(fit)
            names.append(name)
    if len(fits) < 2:
        return {"why": "one explanation is left; more of the recordings at hand would sharpen it", "recording": {}}
    actuator = base.problem.pieces[0].recording.actuator
    return next_experiment(fits, names, actuator, tell)


__all__ = ["Diagnosis", "DiagnosisSettings", "Explanation", "diagnose", "registered_effects"]

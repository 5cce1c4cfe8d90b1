"""The road from a campaign to a verdict: fit, locate, name, prove, ask."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ..assemble import Assembled
from ..campaign.build import NO_VALIDATION
from ..campaign.schema import Campaign
from ..find_map import MapSettings
from ..gauss_newton.journal import Journal
from ..gauss_newton.reduced import Piece
from ..gauss_newton.refit import Fit
from ..models.model import Model, build_model
from . import second_look
from .ask import first_experiment, next_experiment, offered_by, sharpening_experiment, stated_scatter
from .held_gains import held_gains
from .judge import Judged, judged, named_fit
from .laps import Laps
from .prepare import Prepared, prepared
from .prove import HeldOut, proof, unanswered, untaught, with_noise_at_rest, with_repair, without_validation
from .readings.clipped import beyond_reach, restored
from .readings.reread import Foreign, held_out_gains, of_one_other, too_few_for_an_odd_one
from .readings.seen import Seen
from .search.frame import own_index
from .search.hypotheses import NONE, UNKNOWN, parted, unlogged_notes, unweighed_note
from .search.naming import Naming
from .search.profile import profiled
from .search.quest import Report
from .search.ridge import posterior
from .sought import sought
from .summary import ANOTHER, Draws, say_clipped, say_foreign, say_gains, say_odd, say_swinging, say_uneven, summarise
from .telling import Tell, silence
from .verdict import silent
from .where.features import Features
from .words import sentence, small_note

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DiagnosisSettings:
    """Effort of a diagnosis."""

    map: MapSettings = MapSettings()
    workers: int = 1
    most_effects: int = 3


#: probability of explanations with which a second look begins, and how many of them: what the recordings to identify do
#: not tell from the verdict may be what all of them say
_LIKELY, _MOST_LIKELY = 0.01, 4
#: of a recording of another actuator, where others are left to prove a verdict on
_TOLD_WITHOUT_IT = "The error on recordings that no fit has seen is told without it"


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
    #: what is to be said of the recordings themselves, and of when they were read
    notes: tuple[str, ...] = ()
    #: whether every recording has a gain of its own
    loose: bool = False
    #: recordings to validate of another actuator, where all that differ in size may be of a single one
    foreign: tuple[str, ...] = ()
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
    checkpoint: str | Path | None = None,
) -> Diagnosis:
    """Find where a model and recordings differ, name the physics that was left out, and prove the repair.

    Recordings with role "validate" are touched by the proof alone; only where they contradict the verdict is it
    sought again on all recordings, and proved by leaving those to validate out in turn. Raises InputError for input
    that cannot be diagnosed.

    priors: of the model's parameters where it is given as a SPEC, and of those of effects that may be added to it, by
    name. checkpoint: file that keeps what was worked out; the same diagnosis, interrupted, goes on from it to the same
    numbers.
    """
    s = settings or DiagnosisSettings()
    say = report or (lambda *_: None)
    if isinstance(model, str):
        own, priors = parted(model, priors or {})
        model = build_model(model, own)
    began = time.perf_counter()
    journal = Journal(None if checkpoint is None else Path(checkpoint))
    try:
        with threadpool_limits(1):  # products of a few hundred rows: threads would wait for each other
            first = _once(campaign, model, seed, s, say, priors, journal)
            second = None
            if first.contradiction is not None:
                say("looking again", 0, 1, "the recordings to validate contradict the verdict")
                everything, in_turn = second_look.all_to_identify(campaign), second_look.to_validate(campaign)
                known = first.naming.likely(_LIKELY, _MOST_LIKELY)
                second = _once(everything, model, seed, s, say, priors, journal, in_turn, first.loose, known)
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
    explained = not best.weighed.effects and best.adequate
    # "unknown" is no better an answer than a recording of another actuator
    told_apart = bool(first.foreign) and second.verdict == UNKNOWN
    if not told_apart and second_look.overrules(first.summary, second.summary, explained):
        result = second
        note = second_look.overruled_note(first.summary, second.summary, p_value, second_look.to_validate(campaign))
        result.summary["statement"] = f"{result.summary['statement']} {note}."
    else:
        said = "" if best.small is None else small_note(best.small, best.weighed)
        # a recording of another actuator among those to validate, say
        result = first.sampled() if first.sampled is not None else first
        # which has its note already, and of whose size the other ones' means know too much
        told = [w["recording"] for w in result.summary["mismatch"]["where"] if w["what"].startswith(ANOTHER)]
        note = "; ".join(n for n in second.notes if not any(name in n for name in told))
        note = note or ("" if told else second_look.kept_note(p_value, said))
    result.summary["warnings"][:0] = [note] if note else []
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
    loose: bool = False,
    known: tuple[Fit, ...] = (),
) -> Diagnosis:
    """One diagnosis. in_turn: recordings to identify that the proof leaves out in turn, where none is to validate;
    loose, known: see `sought`."""
    lap = Laps()
    r_map, r_name, r_look, r_draw = np.random.default_rng(seed).spawn(4)
    ready = prepared(campaign, model, s.map, s.workers, r_map, journal, say, lap)
    seen, naming = sought(ready, priors, s.most_effects, r_name, say, loose, known)
    lap("name")
    found = judged(ready, seen, naming)
    naming = found.naming
    ruling, base, corrected = found.ruling, found.base, found.corrected
    say("proving", 0, 1, "recordings kept for validation")
    seen.spoiled(corrected, identify=False)
    clip, scored = _scored(ready, seen, ruling.verdict)
    proved, how = proof(base, corrected, scored, ready.prior, clip, in_turn, lambda *at: say("proving", *at))
    mended: list[HeldOut] = []
    if found.repaired is not None:
        mended, _ = proof(
            corrected, found.repaired, scored, ready.prior, clip, in_turn, lambda *at: say("proving the repair", *at)
        )
    if ruling.verdict == UNKNOWN:
        proved, mended = (with_noise_at_rest(h, corrected, seen.pieces, ready.prior) for h in (proved, mended))
        proved = with_repair(proved, mended)
    against = None
    if ruling.verdict != UNKNOWN and found.explanation.adequate:
        by_name = {p.name: p for p in seen.pieces}
        ours = tuple(by_name[p.name] for p in found.explained.problem.pieces)
        explained = replace(found.explained, problem=replace(found.explained.problem, pieces=ours))
        say("proving", 2, 3, "all recordings together")
        against = second_look.contradiction(
            explained, seen.pieces, ready.prior, ready.limit, r_look, ready.resolution_m
        )
    if against is not None and against.together is not None and not seen.loose:
        gains = held_gains(ready, found, against.together, dict(priors or {}), r_look, say)
        if gains is not None:
            found, against = replace(found, gains=gains), None
    lap("prove")
    say("asking", 0, 1, "the next experiment")
    ask = _ask(found, ready.campaign, lambda *at: say("asking", *at))
    lap("ask")
    notes = [*seen.notes, *unanswered(proved, corrected.problem.model.name), *untaught(proved), *found.notes()]
    foreign: list[Foreign] = []
    if ruling.verdict != UNKNOWN and found.gains is None:
        held = tuple(p for p in scored if not p.identify)
        held = held if ready.limit is None else beyond_reach(held, ready.limit, corrected)
        foreign = held_out_gains(corrected, held, ready.prior, r_look, lambda *at: say("comparing sizes", *at))
        rest = [h for h in proved if h.recording not in {f.recording for f in foreign}]
        notes += [f"{f.note()}. {_TOLD_WITHOUT_IT}" if rest else f.note() for f in foreign]
        proved = rest or proved
    assembled = ready.assembled
    assembled = replace(assembled, warnings=(*notes, *assembled.warnings, *seen.warnings.values()))

    def told(drawn: Draws | None) -> Diagnosis:
        """All of it in words and numbers; without draws the posterior is Laplace's."""
        summary = summarise(assembled, found, proved, how, ask, seed, campaign, model, drawn, seen.shown, mended)
        if how != "validate" and not in_turn:
            # says what was done about it, too
            summary["warnings"] = [w for w in summary["warnings"] if w != NO_VALIDATION]
            summary["warnings"].append(without_validation(proved))
        summary["statement"] = " ".join([*map(sentence, notes), summary["statement"]])
        if ruling.verdict == UNKNOWN and found.scale is None:
            summary["warnings"] += too_few_for_an_odd_one(base)
        summary["warnings"] += unlogged_notes(naming.skipped)
        unweighed = unweighed_note(base.problem.model, naming.skipped)
        if unweighed is not None:
            summary["warnings"].append(unweighed)
            summary["statement"] = f"{summary['statement']} {sentence(unweighed)}"
        _say_what_else(summary["mismatch"], ready, seen, found, clip)
        for one in foreign:
            say_foreign(summary["mismatch"], one, campaign)
        lap("write")
        summary["seconds"] = sum(lap.seconds.values())
        summary["seconds_by"] = lap.seconds
        said = (*seen.notes, *([] if found.gains is None else [found.gains.note()]), *found.timing())
        p_value = None if against is None else against.p_value
        # what changes within one, or with the command, says more than that they are of another actuator
        apart = tuple(f.recording for f in foreign) if of_one_other(seen.odd, foreign) else ()
        return Diagnosis(
            assembled, base, corrected, naming, proved, found.looks, summary, p_value, said, seen.loose, apart
        )

    def sampled() -> Diagnosis:
        lap.begin()  # it may have been put off
        drawn = _drawn(naming, ruling.named, base, r_draw, lambda *at: say("drawing its parameters", *at))
        lap("draw")
        return told(drawn)

    if against is not None:
        # what all recordings together overrule need not be sampled
        return replace(told(None), sampled=sampled)
    return sampled()


def _scored(ready: Prepared, seen: Seen, verdict: str) -> tuple[float, tuple[Piece, ...]]:
    """The end of the sensor's range (m) where it is what was left out, and the recordings that the proof scores.

    Those to validate with what the sensor cut off: the verdict is to say it.
    """
    if ready.limit is None:
        return math.inf, seen.pieces
    clip = ready.limit.value_m if "sensor_clipping" in verdict.split("+") else math.inf
    whole = {p.name: p for p in restored([p for p in seen.pieces if not p.identify], ready.campaign, ready.limit)}
    return clip, tuple(whole.get(p.name, p) for p in seen.pieces)


def _say_what_else(mismatch: dict[str, Any], ready: Prepared, seen: Seen, found: Judged, clip: float) -> None:
    """Put into the "mismatch" of a summary what the recordings show beside a misfit of the model."""
    if seen.odd is not None:
        say_odd(mismatch, seen.odd, ready.campaign)
    if found.uneven is not None:
        say_uneven(mismatch, found.uneven, ready.campaign)
    if found.swings is not None:
        say_swinging(mismatch, found.swings, ready.campaign)
    if found.gains is not None:
        say_gains(mismatch, found.gains, ready.campaign)
    if clip < math.inf and ready.limit is not None:
        say_clipped(mismatch, ready.limit, restored(ready.pieces, ready.campaign, ready.limit))


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


def _ask(found: Judged, campaign: Campaign, tell: Tell = silence) -> dict[str, Any]:
    """The experiment that would split what is left, sharpen it, or show anything at all where these recordings do not.
    """
    naming, base, ruling = found.naming, found.base, found.ruling
    limits, scatter = offered_by(campaign, base.problem.model), stated_scatter(campaign)
    if silent(naming) and any(p.channel == "displacement" for p in base.problem.pieces):
        return first_experiment(base, limits, tell, scatter)
    if ruling.verdict == UNKNOWN:
        return {"why": "what was left out is on no list, so that no experiment can be told to show it; whether it is "
                       "there again when the recordings that show it most are repeated would tell whether it is of the "
                       "actuator", "recording": {}}  # fmt: skip
    fits: list[Fit] = []
    names: list[str] = []
    for name in dict.fromkeys(ruling.physics[m] for m in ruling.members):
        fit = base if name == NONE else naming.weighed[name].fit if name in naming.weighed else None
        if fit is not None and len(fits) < 2:
            fits.append(fit)
            names.append(name)
    odds = [sum(p for m, p in ruling.probability.items() if ruling.physics.get(m) == n) for n in names]
    if len(fits) < 2:
        model = fits[0].problem.model
        added = [i for i, n in enumerate(model.priors.names) if n not in base.problem.model.priors.names]
        return sharpening_experiment(fits[0], added or range(model.dimension), limits, tell, scatter)
    return next_experiment(fits, names, limits, tell, scatter, odds)


__all__ = ["Diagnosis", "DiagnosisSettings", "diagnose"]

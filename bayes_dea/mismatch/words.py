"""The sentence that an engineer can act on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..experiments.words import recording_in_words
from ..models.effects import registered_effects
from ..models.effects.measured import Measured
from .search.hypotheses import MAINS, NONE, UNKNOWN, refused
from .search.naming import Naming
from .search.weigh import Weighed
from .timing import SHIFT_NOTE
from .where.locate import AT_REST

#: share of an error by which it has to move to be said in its digits, and nats of ELPD that are worth a word
_MOVES, _A_NAT = 0.005, 1.0


def statement(
    summary: dict[str, Any], naming: Naming, physics: str,
    delays_s: Mapping[str, float] | None = None,
) -> str:
    """One or two sentences for a diagnosis.

    physics: the verdict without what the readings show by themselves; delays_s: shifts below a sample (s), by the name
    that carries them unsaid.
    """
    verdict, proof = summary["verdict"], summary["proof"]
    confidence = f"confidence {summary['confidence']:.2f}"
    numbers = _proved(proof)
    if verdict == NONE:
        if any(w.startswith(SHIFT_NOTE) for w in summary["warnings"]):
            likelier = summary["hypotheses"][0]
            if likelier["name"] == NONE:
                text = f"Beyond that, the recordings give no reason to doubt {summary['model']} ({confidence})."
            else:
                text = (
                    f"No physics is claimed ({confidence}): {likelier['name']} is the likelier explanation "
                    f"(probability {likelier['probability']:.2g}), but a shift of readings, which lacks no physics, is "
                    "not ruled out."
                )
            others = [m for m in summary["indistinguishable"] if m != NONE]
            return text + (f" These recordings cannot tell that shift from {', '.join(others)}." if others else "")
        if naming.none.scan.detected:
            return (
                "The recordings differ from the model by less than one resolution step or by nothing that lasts; "
                f"no physics is claimed ({confidence})."
            )
        likelier = summary["hypotheses"][0]
        if likelier["name"] != NONE:
            return (
                f"No physics is claimed ({confidence}): {likelier['name']} explains the recordings better (probability "
                f"{likelier['probability']:.2g}), but by no more than chance may do; more recordings would tell."
            )
        return f"The recordings give no reason to doubt {summary['model']} ({confidence})."
    if verdict == MAINS:
        line = _mains(summary)
        return (
            f"{line[0].upper()}{line[1:]} is picked up by the sensor; "
            f"beyond it nothing speaks against {summary['model']} ({confidence})."
        )
    if verdict == UNKNOWN:
        return _something_unknown(summary, naming)
    told = next(h for h in summary["hypotheses"] if h["name"] == verdict)["parameters"]
    values: dict[str, float] = {k: Measured(v["mean"], v["sd"], v["q05"], v["q95"]) for k, v in told.items()}
    effects: tuple[str, ...] = ()
    if physics != NONE:  # what the readings show by themselves has its numbers in the hypothesis alone
        weighed = naming.weighed[physics]
        values, effects = {**weighed.fit.values(), **values}, weighed.effects
    parts = []
    for name in verdict.split("+"):
        if name == MAINS and MAINS not in effects:
            parts.append(f"{_mains(summary)} is in the record")
        else:
            parts.append(registered_effects()[name].explain(values))
    text = "; and ".join(parts)
    text = text[0].upper() + text[1:]
    others = [m for m in summary["indistinguishable"] if m != verdict]
    rivals = ", ".join(_with_shift(m, (delays_s or {}).get(m)) for m in others)
    doubt = f" These recordings cannot tell it from {rivals}." if others else ""
    mended = f" With it {numbers}." if numbers else ""
    less = " What it leaves is less than one resolution step and not claimed." if naming.best.below_a_step else ""
    return f"{text} ({confidence}).{mended}{less}{doubt}"


def _something_unknown(summary: dict[str, Any], naming: Naming) -> str:
    """Where a mismatch lives that nothing on the list explains, and what the best partial explanation is worth."""
    fix, proof, partial = summary.get("repair", {}), summary["proof"], naming.best.weighed.name
    lives = f"the mismatch lives in the {fix.get('stage')} stage and goes with {fix.get('acts_on')}"
    if fix.get("stage") in (None, "unknown"):
        lives = "its form does not tell in which stage it lives"
    elif "stage_probability" in fix:
        often = f"a guess that is right {round(10 * fix['stage_probability'])} times in ten"
        lives = f"it goes with {fix['acts_on']}, which points to the {fix['stage']} stage ({often})"
    what = "that nothing which can be weighed explains" if refused(naming.skipped) else "that is not on the list"
    confidence = f"confidence {summary['confidence']:.2f}"
    text = f"Something was left out {what} ({confidence}): {lives}."
    text += _shown_most(summary) + _not_pressed(summary, naming)
    if partial != NONE:
        text += _partly(partial, naming, _without_repair(proof))
    return text + _carries_over(fix, proof, partial)


def _not_pressed(summary: dict[str, Any], naming: Naming) -> str:
    """What mechanical recordings say where they show nothing; empty where there are none, or they do."""
    pieces = naming.best.weighed.fit.problem.pieces
    pressed = {p.name for p in pieces if p.channel == "force" and p.nodes is None}
    where = summary["mismatch"]["where"]
    if not pressed or not where or any(w["recording"] in pressed for w in where):
        return ""
    return " Without voltage nothing of it is seen."


def _partly(partial: str, naming: Naming, proof: dict[str, Any]) -> str:
    """What the best partial explanation is worth, on recordings that it has not seen too. proof: of it alone."""
    numbers, worse, end = _proved(proof), _worse(proof), ""
    if naming.best.adequate:  # more of it is not what is missing
        text = f" It is likelier than {partial}, though that leaves nothing that a test can see"
        text += " where it was learned; elsewhere it does not hold" if worse else ""
    elif worse:
        text = f" Of what is on the list {partial} fits best, and does not hold elsewhere"
    else:
        text, end = f" The best partial explanation is {partial}; it does not mend all", _at_its_end(naming)
    return f"{text}{f': {numbers}' if numbers else ''}.{end}"


def _shown_most(summary: dict[str, Any]) -> str:
    """Where a mismatch is seen most clearly; empty where no interval is."""
    if not summary["mismatch"]["where"]:
        return ""
    where = summary["mismatch"]["where"]
    # a rest that the model misses is a zero that was read off where it misses more
    moving = [w for w in where if w["what"] != AT_REST] or where
    w = max(moving, key=lambda w: w["excess"])
    return f" {w['recording']} shows it most, from {w['t_start_s']:.3f} to {w['t_end_s']:.3f} s ({w['what']})."


def _worse(proof: dict[str, Any]) -> bool:
    """Whether an explanation makes the error on recordings that it has not seen larger than it was."""
    errors = ((proof.get(f"rmse_before_{u}"), proof.get(f"rmse_after_{u}")) for u in ("m", "N"))
    return any(b is not None and a is not None and a - b > _MOVES * b for b, a in errors)


def _without_repair(proof: dict[str, Any]) -> dict[str, Any]:
    """The proof of the best partial explanation alone, of one that counts a repair beside it as well."""
    tried = proof.get("repair")
    if tried is None or not _holds(tried):
        return proof
    after = {f"rmse_after_{u}": tried[f"rmse_before_{u}"] for u in ("m", "N") if f"rmse_before_{u}" in tried}
    gain = None if proof["elpd_gain"] is None else proof["elpd_gain"] - tried["elpd_gain"]
    return {**proof, **after, "elpd_gain": gain}


def _holds(tried: Mapping[str, Any]) -> bool:
    """Whether a repair gains on recordings that it was not learned from."""
    return tried["elpd_gain"] is not None and tried["elpd_gain"] > 0.0


def _carries_over(fix: Mapping[str, Any], proof: dict[str, Any], partial: str) -> str:
    """The form of a repair, and whether it holds on recordings that it was not learned from."""
    tried = proof.get("repair")
    if not fix.get("terms") or tried is None or tried["elpd_gain"] is None:
        return ""
    unseen = "recordings left out in turn" if proof["how"] == "left out in turn" else "the recordings that it never saw"
    # what has a name was described by its own note
    place, form = _place(fix, partial), f"the {fix['terms'][0]['term']}" if "beside" in fix else fix["form"]
    gains = _holds(tried)
    if not gains or (proof["elpd_gain"] or 0.0) <= 0.0:
        but = f"but {'with it, too, the model given is better' if gains else 'not'} on {unseen}"
        if fix.get("beside", partial) == partial:
            return f" What is left{'' if partial == NONE else ' beside it'} looks like {form}, {but}."
        return f" {form[0].upper()}{form[1:]} {place} helps where it was learned, {but}."
    before, after = tried["rmse_before_m"], tried["rmse_after_m"]
    falls = before is not None and after is not None and before - after > _MOVES * before
    error = f", and their error falls from {1e6 * before:.3g} to {1e6 * after:.3g} um" if falls else ""
    lead = f"{place}, {form}" if place else form
    nats = f"{tried['elpd_gain']:.3g} nats of log predictive density (ELPD)"
    return f" {lead[0].upper()}{lead[1:]} gains {nats} on {unseen}{error}."


def _place(fix: Mapping[str, Any], partial: str) -> str:
    """Where a repair stands: beside the best partial explanation, or in its place; empty where nothing explains a part.
    """
    beside = fix.get("beside", partial)
    if beside == partial:
        return "" if partial == NONE else "beside it"
    return "in its place" if beside == NONE else f"in its place beside {beside}"


def _at_its_end(naming: Naming) -> str:
    """What to say of an explanation that is as strong as its priors allow; empty where it is not."""
    weighed = naming.best.weighed
    model, values = weighed.fit.problem.model, weighed.fit.values()
    own = {p.name for e in weighed.effects for p in registered_effects()[e].parameters_in(weighed.effects)}
    ends = [
        f"{p.name} = {values[p.name]:.3g}{'' if p.unit == '1' else ' ' + p.unit}"
        for coordinate, p in zip(model.coordinate_names, model.priors.free, strict=True)
        if p.name in own and coordinate in weighed.fit.at_bound
    ]
    if not ends:
        return ""
    return f" It stands at an end of its prior ({', '.join(ends)}); where more may be, say so with --prior."


def _with_shift(name: str, delay_s: float | None) -> str:
    """An explanation by its name, and the shift of the readings that it needs."""
    name = "something that is on no list" if name == UNKNOWN else name
    if delay_s is None:
        return name
    how = "early" if delay_s < 0.0 else "late"
    late = f"readings that are {how} by {1e3 * abs(delay_s):.2g} ms, less than one sample"
    return f"{name} but {late}" if name == NONE else f"{name} with {late}"


def _proved(proof: dict[str, Any]) -> str:
    """What the repair does to the error on recordings that it has not seen; empty without such recordings.

    An effect within the noise moves the error by less than its digits: what it is worth is said in nats then.
    """
    parts = [part for part in (_error(proof, "m", 1e6, "um"), _error(proof, "N", 1e3, "mN")) if part is not None]
    text = " and ".join(said for said, _ in parts)
    gain = proof["elpd_gain"] or 0.0
    if not parts or any(moved for _, moved in parts) or abs(gain) < _A_NAT:
        return text
    return f"{text}; their log predictive density (ELPD) {'gains' if gain > 0.0 else 'loses'} {abs(gain):.3g} nats"


def _error(proof: dict[str, Any], unit: str, factor: float, shown: str) -> tuple[str, bool] | None:
    """What becomes of the error on the recordings of one channel, and whether it moves; None where there are none."""
    before, after, noise = (proof.get(f"{k}_{unit}") for k in ("rmse_before", "rmse_after", "noise"))
    if before is None or after is None or noise is None:
        return None
    before, after, noise = factor * before, factor * after, factor * noise
    count = sum(f"noise_{unit}" in h for h in proof["held_out"])
    what = f"{'recording' if count == 1 else 'recordings'}{'' if unit == 'm' else ' of force'}"
    seen = f"the {what} it never saw" if count == 1 else f"the {count} {what} it never saw"
    where = {"validate": seen, "left out in turn": f"{count} {what} left out in turn"}
    error = f"the error on {where.get(proof['how'], 'them')}"
    if abs(before - after) > _MOVES * before:
        way = "falls" if after < before else "rises"
        return f"{error} {way} from {before:.3g} to {after:.3g} {shown} (noise {noise:.3g} {shown})", True
    return f"{error} stays at {after:.3g} {shown} (noise {noise:.3g} {shown})", False


def sentence(note: str) -> str:
    """A note as a sentence; a file name or a label that it begins with keeps its letters."""
    first = note.split(" ", 1)[0]
    return f"{note if '.' in first or first.endswith(':') else note[:1].upper() + note[1:]}."


def small_note(small: Weighed, claimed: Weighed) -> str:
    """What to say of an effect that takes away what a verdict leaves, and is too small to be claimed."""
    more = "+".join(n for n in small.effects if n not in claimed.effects)
    left_by = claimed.name if claimed.effects else "the model"
    return (
        f"what {left_by} leaves is less than the sensor resolves and therefore not claimed; it looks like {more} "
        f"of {1e6 * small.size_m:.2g} um"
    )


def silent_note(summary: dict[str, Any]) -> str:
    """What to say of recordings that would not show an effect even where it is strong."""
    plan = summary["next_experiment"].get("recording") or {"kind": "creep"}
    blind = len(summary["not_visible"])
    return (
        f"the recordings are too short or too quiet to tell: of the effects that were tried {blind} would not show at "
        f"any strength, so that '{summary['verdict']}' (confidence {summary['confidence']:.2f}) says little. "
        f"A recording that would help: {recording_in_words(plan, '+-')}"
    )


def _mains(summary: dict[str, Any]) -> str:
    """Frequency and amplitude of mains, as the parameters of the verdict have them."""
    told = next(h for h in summary["hypotheses"] if h["name"] == summary["verdict"])["parameters"]
    frequency, amplitude = (told[n]["mean"] for n in ("mains_Hz", "mains_m"))
    return f"mains at {frequency:.2f} Hz with an amplitude of {1e6 * amplitude:.2g} um"

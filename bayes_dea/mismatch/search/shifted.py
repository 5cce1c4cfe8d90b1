"""Single effects whose readings come a part of a sample early or late, as rivals of what explains alone.

Such a shift has prior odds of its own, whatever else there is (`Known.share`): an effect with one is as good an
explanation as an effect without. What two lags do, a mass with much damping does nearly, and so alone explains what is
a damper read late; no search beside the mass comes across the damper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...gauss_newton.laws import laws_of_effect
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from ..where.size import effect_size
from .beside import beside_these, together
from .frame import Frame
from .hypotheses import DELAY, extended
from .phase import sample_step_s
from .promising import MASS, RIVALS, refined, too_dear
from .quest import Quest
from .second_thoughts import beside_the_second
from .weigh import Weighed, refine

#: share of what a rival lacks that a grid has to promise: what it has already is moved along in a straight line
_PROMISED = 0.5
#: nats behind what explains alone at which the descent of a rival is given up
_FAR_BEHIND = 50.0
#: parts of a sample by which readings may be early or late where a mass is looked for
_PARTS = (0.25, 0.5, 0.75)
#: effects that make an answer late by about a sample, if they are weak
_LATE = {"series_resistance", "supply_current_limit", "one_quadrant_supply", "leakage", "extra_relaxation_mode",
         "parallel_damper", "inertia", "sensor_lag"}


def read_early_or_late(pair: Weighed, first: Weighed, known: Weighed | None, quest: Quest) -> list[Weighed]:
    """The first of two effects with a shift of half a sample instead of the second, fitted from the base of both.

    What comes late at every edge by a part of a sample, a mass with much damping does nearly as well, and only beside
    it the modes of the base find back to their work. From a delay of more than a sample descents may not lead to it:
    what is between two rows is a straight line. known: the first with a shift, where it was weighed.
    """
    second = set(pair.effects) - set(first.effects)
    if DELAY not in quest.names or DELAY in pair.effects or len(second) != 1 or not second & _LATE:
        return []
    if known is not None and known.log_evidence > pair.log_evidence - RIVALS:
        return []
    fitted, problem = pair.fit, pair.fit.problem
    at = dict(zip(problem.model.priors.names, fitted.q[: problem.model.dimension], strict=True))
    half = 0.5 * sample_step_s(fitted)
    both = together(first.effects, DELAY)
    out: list[Weighed] = []
    for law in laws_of_effect(DELAY, quest.given):
        model = extended(quest.model, both, {**quest.by(first.laws).given, **law})
        if model is None or half <= 0.0:
            continue
        delay = next((p.prior for p in model.priors.free if p.name == "T_d_s"), None)
        if delay is None:
            continue
        quest.say("comparing rivals", len(out), 2, f"{first.name}, read early or late")
        shift = math.log(half) if delay.is_log else math.copysign(half, delay.a)
        start = np.array([at.get(name, shift) for name in model.priors.names])
        q = np.concatenate([start, fitted.q[problem.model.dimension :]])
        fit = refit(problem.with_model(model), q, quest.prior.start(), quest.prior, coarse=True)
        if fit is not None:
            out.append(Weighed(both, fit, fit.log_evidence, 0.1, effect_size(first.fit, fit)))
    return sorted(out, key=lambda w: w.log_evidence)[-1:]


def mass_read_early_or_late(top: Weighed, weighed: Mapping[str, Weighed], quest: Quest) -> list[Weighed]:
    """A mass and a shift of the readings beside what else there is of an explanation, at shifts over a whole sample.

    What rings not far below half the sampling rate comes, a part of a sample late, in another phase: alone a mass of
    another frequency does a little of it, and so does a shift of another size, from neither of which a descent leads
    to both; nor from both together, where one has settled in the wrong phase. Looked for where a mass or a shift
    explains something. weighed: by name.
    """
    rest = tuple(n for n in top.effects if n not in (MASS, DELAY))
    both = together(rest, DELAY)
    if not {MASS, DELAY} <= set(quest.names) or not _shifts(top, rest, weighed):
        return []
    if too_dear((MASS, *rest)) or len(both) > 2:
        return []
    start = weighed.get("+".join(rest)) if rest else None
    fit = start.fit if start is not None else quest.base
    late = weighed.get("+".join(both))
    told = 0.0
    if late is not None and late.refitted and not {MASS, DELAY} <= set(top.effects):
        told = math.copysign(1.0, late.fit.values()["T_d_s"])
    out: list[Weighed] = []
    for law in laws_of_effect(DELAY, quest.given):
        if told and (law == {}) != (told > 0.0):
            continue  # where a mass has not led astray, a shift has the right sign, if the wrong size
        model = extended(quest.model, both, {**quest.by(top.laws).given, **law})
        frames = [] if model is None else _at_shifts(fit, model, quest)
        if frames:
            base = min((f.fit for f in frames), key=lambda f: f.objective)
            found = beside_these(frames, both, MASS, quest.model, {**quest.by(top.laws).given, **law})
            out += refined(base, found, quest.unasked()).values()
    return sorted((w for w in out if w.refitted), key=lambda w: w.log_evidence)[-1:]


def _shifts(top: Weighed, rest: Sequence[str], weighed: Mapping[str, Weighed]) -> bool:
    """Whether a mass or a shift is a part of what explains most, or a shift helps beside the rest of it."""
    if {MASS, DELAY}.intersection(top.effects):
        return True
    late, alone = (weighed.get("+".join(names)) for names in (together(rest, DELAY), rest))
    return bool(late and alone and late.refitted and late.log_evidence > alone.log_evidence + RIVALS)


def _at_shifts(fit: Fit, model: Model, quest: Quest) -> list[Frame]:
    """A fit with readings a quarter, a half and three quarters of a sample early or late, as the model has it."""
    delay = next((p.prior for p in model.priors.free if p.name == "T_d_s"), None)
    step = sample_step_s(fit)
    if delay is None or step <= 0.0:
        return []
    problem, known = fit.problem, dict(zip(fit.problem.model.priors.names, fit.q, strict=False))
    frames = []
    for part in _PARTS:
        shift = math.log(part * step) if delay.is_log else math.copysign(part * step, delay.a)
        at = np.array([known.get(name, shift) for name in model.priors.names])
        q = np.concatenate([at, fit.q[problem.model.dimension :]])
        there = refit(problem.with_model(model), q, quest.prior.start(), quest.prior, max_steps=0, fit_noise=False)
        frames += [] if there is None else [Frame(there)]
    return frames


def shifted_rivals(best: Weighed, weighed: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """Other single effects with a shift of the readings, where a grid promises that they come near `best`."""
    if len(best.effects) != 1 or DELAY not in quest.names or DELAY in best.effects:
        return []
    singles = {w.name: w for w in weighed if len(w.effects) == 1 and w.refitted}
    late = singles.pop(DELAY, None)
    others = [w for w in singles.values() if w.effects != best.effects]
    out = []
    for k, w in enumerate(others):
        quest.say("comparing rivals", k, len(others), f"{w.name}, read early or late")
        for s in beside_these([Frame(w.fit)], w.effects, DELAY, quest.model, quest.by(w.laws).given):
            if s.gain < _PROMISED * (best.log_evidence - w.log_evidence - RIVALS):
                continue
            found = refine(w.fit, s, quest.prior, 1, best.value, _FAR_BEHIND)
            if found is not None:
                out.append(replace(found, size_m=effect_size(quest.base, found.fit)))
    top = max(out, key=lambda w: w.log_evidence, default=None)
    if late is None or top is None or top.log_evidence < best.log_evidence:
        return out
    # alone an effect may have lost its work to a mode of the base; it has it again where the shift is known
    known = {w.effects for w in out}
    lost = [w.name for w in others if together(w.effects, DELAY) not in known]
    return out + beside_the_second(top, late, quest.among(lost))

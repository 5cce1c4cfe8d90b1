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
from numpy.typing import NDArray

from ...gauss_newton.laws import laws_of_effect
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from ..where.size import effect_size
from .beside import beside, beside_these, together
from .frame import Frame
from .hypotheses import DELAY, extended
from .in_its_place import DAMPED
from .phase import sample_step_s
from .promising import MASS, RIVALS
from .quest import Quest
from .second_thoughts import beside_the_second
from .weigh import Weighed, refine

Array = NDArray[np.float64]
#: share of what a rival lacks that a grid has to promise: what it has already is moved along in a straight line
_PROMISED = 0.5
#: nats behind what explains alone at which the descent of a rival is given up
_FAR_BEHIND = 50.0
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
    return _half_a_sample_off(first, pair.fit, quest)


def damped_and_shifted(best: Weighed, weighed: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """What comes late in the place of a mass beside another effect, with a shift of half a sample as well.

    A damper read a tenth of a sample late is a mass that rings beyond what is sampled, and both leave nothing.
    """
    if len(best.effects) != 2 or MASS not in best.effects or DELAY not in quest.names:
        return []
    beside = set(best.effects) - {MASS}
    known = {w.effects for w in weighed if w.refitted}
    late = [
        w for w in weighed
        if w.refitted and len(w.effects) == 2 and beside < set(w.effects) and set(w.effects) - beside <= DAMPED
        and w.log_evidence > best.log_evidence - _FAR_BEHIND and together(w.effects, DELAY) not in known
    ]  # fmt: skip
    return [found for w in late for found in _half_a_sample_off(w, w.fit, quest)]


def _half_a_sample_off(w: Weighed, start: Fit, quest: Quest) -> list[Weighed]:
    """A hypothesis with a shift of half a sample either way, fitted from some place; the better one, if any."""
    both = together(w.effects, DELAY)
    out: list[Weighed] = []
    for law in laws_of_effect(DELAY, quest.given):
        model = extended(quest.model, both, {**quest.by(w.laws).given, **law})
        q = None if model is None else shifted_by(start, model, 0.5)
        if model is None or q is None:
            continue
        quest.say("comparing rivals", len(out), 2, f"{w.name}, read early or late")
        fit = refit(start.problem.with_model(model), q, quest.prior.start(), quest.prior, coarse=True)
        if fit is not None:
            out.append(Weighed(both, fit, fit.log_evidence, 0.1, effect_size(w.fit, fit)))
    return sorted(out, key=lambda w: w.log_evidence)[-1:]


def either_read_early_or_late(pair: Weighed, weighed: Mapping[str, Weighed], quest: Quest) -> list[Weighed]:
    """Each of two effects with a shift of half a sample instead of the other."""
    out = []
    for name in pair.effects:
        single = weighed.get(name)
        if single is not None:
            known = weighed.get("+".join(together((name,), DELAY)))
            out += read_early_or_late(pair, single, known, quest)
    return out


def shifted_by(fit: Fit, model: Model, part: float) -> Array | None:
    """Coordinates of a fit by a model that has a delay as well, read a part of a sample late, or early by its law.

    None where the model has no free delay, or the rows no step.
    """
    delay = next((p.prior for p in model.priors.free if p.name == "T_d_s"), None)
    shift = part * sample_step_s(fit)
    if delay is None or shift <= 0.0:
        return None
    d = fit.problem.model.dimension
    at = dict(zip(fit.problem.model.priors.names, fit.q[:d], strict=True))
    at["T_d_s"] = math.log(shift) if delay.is_log else math.copysign(shift, delay.a)
    return np.concatenate([[at[name] for name in model.priors.names], fit.q[d:]])


def pairs_read_early_or_late(best: Weighed, weighed: Sequence[Weighed], quest: Quest) -> list[Weighed]:
    """The best two effects, and others that come near them, each with a shift of the readings as well.

    Where two are enough nothing further is looked for, but a shift may be there whatever else is: one of two that come
    near each other may gain by it what the other one lacks, and recordings to validate may show it.
    """
    if len(set(best.effects) - {DELAY}) != 2 or DELAY not in quest.names:
        return []
    known = {w.effects for w in weighed if w.refitted}
    near = [
        w for w in weighed
        if w.refitted and len(w.effects) == 2 and DELAY not in w.effects and together(w.effects, DELAY) not in known
        and w.log_evidence > best.log_evidence - RIVALS
    ]  # fmt: skip
    return [found for w in near for found in beside(w, quest.among([DELAY])) if found.fit is not w.fit]


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

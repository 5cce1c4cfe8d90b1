"""A mass and a shift of the readings, looked for together where neither leads to the other.

What rings not far below half the sampling rate comes, a part of a sample late, in another phase: alone a mass of
another frequency does a little of it, and so does a shift of another size, from neither of which a descent leads to
both; nor from both together, where one has settled in the wrong phase.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ...gauss_newton.laws import laws_of_effect
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from .beside import beside_these, together
from .frame import Frame
from .hypotheses import DELAY, extended
from .promising import MASS, RIVALS, refined, too_dear
from .quest import Quest
from .shifted import shifted_by
from .weigh import Weighed

#: parts of a sample by which readings are early or late
_PARTS = (0.25, 0.5, 0.75)


def mass_read_early_or_late(top: Weighed, weighed: Mapping[str, Weighed], quest: Quest) -> list[Weighed]:
    """A mass beside what else there is of an explanation, in readings at shifts over a whole sample.

    Looked for where a mass or a shift explains something. weighed: by name.
    """
    rest = tuple(n for n in top.effects if n not in (MASS, DELAY))
    both = together(rest, DELAY)
    if not {MASS, DELAY} <= set(quest.names) or not _shifts(top, rest, weighed):
        return []
    start = weighed.get("+".join(rest))
    if len(rest) > 1 or too_dear((MASS, *rest)) or (rest and (start is None or not start.refitted)):
        return []
    fit, laws = (start.fit, start.laws) if rest and start is not None else (quest.base, {})
    sign = 0.0 if {MASS, DELAY} <= set(top.effects) else _sign_of_the_shift(weighed.get("+".join(both)))
    out: list[Weighed] = []
    for law in laws_of_effect(DELAY, quest.given):
        if sign and (law == {}) != (sign > 0.0):
            continue
        given = {**quest.by(laws).given, **law}
        model = extended(quest.model, both, given)
        frames = [] if model is None else _at_shifts(fit, model, quest)
        if frames:
            base = min((f.fit for f in frames), key=lambda f: f.objective)
            out += refined(base, beside_these(frames, both, MASS, quest.model, given), quest.unasked()).values()
    return sorted((w for w in out if w.refitted), key=lambda w: w.log_evidence)[-1:]


def _shifts(top: Weighed, rest: Sequence[str], weighed: Mapping[str, Weighed]) -> bool:
    """Whether a mass or a shift is a part of what explains most, or a shift helps beside the rest of it."""
    if {MASS, DELAY}.intersection(top.effects):
        return True
    late, alone = (weighed.get("+".join(names)) for names in (together(rest, DELAY), rest))
    return bool(late and alone and late.refitted and late.log_evidence > alone.log_evidence + RIVALS)


def _sign_of_the_shift(late: Weighed | None) -> float:
    """Of a shift without a mass, which may have the wrong size and has the right sign; 0 where none was fitted."""
    return math.copysign(1.0, late.fit.values()["T_d_s"]) if late is not None and late.refitted else 0.0


def _at_shifts(fit: Fit, model: Model, quest: Quest) -> list[Frame]:
    """A fit with its readings shifted, as the model has it."""
    problem, noise = fit.problem.with_model(model), quest.prior.start()
    places = [q for q in (shifted_by(fit, model, part) for part in _PARTS) if q is not None]
    fits = [refit(problem, q, noise, quest.prior, max_steps=0, fit_noise=False) for q in places]
    return [Frame(f) for f in fits if f is not None]

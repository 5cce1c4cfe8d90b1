"""Explanations with fewer effects, begun from those with more: a mode that went astray, an effect that is not needed.

Where two effects are fitted at once, one of the base's modes may end where it serves nothing (a local maximum), and a
further mode then explains what that one should. So a further mode is tried in the place of each of the base's, without
the effect that brought it.
"""

from __future__ import annotations

import math

import numpy as np

from ...gauss_newton.descent import approach
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ...models.model import Model
from ..where.size import effect_size
from .relocate import elements_of, stands_in, with_modes
from .weigh import Weighed

FURTHER = "extra_relaxation_mode"
#: modulus of a mode that is to do nothing much, by those of the others
_IDLE = 0.02
#: by how much (log) a refit may move the time constant of an exchanged mode
_SAME_TIME = 1.0


def in_place_of_one(found: Weighed, base: Fit, model: Model, prior: NoisePrior) -> Weighed | None:
    """`found` (with `FURTHER` among its effects) without it, refitted with its mode in the place of one of the base's.

    model: the base with the other effects of `found`. None where the network has no relaxation times of its own, or
    no such fit has an answer.
    """
    spec = model.spec
    if FURTHER not in found.effects or spec.network != "gm":
        return None
    problem = found.fit.problem.with_model(model)
    values = found.fit.values()
    ends = []
    for i in range(1, spec.elements + 1):
        kept = [e for j, e in enumerate(elements_of(values, spec.elements), 1) if j != i]
        modes = [*kept, (values["tau_x_s"], values["k_x_Pa"])]
        start = with_modes(found.fit, model, values, modes)
        if not np.isfinite(start).all():
            continue
        end = approach(problem, start, prior.start())
        if end is not None:
            ends.append(end)
    if not ends:
        return None
    fit = refit(problem, min(ends, key=lambda e: e.value).q, prior.start(), prior, coarse=True)
    if fit is None:
        return None
    others = tuple(n for n in found.effects if n != FURTHER)
    return Weighed(others, fit, fit.log_evidence, 0.1, effect_size(base, fit))


def labellings(found: Weighed, prior: NoisePrior) -> list[Fit]:
    """The same explanation with each of the base's modes in turn as the further one, the found labelling first.

    Which of the modes is "the further one" no recording says; the priors of the time constants do, weakly. Networks in
    which they are exchangeable only (gm); without a further mode the fit alone.
    """
    model, spec = found.fit.problem.model, found.fit.problem.model.spec
    out = [found.fit]
    if FURTHER not in found.effects or spec.network != "gm":
        return out
    values = found.fit.values()
    if not {"k_x_Pa", "tau_x_s"} <= set(model.priors.names):
        return out
    for i in range(1, spec.elements + 1):
        kept = [e for j, e in enumerate(elements_of(values, spec.elements), 1) if j != i]
        named = values | {"tau_x_s": values[f"tau_{i}_s"], "k_x_Pa": values[f"k_{i}_Pa"]}
        start = with_modes(found.fit, model, named, [*kept, (values["tau_x_s"], values["k_x_Pa"])])
        if not np.isfinite(start).all():
            continue
        fit = refit(found.fit.problem, start, prior.start(), prior)
        # an exchange changes no answer: what ends elsewhere is another explanation
        if fit is not None and abs(math.log(fit.values()["tau_x_s"] / named["tau_x_s"])) < _SAME_TIME:
            out.append(fit)
    return out


def within(found: Weighed, base: Fit, model: Model, prior: NoisePrior) -> Weighed | None:
    """A simpler `model`, refitted from where `found` stands.

    Whether it takes the effects that the model does without is asked from there. What only the simpler one has (a
    resistance that comes with a leak where none is named) starts at its prior's median. None where it has no answer.
    """
    problem = found.fit.problem.with_model(model)
    before = found.fit.problem.model
    known = dict(zip(before.priors.names, found.fit.q[: before.dimension], strict=True))
    median = model.priors.transform(np.full((1, model.dimension), 0.5))[0]
    q = np.array([known.get(n, m) for n, m in zip(model.priors.names, median, strict=True)])
    start = np.concatenate([q, found.fit.q[before.dimension :]])
    fit = refit(problem, start, prior.start(), prior, coarse=True)
    if fit is None:
        return None
    others = tuple(n for n in model.spec.effects if n not in base.problem.model.spec.effects)
    return Weighed(others, fit, fit.log_evidence, 0.1, effect_size(base, fit))


def without_stand_in(found: Weighed, model: Model, prior: NoisePrior) -> Fit | None:
    """`found` without its further mode, which takes the place of one too fast to be seen as a mode; not refitted.

    Such a mode stands in for something else (one far faster than the sampling is a damper): what that is can be looked
    for from here. A refit would send a mode there again. model: as for `in_place_of_one`; None where there is no such
    mode.
    """
    if FURTHER not in found.effects or not stands_in(found.fit):
        return None
    values = found.fit.values()
    modes = sorted(elements_of(values, model.spec.elements))
    start = with_modes(found.fit, model, values, [*modes[1:], (values["tau_x_s"], values["k_x_Pa"])])
    problem = found.fit.problem.with_model(model)
    return refit(problem, start, prior.start(), prior, max_steps=0, fit_noise=False)


def with_stand_in_idle(found: Weighed, prior: NoisePrior) -> Fit | None:
    """`found` with the mode that is too fast to be seen as one made weak and slow; not refitted, None without one.

    What it stood in for is missing then, and can be looked for.
    """
    if not stands_in(found.fit):
        return None
    problem, values = found.fit.problem, found.fit.values()
    modes = sorted(elements_of(values, problem.model.spec.elements))
    span = max(float(p.recording.time_s[-1] - p.recording.time_s[0]) for p in problem.pieces)
    middle = math.sqrt(span * min(p.prepared.step_s for p in problem.pieces))
    idle = middle, _IDLE * sum(k for _, k in modes[1:]) if len(modes) > 1 else _IDLE * modes[0][1]
    start = with_modes(found.fit, problem.model, values, [*modes[1:], idle])
    return refit(problem, start, prior.start(), prior, max_steps=0, fit_noise=False)

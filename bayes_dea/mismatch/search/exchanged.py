"""An absorption of the dielectric and a mode of the material that have taken each other's places.

Both creep by an exponential of their own, and what tells them apart (forces, how the creep goes with the field) is a
hundredth of what they do. A search that comes across the wrong one first ends where the absorption does the work of a
slow mode and two modes that of a fast one; no descent leads from there to where they change places.
"""

from __future__ import annotations

from ...gauss_newton.descent import End, approach, value_at
from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ..where.size import effect_size
from .quest import Quest
from .relocate import FAST_STEPS, with_modes
from .weigh import Weighed

ABSORPTION = "dielectric_absorption"
#: nats by which it has to be better there, and steps before a descent that stays behind is given up
_BETTER, _PATIENCE = 3.0, 3


def exchanged(w: Weighed, quest: Quest) -> Weighed | None:
    """A hypothesis with its absorption in the place of a mode, and that mode in its own; None where it is no better.

    Networks but gm have no modes to be told by their places.
    """
    spec = w.fit.problem.model.spec
    if ABSORPTION not in w.effects or not w.refitted or spec.network != "gm":
        return None
    ends = _with_each_mode(w.fit, spec.elements, quest.prior)
    best = min(ends, key=lambda e: e.value, default=None)
    if best is None:
        return None
    fit = refit(w.fit.problem, best.q, quest.prior.start(), quest.prior)
    if fit is None or fit.log_evidence < w.log_evidence + _BETTER:
        return None
    return Weighed(w.effects, fit, fit.log_evidence, 0.1, effect_size(quest.base, fit))


def _with_each_mode(fit: Fit, elements: int, prior: NoisePrior) -> list[End]:
    """Descents with the absorption where each of the modes is that recordings show as one; those that end lower than
    the fit, with what sensors are said to scatter by."""
    values, least = fit.values(), FAST_STEPS * min(p.prepared.step_s for p in fit.problem.pieces)
    modes = [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in range(1, elements + 1)]
    noise = prior.start()
    here = value_at(fit.problem, fit.q, noise)
    out: list[End] = []
    for j, (tau, k) in enumerate(modes):
        if tau < least:
            continue
        # a mode creeps by about the share of the modulus that it has, an absorption by its own
        there = {**values, "tau_d_s": tau, "chi": k / values["Y_Pa"]}
        back = (values["tau_d_s"], values["chi"] * values["Y_Pa"])
        q = with_modes(fit, fit.problem.model, there, [*modes[:j], back, *modes[j + 1 :]])
        end = approach(fit.problem, q, noise, hopeless_above=here, patience=_PATIENCE)
        if end is not None and end.value < here:
            out.append(end)
    return out

"""An absorption of the dielectric and a mode of the material that have taken each other's places.

Both creep by an exponential of their own, and what tells them apart (forces, how the creep goes with the field) is a
hundredth of what they do. A search that comes across the wrong one first ends where the absorption does the work of a
slow mode and two modes that of a fast one; no descent leads from there to where they change places.
"""

from __future__ import annotations

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit, refit
from ..where.size import effect_size
from .quest import Quest
from .relocate import FAST_STEPS, with_modes
from .weigh import Weighed

ABSORPTION = "dielectric_absorption"
#: nats by which it has to be better there
_BETTER = 3.0


def exchanged(w: Weighed, quest: Quest) -> Weighed | None:
    """A hypothesis with its absorption in the place of a mode, and that mode in its own; None where it is no better.

    Networks but gm have no modes to be told by their places.
    """
    spec = w.fit.problem.model.spec
    if ABSORPTION not in w.effects or not w.refitted or spec.network != "gm":
        return None
    fits = [f for f in _with_each_mode(w.fit, spec.elements, quest.prior) if f is not None]
    best = min(fits, key=lambda f: f.objective, default=w.fit)
    if best.objective > w.fit.objective - _BETTER:
        return None
    fit = refit(best.problem, best.q, best.noise, quest.prior, known=best.linearisation)
    if fit is None or fit.log_evidence < w.log_evidence + _BETTER:
        return None
    return Weighed(w.effects, fit, fit.log_evidence, 0.1, effect_size(quest.base, fit))


def _with_each_mode(fit: Fit, elements: int, prior: NoisePrior) -> list[Fit | None]:
    """The fit with the absorption where each of the modes is that recordings show as one."""
    values, least = fit.values(), FAST_STEPS * min(p.prepared.step_s for p in fit.problem.pieces)
    modes = [(values[f"tau_{j}_s"], values[f"k_{j}_Pa"]) for j in range(1, elements + 1)]
    out: list[Fit | None] = []
    for j, (tau, k) in enumerate(modes):
        if tau < least:
            continue
        # a mode creeps by about the share of the modulus that it has, an absorption by its own
        there = {**values, "tau_d_s": tau, "chi": k / values["Y_Pa"]}
        back = (values["tau_d_s"], values["chi"] * values["Y_Pa"])
        q = with_modes(fit, fit.problem.model, there, [*modes[:j], back, *modes[j + 1 :]])
        out.append(refit(fit.problem, q, prior.start(), prior, coarse=True))
    return out

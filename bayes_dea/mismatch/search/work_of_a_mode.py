"""Single effects whose work a mode of the base does, so that the base leaves nothing: without that mode, in its place.

A sensor's lag of 0.9 ms is, to the readings, a branch of four times the modulus that relaxes in 0.2 ms. Where they need
no third mode for anything else (no long creep, say) a base fits as well as the truth does; only the priors tell that
such a branch is none. From where that base stands no effect promises anything.
"""

from __future__ import annotations

from dataclasses import replace

from ...gauss_newton.refit import Fit
from ..where.size import effect_size
from .frame import Frame
from .grid import Screened
from .promising import of_laws, on_grids
from .quest import Quest
from .relabel import with_stand_in_idle
from .weigh import Weighed, refine

#: share of what is missing without the mode that an effect may leave on its grid, which is coarse, to be fitted
_LEAVES = 0.1
#: how many are, the best first
_MOST = 4


def instead_of_a_mode(base: Fit, quest: Quest) -> list[Weighed]:
    """Effects fitted from the base without its mode that is too fast to be seen as one; none where there is no such.

    base: one that leaves nothing to be explained.
    """
    quiet = quest.prior.start()
    idle = with_stand_in_idle(Weighed((), base, base.log_evidence, 0.1, 0.0), quest.prior)
    if idle is None:
        return []
    here, there = (Frame(replace(f, noise=quiet)) for f in (base, idle))
    enough = here.value(base.clean)[0]
    missing = there.value(idle.clean)[0] - enough

    def leaves(s: Screened) -> float:
        return min(p.likelihood for p in s.points) - enough

    screened = on_grids([there], 1, quest)
    likely = sorted((s for s in screened if leaves(s) < _LEAVES * missing), key=leaves)
    out = []
    for k, s in enumerate(likely[:_MOST]):
        quest.say("refitting", k, len(likely[:_MOST]), "+".join(s.effects))
        w = refine(base, s, quest.prior)
        if w is not None:
            # the grid around a place that is no maximum of the base says little of the evidence
            w = of_laws(replace(w, log_evidence=w.fit.log_evidence), screened)
            out.append(replace(w, log_evidence_se=0.1, size_m=effect_size(base, w.fit)))
    return out

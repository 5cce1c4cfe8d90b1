"""An effect that contains one of several, in its place: as likely where what it adds to that one cannot be seen."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ...gauss_newton.laws import laws_of_effect
from ...models.effects import registered_effects
from .beside import CONTAINS, together
from .hypotheses import extended
from .promising import too_dear
from .quest import Quest
from .relabel import within
from .ridge import integrated
from .weigh import Weighed

#: nats that the maximum may lie below that of the explanation (where its own prior is thin), and more is no rival
_BELOW = 12.0


def containing(w: Weighed, known: Collection[str], quest: Quest) -> list[Weighed]:
    """Rivals of several effects with one that contains one of theirs in its place, from where they stand.

    A leak acts through the resistance before it, and one of many megaohms is nothing but that. A single leak is always
    weighed; beside another effect its grid may promise nothing, as there is nothing left. The middle of its prior is
    where it does little, and from there its own parameters are drawn, most of which the recordings do not tell.
    known: names of hypotheses that were fitted.
    """
    out: list[Weighed] = []
    if len(w.effects) < 2:
        return out
    for wide, narrow in CONTAINS.items():
        if narrow not in w.effects or wide in w.effects or wide not in quest.names:
            continue
        both = together([n for n in w.effects if n != narrow], wide)
        if "+".join(both) in known or too_dear(both):
            continue
        model = extended(quest.model, both, quest.by(w.laws).given)
        if model is None:
            continue
        quest.say("comparing rivals", 0, 1, "+".join(both))
        found = within(w, quest.base, model, quest.prior)
        if found is None or found.fit.objective > w.fit.objective + _BELOW:
            continue
        own = {p.name for p in registered_effects()[wide].parameters}
        places = np.flatnonzero([n in own for n in model.priors.names])
        evidence, se = integrated(found.fit, places, quest.rng) or (found.log_evidence, found.log_evidence_se)
        shared = -math.log(len(laws_of_effect(wide, quest.given)))
        out.append(replace(found, log_evidence=evidence + shared, log_evidence_se=se, shared_prior=shared))
    return out

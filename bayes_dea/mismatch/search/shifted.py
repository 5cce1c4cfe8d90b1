"""Single effects whose readings come a part of a sample early or late, as rivals of what explains alone.

Such a shift has prior odds of its own, whatever else there is (`Known.share`): an effect with one is as good an
explanation as an effect without. What two lags do, a mass with much damping does nearly, and so alone explains what is
a damper read late; no search beside the mass comes across the damper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..where.size import effect_size
from .beside import beside_these, together
from .frame import Frame
from .hypotheses import DELAY
from .promising import RIVALS
from .quest import Quest
from .second_thoughts import beside_the_second
from .weigh import Weighed, refine

#: share of what a rival lacks that a grid has to promise: what it has already is moved along in a straight line
_PROMISED = 0.5
#: nats behind what explains alone at which the descent of a rival is given up
_FAR_BEHIND = 50.0


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

"""A shift of less than one sample is timing, not physics: what of a delay is too short to be claimed."""

from __future__ import annotations

from dataclasses import dataclass

from .search.hypotheses import DELAY, NONE
from .search.naming import Naming
from .search.phase import delay_of


@dataclass(frozen=True)
class Shift:
    """Probabilities by name with every delay below one sample taken out of its name.

    physics: the hypothesis behind each name. delays_s: the shift that a name carries unsaid, by name.
    """

    probability: dict[str, float]
    physics: dict[str, str]
    delays_s: dict[str, float]


def as_timing(probability: dict[str, float], naming: Naming) -> Shift:
    """Move the probability that a delay is shorter than one sample to the name without it."""
    p = dict(probability)
    physics = {k: k for k in p}
    delays: dict[str, float] = {}
    for name in list(p):
        parts = name.split("+")
        if name not in naming.timing:
            continue
        delay, below = delay_of(naming.weighed[name].fit), naming.timing[name]
        if delay is None:  # not refitted: it is far behind
            continue
        bare = "+".join(x for x in parts if x != DELAY) or NONE
        moved = p[name] * below
        if moved > p.get(bare, 0.0):
            delays[bare] = delay
            # "none" stays what it is; another name is corrected with the shift in it
            physics[bare] = NONE if bare == NONE else name
        p[name] *= 1.0 - below
        p[bare] = p.get(bare, 0.0) + moved
        physics.setdefault(bare, bare)
    return Shift(p, physics, delays)


#: how the note of a shift begins: by it the statement knows that there is one
SHIFT_NOTE = "timing: the readings"


def timing_note(delay_s: float, step_s: float) -> str:
    """One line about a shift that is no physics."""
    how = "lead" if delay_s < 0.0 else "lag"
    return (
        f"{SHIFT_NOTE} {how} the command by {1e3 * abs(delay_s):.2g} ms, less than one sample "
        f"({1e3 * step_s:.3g} ms): when a row is read and when its command was given is the bench's convention, no "
        "physics; see hold in campaign.toml"
    )

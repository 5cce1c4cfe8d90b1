"""What the strength and the parameters of an effect are drawn from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .draws import log_uniform

#: parameters of an effect of a given strength
Parameters = Callable[[float], dict[str, float]]


@dataclass(frozen=True)
class Around:
    """What a prior may depend on: layer and modulus of the actuator, largest voltage, displacement and time of its
    recordings, a number between 0.6 and 0.95, and the names of all that is concealed."""

    layer_m: float
    Y_Pa: float
    most_V: float
    most_m: float
    most_s: float
    share: float
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Prior:
    """Parameters by strength, of which more is always a larger effect, and the strengths allowed."""

    parameters: Parameters
    low: float
    high: float

    def start(self, rng: np.random.Generator) -> float:
        """A strength to begin with; nothing is drawn where there is no choice."""
        return self.low if self.low == self.high else log_uniform(rng, self.low, self.high)


#: draws what belongs to an effect beside its strength: generator, surroundings, seed of the effect's own noise
Draw = Callable[[np.random.Generator, Around, int], Prior]
REGISTERED: dict[str, Draw] = {}


def prior_of(name: str) -> Callable[[Draw], Draw]:
    """Register the prior of an effect."""

    def keep(draw: Draw) -> Draw:
        REGISTERED[name] = draw
        return draw

    return keep

"""What a search for left-out physics goes by, the same for all its parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit
from ...models.model import Model

#: called with (phase, done, of, text)
Report = Callable[[str, float, float, str], None]


def unheard(_phase: str, _done: float, _of: float, _text: str) -> None:
    """Nobody listens."""


@dataclass(frozen=True)
class Quest:
    """The model that effects are added to, those that may be, and how what is found is judged.

    base: the model's fit without any of them; names: effects that may be added; given: priors and laws of their
    parameters; prior: of the noise; adequate: whether a fit leaves nothing significant, None where nobody asks.
    """

    base: Fit
    names: tuple[str, ...]
    given: Mapping[str, object]
    prior: NoisePrior
    rng: np.random.Generator
    say: Report = unheard
    adequate: Callable[[Fit], bool] | None = None

    @property
    def model(self) -> Model:
        """The model without any further effect."""
        return self.base.problem.model

    def explained_by(self, fit: Fit) -> bool:
        """Whether a fit is known to leave nothing significant."""
        return self.adequate is not None and self.adequate(fit)

    def among(self, names: Iterable[str]) -> Quest:
        """The same for these effects alone."""
        return replace(self, names=tuple(names))

    def by(self, laws: Mapping[str, object]) -> Quest:
        """The same by the laws of what is there already."""
        return replace(self, given={**self.given, **laws})

    def unasked(self) -> Quest:
        """The same where nobody asks whether what is found is enough."""
        return replace(self, adequate=None)

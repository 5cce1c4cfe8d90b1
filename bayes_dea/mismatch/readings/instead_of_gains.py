"""Something unlisted that explains recordings better than a gain of each of them does.

Gains that may differ within the stated accuracy leave nothing of a small mismatch whose size goes with the recording: a
play takes its width from every swing, a resonance adds to waves near its own frequency. Both are as improbable before
as a sensor that was moved (`MOVED`, `PRIOR`), so that their evidences decide.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from ...gauss_newton.noise_prior import NoisePrior
from ...gauss_newton.refit import Fit
from ..left_out import Repaired
from ..where.size import repair_size
from .edge_crosstalk import crosstalk_of
from .holder_resonance import resonance_of
from .output_play import plays_of
from .supply_offset import offset_of
from .unlisted import CLEAR


def better_than_gains(
    fit: Fit, loose: Fit, prior: NoisePrior, resolution_m: float = 0.0, behind: float = 0.0
) -> bool:
    """Whether something unlisted beside a fit is clearly likelier than the fit with a gain of each recording (loose),
    and than what is ahead of that by so many nats (behind). It has to move a recording by what the sensor resolves."""
    beyond = max(loose.log_evidence + behind, fit.log_evidence) + CLEAR
    found = (f for f in _unlisted(fit, prior, beyond) if f is not None)
    return any(f.log_evidence > beyond and repair_size(fit, f.repaired) >= resolution_m for f in found)


class _Known(Protocol):
    @property
    def log_evidence(self) -> float: ...
    @property
    def repaired(self) -> Repaired: ...


def _unlisted(fit: Fit, prior: NoisePrior, beyond: float) -> Iterator[_Known | None]:
    """What is known beside a fit, one worked out after the other."""
    yield resonance_of(fit, fit, prior)
    yield from plays_of(fit, prior, beyond)
    yield offset_of(fit, prior, beyond)
    yield crosstalk_of(fit, fit, prior)

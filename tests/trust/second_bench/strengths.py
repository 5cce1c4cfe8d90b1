"""Finds the strength at which an effect has a wanted size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from . import listed_priors, unlisted_priors  # noqa: F401  (they register)
from .priors import REGISTERED, Around
from .recordings import Effects
from .sheets import RESOLUTION_M
from .sizing import Run, Sizer

_TRIES = 7
#: largest size in resolution steps; a delay of one sample is 140 of them already on a rectangle of 10 Hz
_MOST = 200
_MOST_OF = {"acquisition_delay": 700, "series_resistance+leakage": 700, "voltage_dependent_delay": 700}


class DroppedError(Exception):
    """No strength within the prior gives a size within the limits: the case is drawn anew."""


def most_steps(name: str, names: Sequence[str]) -> int:
    """Largest size of an effect, in resolution steps, beside others."""
    return _MOST_OF.get("+".join(names) if name == "series_resistance" else name, _MOST)


def allowed(crude_m: float, refit_m: float, most: int) -> bool:
    """At least a resolution step after a refit of everything, and not overwhelming."""
    return RESOLUTION_M <= crude_m <= most * RESOLUTION_M and refit_m >= RESOLUTION_M


def find_strength(
    rng: np.random.Generator, name: str, around: Around, sizer: Sizer, run: Run, others: Effects, target_m: float
) -> dict[str, float]:
    """Parameters of an effect whose crude size on the most affected recording is near target_m, beside `others`."""
    seed = int(rng.integers(1 << 30))
    prior = REGISTERED[name](rng, around, seed)
    s = prior.start(rng)
    most = most_steps(name, around.names)
    fixed = prior.low == prior.high
    tried: list[tuple[float, float, float]] = []
    for attempt in range(_TRIES):
        parameters = prior.parameters(s)
        without = dict(others)
        if name == "leakage" and "series_resistance" not in others:
            # a leak acts through a resistance that is the actuator's own: its size is counted from that
            without["series_resistance"] = {"R_s_ohm": parameters["R_s_ohm"]}
        sizes = sizer.sizes({**others, name: parameters}, without, run)
        crude, refit = float(sizes.crude_m.max()), float(sizes.refit_m.max())
        tried.append((s, crude, refit))
        if not np.isfinite(crude):
            raise DroppedError("not finite")
        good = allowed(crude, refit, most)
        if good and (abs(np.log(crude / target_m)) < 0.25 or fixed or attempt == _TRIES - 1):
            return parameters
        if fixed:
            raise DroppedError(f"{name}: size {crude / RESOLUTION_M:.2f} steps")
        following = _next(tried, target_m, prior.low, prior.high)
        if following == s:
            if good:
                return parameters
            raise DroppedError(
                f"{name}: at its bound with {crude / RESOLUTION_M:.2f} ({refit / RESOLUTION_M:.2f}) steps"
            )
        s = following
    raise DroppedError(f"{name}: no strength found {tried[-1]}")


def _next(tried: Sequence[tuple[float, float, float]], target_m: float, low: float, high: float) -> float:
    """The strength to try next: size goes as a power of strength, between the last two that showed anything."""
    s, crude, refit = tried[-1]
    shown = [t for t in tried if t[1] > 0]
    power = 1.0
    if len(shown) >= 2 and shown[-1][0] != shown[-2][0] and shown[-1][1] != shown[-2][1]:
        power = np.log(shown[-1][1] / shown[-2][1]) / np.log(shown[-1][0] / shown[-2][0])
        power = float(np.clip(power, 0.3, 4))
    # what a refit would take away altogether must be larger
    wanted = max(target_m, crude * 1.3 * RESOLUTION_M / refit) if 0 < refit < RESOLUTION_M else target_m
    following = s * (wanted / crude) ** (1 / power) if crude > 0 else s * 4
    return float(np.clip(following, max(low, s / 8), min(high, s * 8)))
